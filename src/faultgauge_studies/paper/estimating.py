"""ESO and IESONN, one observer over two plants, and how their estimates are judged."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from faultgauge.observers.eso import ExtendedStateObserver, design_eso
from faultgauge.observers.observer import OperatingPoints, observe
from faultgauge.plants.plant import Plant
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import PERIOD, STEPS_PER_PERIOD
from faultgauge_studies import merit
from faultgauge_studies.paper.cases import ONSET, Case
from faultgauge_studies.paper.learning import PITCH

__all__ = [
    "AFTER",
    "BAND",
    "BANDWIDTH",
    "DELTA",
    "KAPPA",
    "ZETA",
    "Quality",
    "cramer_rao",
    "design",
    "estimate",
    "kalman_at_equal_noise",
    "noise_gain",
    "quality",
    "scored",
]

BANDWIDTH = 0.2  # omega_o, rad/s
# zeta = 1.01 satisfies condition (13), on whose boundary 1 lies. A jump of d leaves an error of
# at most d / (e omega_o) in h: delta keeps the greatest jump of eq (17), 0.2, in the linear zone
# of eq (12), since the bandwidth says nothing about the zone beyond it.
ZETA, KAPPA, DELTA = 1.01, 0.5, 0.4
AFTER = 50.0  # s: the estimate is scored from this long after a jump
BAND = 0.05  # of the jump: settled means inside
WINDOW = 50.0  # s, of the Cramer-Rao bound


class Quality(NamedTuple):
    """RMSE [N*m] from 50 s after each jump; the worst settling time [s] to 5 % of a jump and the
    worst overshoot as a share of it."""

    rmse: float
    settling_s: float
    overshoot: float


def design(
    plant: Plant, points: OperatingPoints, bandwidth: float = BANDWIDTH, zeta: float = ZETA
) -> ExtendedStateObserver:
    """The paper's observer in discrete time, closed on momentum, condition (13) insisted on."""
    found = design_eso(
        plant,
        "friction",
        points,
        PERIOD,
        bandwidth,
        ("hm",),
        PERIOD / STEPS_PER_PERIOD,
        zeta=zeta,
        kappa=KAPPA,
        delta=DELTA,
        paper=True,
    )
    if not isinstance(found.observer, ExtendedStateObserver):
        raise TypeError("design_eso designs an ExtendedStateObserver")
    return found.observer


def estimate(
    observer: ExtendedStateObserver,
    flown: Telemetry,
    noise: Float[np.ndarray, "samples"] | float = 0.0,
) -> Float[np.ndarray, "samples"]:
    """fhat [N*m] for the pitch wheel from its command and its momentum with `noise` [N*m*s]."""
    h = flown.momentum[:, PITCH] + noise
    y = np.stack([np.full(len(h), np.nan), h], axis=1)  # the torque output is not used
    dt = np.diff(np.asarray(flown.t), prepend=flown.t[0])
    found = observe(
        observer,
        jnp.asarray(h[:1]),
        jnp.asarray(flown.u[:, [PITCH]]),
        jnp.asarray(y),
        jnp.asarray(dt),
    )
    return np.asarray(jax.device_get(found.f))


def scored(case: Case, t: Float[np.ndarray, "samples"]) -> np.ndarray:
    """Samples from the onset on that are at least 50 s after the last jump."""
    edges = np.searchsorted(t, case.jumps)
    return merit.settled(t, edges, AFTER) & (t >= ONSET)


def quality(
    case: Case,
    t: Float[np.ndarray, "samples"],
    f: Float[np.ndarray, "samples"],
    d: Float[np.ndarray, "samples"],
) -> Quality:
    """How well `f` follows the injected `d` [N*m]."""
    edges = np.searchsorted(t, case.jumps)
    settling = merit.settling_times(t, f, d, edges, BAND)
    overshoot = merit.overshoots(t, f, d, edges, AFTER)
    error = merit.rmse(f, d, scored(case, t))
    return Quality(error, float(settling.max()), float(overshoot.max()))


def noise_gain(gain_x: float, gain_f: float, dt: float) -> float:
    """sd(fhat) per sd of white noise in h, in the linear zone over h(k+1) = h(k) + dt f.

    Closed form by the Lyapunov equation of (I - L C) A with L = (gain_x, gain_f).
    """
    A = np.array([[1.0, dt], [0.0, 1.0]])
    L = np.array([[gain_x], [gain_f]])
    closed = (np.eye(2) - L @ np.array([[1.0, 0.0]])) @ A
    return float(np.sqrt(solve_discrete_lyapunov(closed, L @ L.T)[1, 1]))


def kalman_at_equal_noise(observer: ExtendedStateObserver, sigma: float) -> ExtendedStateObserver:
    """The steady-state Kalman filter for f as a random walk, whose walk is chosen so that noise
    in h [sigma, N*m*s] reaches fhat as much as through `observer`."""
    momentum = observer.plant.signals.output_names.index("hm")
    wanted = noise_gain(
        float(observer.gain_x[0, momentum]), float(observer.gain_f[momentum]), PERIOD
    )
    low, high = -40.0, 10.0  # log of the walk's variance per sample
    for _ in range(80):
        middle = (low + high) / 2
        gain = _kalman_gain(np.exp(middle), sigma)
        low, high = (middle, high) if noise_gain(*gain, PERIOD) < wanted else (low, middle)
    gain_x, gain_f = _kalman_gain(np.exp(low), sigma)
    return eqx.tree_at(
        lambda o: (o.gain_x, o.gain_f, o.delta),
        observer,
        (
            observer.gain_x.at[0, momentum].set(gain_x),
            observer.gain_f.at[momentum].set(gain_f),
            jnp.asarray(1e9),  # linear everywhere
        ),
    )


def _kalman_gain(walk: float, sigma: float) -> tuple[float, float]:
    A = np.array([[1.0, PERIOD], [0.0, 1.0]])
    C = np.array([[1.0, 0.0]])
    # what moves f within a period moves h by half of it, which this filter leaves out as ESO does
    P = solve_discrete_are(A.T, C.T, np.diag([0.0, walk]), np.array([[sigma**2]]))
    gain = P @ C.T / (C @ P @ C.T + sigma**2)
    return float(gain[0, 0]), float(gain[1, 0])


def cramer_rao(sigma: float, window: float = WINDOW) -> float:
    """Smallest sd [N*m] of any unbiased estimate of a constant f from a window of h alone.

    h(k) = h0 + f t(k) + noise with h0 and f unknown: var = sigma^2 / sum (t - mean t)^2.
    """
    t = PERIOD * np.arange(round(window / PERIOD))
    return float(sigma / np.sqrt(np.sum((t - t.mean()) ** 2)))
