"""Faults of a wheel that have the same values in a different order, and their residuals."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, Stuck
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import Conditions, Controller, closed_loop, with_faults
from faultgauge.simulation.satellite.observatory import PERIOD
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper.claims.components_flights import reference_torque

__all__ = [
    "CASES",
    "KINDS",
    "ORDER",
    "SAMPLES",
    "SINGLE_OR_MULTIPLE",
    "fault",
    "reordered",
    "residuals_of",
]

SAMPLES = 2048  # 512 s at 4 Hz
LATEST = 512  # sample by which a fault has begun
GAIN = 0.03  # 1/s, momentum control as in the experiment
SWING, CYCLE = (20.0, 60.0), (500.0, 1000.0)  # N*m*s and s: the momentum's path, a sine
TONE, WIDTH = (0.3, 0.8), 0.02  # Hz: where a bearing's tone may lie, and half its width
WANDER = (0.01, 0.05)  # Hz: the lubricant's wander
GROWTH = 20.0  # a growing fault's envelope at its end, the start being 1
BURSTS, LENGTH, QUIET = 5, 0.06, 0.02  # number, share of the time for each, envelope between


def _band(rng: np.random.Generator, low: float, high: float, samples: int) -> np.ndarray:
    """Gaussian noise between two frequencies [Hz], of unit variance."""
    spectrum = np.fft.rfft(rng.standard_normal(samples))
    f = np.fft.rfftfreq(samples, PERIOD)
    x = np.fft.irfft(np.where((f >= low) & (f <= high), spectrum, 0.0), samples)
    return x / x.std()


def _noise(rng: np.random.Generator, samples: int) -> np.ndarray:
    return rng.standard_normal(samples)


def _growing(rng: np.random.Generator, samples: int) -> np.ndarray:
    return rng.standard_normal(samples) * GROWTH ** np.linspace(0.0, 1.0, samples)


def _bursts(rng: np.random.Generator, samples: int) -> np.ndarray:
    envelope = np.full(samples, QUIET)
    length = round(LENGTH * samples)
    for start in rng.integers(0, samples - length, BURSTS):
        envelope[start : start + length] = 1.0
    return rng.standard_normal(samples) * envelope


def _tone(rng: np.random.Generator, samples: int) -> np.ndarray:
    centre = rng.uniform(*TONE)
    return _band(rng, centre - WIDTH, centre + WIDTH, samples)


def _wander(rng: np.random.Generator, samples: int) -> np.ndarray:
    return _band(rng, *WANDER, samples)


def _two(rng: np.random.Generator, samples: int) -> np.ndarray:
    return _tone(rng, samples) + _wander(rng, samples)


# A kind by its name: its raw signal, where it enters, its size against the others.
KINDS = {
    "noise": (_noise, "friction", 1.0),
    "growing": (_growing, "friction", 1.0),
    "bursts": (_bursts, "friction", 1.0),
    "tone": (_tone, "friction", 1.0),
    "wander": (_wander, "friction", 1.0),
    "tone and wander": (_two, "friction", 1.0),
    "noise in sensor": (_noise, "sensor", 1.0),
    "tone, double": (_tone, "friction", 2.0),
}
SINGLE_OR_MULTIPLE = ("tone", "wander", "tone and wander")
ORDER = ("noise", "growing", "bursts", *SINGLE_OR_MULTIPLE)
# What is to be told apart; "size_alone" where the residual holds the fault and nothing else.
CASES = {
    "order": ORDER,
    "natural": ORDER,
    "channel": ("noise", "noise in sensor"),
    "size": ("tone", "tone, double"),
    "size_alone": ("tone", "tone, double"),
}
CHANNELS = (Fault("friction", "state", "h"), Fault("sensor", "output", "T"))


def reordered(raw: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """The values of a Laplace distribution (zero mean, RMS 1) in the order of `raw`: its smallest
    where that is smallest, and so on. Whatever depends on the values alone is then the same for
    every `raw` of one length. Heavy tails, so that quiet stretches and bursts have their place.
    """
    p = (np.arange(len(raw)) + 0.5) / len(raw)
    values = np.where(p < 0.5, 1.0, -1.0) * np.log(2 * np.minimum(p, 1 - p))
    found = np.empty(len(raw))
    found[np.argsort(raw)] = values / np.sqrt(np.mean(values**2))
    return found


def fault(
    rng: np.random.Generator, kind: str, size: float, matched: bool
) -> Float[np.ndarray, "samples"]:
    """A fault of RMS `size` [N*m], times 0.7 to 1.4, from a random sample on; `matched`: with the
    values of `reordered`, else with its own."""
    raw, _, relative = KINDS[kind]
    onset = int(rng.integers(0, LATEST))
    scale = size * relative * 2.0 ** rng.uniform(-0.5, 0.5)
    found = np.zeros(SAMPLES)
    x = raw(rng, SAMPLES - onset)
    found[onset:] = scale * (reordered(x) if matched else x / np.sqrt(np.mean(x**2)))
    return found


def residuals_of(
    wheel: GrayBoxPlant,
    reference: Plant,
    inner: Sequence[Schedule],
    size: float,
    runs: int,
    rng: np.random.Generator,
    matched: bool = True,
) -> Float[np.ndarray, "kinds runs samples"]:
    """r = T - That [N*m] of the wheel alone under momentum control, `runs` of every kind; each has
    its own momentum path, phase of f(t), onset, amplitude and fault. The reference is given the
    measured momentum."""
    kinds = [kind for kind in KINDS for _ in range(runs)]
    t = PERIOD * np.arange(SAMPLES)
    path, f = np.zeros((len(kinds), SAMPLES, 2)), np.zeros((len(kinds), SAMPLES, 1, 2))
    for k, kind in enumerate(kinds):
        swing, cycle = rng.uniform(*SWING), rng.uniform(*CYCLE)
        path[k, :, 1] = swing * np.sin(2 * np.pi * (t / cycle + rng.uniform()))
        later = t + rng.uniform(0.0, 1000.0)
        f[k, :, 0, 0] = sum(each.profile.sizes(later) for each in inner)
        f[k, :, 0, int(KINDS[kind][1] == "sensor")] += fault(rng, kind, size, matched)
    flawed = with_faults(wheel, CHANNELS)
    h, u, T = _runs(flawed, jnp.asarray(path), jnp.asarray(f))
    r = np.asarray(T) - np.asarray(reference_torque(reference, h, u))
    return r.reshape(len(KINDS), runs, SAMPLES)


@eqx.filter_jit
def _runs(
    wheel: GrayBoxPlant,
    path: Float[Array, "runs samples 2"],
    f: Float[Array, "runs samples substeps 2"],
) -> tuple[Float[Array, "runs samples"], ...]:
    """(h, u, T) under u = 0.03 (h_ref - h), from the path's start."""
    samples, substeps = f.shape[1:3]
    free = Stuck(*(jnp.full((samples, substeps, n), jnp.nan) for n in (1, 1, 2)))
    controller = Controller(jnp.array([[0.0, GAIN]]), jnp.zeros((1, 2)))
    feedforward, quiet = jnp.zeros((samples, 1)), jnp.zeros((samples, 2))

    def one(path: Array, f: Array) -> tuple[Array, ...]:
        given = Conditions(feedforward, path, quiet, f, free, jnp.zeros((samples, 2), bool))
        run = closed_loop(wheel, controller, path[0, 1:], given, PERIOD)
        return run.x[:, 0], run.u[:, 0], run.y[:, 0]

    return jax.vmap(one)(path, f)
