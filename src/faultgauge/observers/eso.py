"""The extended state observer (paper, eqs 11 to 14), over any `Plant`.

    e = h(xhat) - y
    d(xhat) = F(xhat, u) + f - beta_1 e           (and beta_2 e one integrator further in)
    d(f)    = -beta_(r+1) g(e, kappa, delta)

Over hand-written physics it is the paper's ESO (14); over a learned plant it is IESONN (11).
It is closed on an output that the fault reaches through r = 1 or 2 integrators, with poles
placed in discrete time, so it is stable at any omega_o dt.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from faultgauge.errors import InputError
from faultgauge.observers.gains import ackermann, bandwidth_poles, spectral_radius
from faultgauge.observers.observer import (
    CurrentObserver,
    Design,
    Linearisation,
    OperatingPoints,
    linearise,
)
from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Signals
from faultgauge.simulation.free_run import substeps_for

__all__ = ["ExtendedStateObserver", "design_eso", "fal"]

ZETA = 1 / np.sqrt(2)


def fal(e: Float[Array, "..."], kappa: float, delta: Float[Array, "..."]) -> Float[Array, "..."]:
    """The gain of eq (12): |e|^kappa sign(e) beyond delta, e / delta^(1 - kappa) inside."""
    outside = jnp.sign(e) * jnp.maximum(jnp.abs(e), delta) ** kappa
    return jnp.where(jnp.abs(e) > delta, outside, e / delta ** (1 - kappa))


class ExtendedStateObserver(CurrentObserver):
    """An ESO for one fault; designed by `design_eso`."""

    plant: Plant
    target: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    gain_x: Float[Array, "states outputs"]
    gain_f: Float[Array, "outputs"]
    kappa: float = eqx.field(static=True)
    delta: Float[Array, ""]

    def correct(
        self, x: Float[Array, "states"], f: Float[Array, ""], e: Float[Array, "outputs"]
    ) -> tuple[Float[Array, "states"], Float[Array, ""]]:
        """Linear in x; in f the fal gain, scaled to `gain_f e` inside |e| <= delta."""
        g = self.delta ** (1 - self.kappa) * fal(e, self.kappa, self.delta)
        fault = self.plant.signals.faults[self.target]
        return x - self.gain_x @ e, jnp.clip(f - self.gain_f @ g, fault.min, fault.max)


def design_eso(
    plant: Plant,
    fault: str,
    points: OperatingPoints,
    dt: float,
    bandwidth: float,
    measured: tuple[str, ...],
    max_step: float,
    *,
    zeta: float = ZETA,
    kappa: float = 1.0,
    delta: float = 1.0,
    paper: bool = False,
) -> Design:
    """Design an ESO for `fault` at sample time `dt` [s] with `bandwidth` omega_o [rad/s].

    `measured` names the outputs it may use. zeta = 1/sqrt(2) lags less than zeta >= 1 at equal
    noise; `paper` insists on real poles, which is condition (13). `kappa` in (0, 1] and `delta`
    (unit of the output) shape the fal gain; kappa = 1 is linear. Raises `InputError` where the
    fault is out of reach or a gain is out of range.
    """
    _check(bandwidth, zeta, kappa, delta, paper)
    signals = plant.signals
    target = _target(signals, fault)
    substeps = substeps_for(dt, max_step)
    linear = linearise(plant, points, dt, substeps)
    output, chain = _chain(plant, fault, linear, measured)
    A, C = _augmented(linear, target, chain, output)
    wanted = bandwidth_poles(len(chain) + 1, bandwidth, zeta, dt)
    L = _placed(A, C @ A, wanted, fault, signals.output_names[output])
    gain_x = np.zeros((len(signals.states), len(signals.outputs)))
    gain_f = np.zeros(len(signals.outputs))
    gain_x[list(chain), output] = L[:-1]
    gain_f[output] = L[-1]
    for state, other in _others(plant, chain, measured):
        gain_x[state, other] = 1.0 - np.exp(-bandwidth * dt)
    radius = spectral_radius(_error_dynamics(linear, target, gain_x, gain_f))
    observer = ExtendedStateObserver(
        plant=plant,
        target=target,
        substeps=substeps,
        gain_x=jnp.asarray(gain_x),
        gain_f=jnp.asarray(gain_f),
        kappa=kappa,
        delta=jnp.asarray(delta),
    )
    return Design(
        observer=observer,
        output=signals.output_names[output],
        order=len(chain) + 1,
        poles=tuple(complex(s) for s in np.log(wanted) / dt),
        real_poles=bool(np.all(np.abs(np.imag(wanted)) < 1e-12)),
        radius=radius,
    )


def _check(bandwidth: float, zeta: float, kappa: float, delta: float, paper: bool) -> None:
    for name, value, legal in (
        ("bandwidth", bandwidth, 0 < bandwidth < np.inf),
        ("zeta", zeta, 0 < zeta <= 10),
        ("kappa", kappa, 0 < kappa <= 1),
        ("delta", delta, 0 < delta < np.inf),
    ):
        if not legal:
            bound = {"zeta": "(0, 10]", "kappa": "(0, 1]"}.get(name, "(0, inf)")
            raise InputError(f"observer: {name} = {value:g} is out of range; legal is {bound}.")
    if paper and zeta < 1:
        raise InputError(
            f"observer: zeta = {zeta:g} violates condition (13), beta_1^2 > 4 beta_2 "
            "delta^(kappa-1), which paper mode insists on; use zeta > 1."
        )


def _target(signals: Signals, fault: str) -> int:
    """The fault's place. Raises `InputError` for a gain loss."""
    target = signals.fault_names.index(fault)
    if signals.faults[target].enters == "gain":
        raise InputError(
            f"fault {fault!r} is a gain loss, which an ESO cannot tell from an additive one; "
            'declare it with enters = "input" to get the equivalent additive size.'
        )
    return target


def _placed(
    A: Float[np.ndarray, "n n"],
    C: Float[np.ndarray, "n"],
    wanted: Complex[np.ndarray, "n"],
    fault: str,
    output: str,
) -> Float[np.ndarray, "n"]:
    """The gains. Raises `InputError` where `output` does not tell of the fault."""
    try:
        return ackermann(A, C, wanted)
    except np.linalg.LinAlgError:
        raise InputError(
            f"fault {fault!r} does not move output {output} at the median operating point (its "
            "effect changes sign or vanishes there), so no gain can be placed; measure an output "
            "that it always moves."
        ) from None


def _chain(
    plant: Plant, fault: str, linear: Linearisation, measured: tuple[str, ...]
) -> tuple[int, tuple[int, ...]]:
    """(output, states from it down to the fault): the shortest way in.

    Markov parameters over the operating points tell through how many integrators the fault
    reaches an output: D (none), C F_f (one), C F_x F_f (two).
    """
    signals = plant.signals
    target = signals.fault_names.index(fault)
    pushes = np.median(np.abs(linear.F_f[:, :, target]), axis=0) > 0
    drives = np.median(np.abs(linear.F_x), axis=0) > 0  # [s, i]: d(s) reads i
    reads = np.median(np.abs(linear.C), axis=0) > 0  # [j, s]: output j reads state s
    first = np.flatnonzero(pushes)
    usable = [j for j, name in enumerate(signals.output_names) if name in measured]
    direct = [j for j in usable if np.any(linear.D[:, j, target])]
    usable = [j for j in usable if j not in direct]
    one = [(j, (int(s),)) for j in usable for s in first if reads[j, s]]
    two = [
        (j, (int(s), int(i)))
        for j in usable
        for s in np.flatnonzero(reads[j])
        for i in first
        if s != i and drives[s, i]
    ]
    for found in (one, two):
        if found:
            return found[0]
    if direct:
        names = ", ".join(signals.output_names[j] for j in direct)
        raise InputError(
            f"fault {fault!r} enters output {names} directly, where an ESO cannot see it; measure "
            "a state that it does not enter, or read the residual instead."
        )
    pushed = ", ".join(signals.state_names[s] for s in first) or "no state"
    raise InputError(
        f"fault {fault!r} reaches none of the measured outputs ({', '.join(measured) or 'none'}) "
        f"through one or two integrators (it pushes {pushed}); add an output that measures "
        f"{pushed}, or a state that it drives directly."
    )


def _augmented(
    linear: Linearisation, target: int, chain: tuple[int, ...], output: int
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n"]]:
    """Nominal (A, C) of the chain and the fault: medians over the operating points."""
    index = list(chain)
    n = len(index) + 1
    A = np.eye(n)
    A[:-1, :-1] = np.median(linear.A[:, index][:, :, index], axis=0)
    A[:-1, -1] = np.median(linear.B[:, index, target], axis=0)
    C = np.zeros(n)
    C[:-1] = np.median(linear.C[:, output, index], axis=0)
    return A, C


def _others(
    plant: Plant, chain: tuple[int, ...], measured: tuple[str, ...]
) -> list[tuple[int, int]]:
    """(state, output) for measured states outside the chain: corrected at first order."""
    signals = plant.signals
    return [
        (s, j)
        for j, output in enumerate(signals.outputs)
        for s, state in enumerate(signals.states)
        if output.measures == state.name and output.name in measured and s not in chain
    ]


def _error_dynamics(
    linear: Linearisation,
    target: int,
    gain_x: Float[np.ndarray, "states outputs"],
    gain_f: Float[np.ndarray, "outputs"],
) -> Float[np.ndarray, "points n n"]:
    """(I - L C) A of state and fault at every operating point."""
    points, n = len(linear.A), gain_x.shape[0]
    A = np.tile(np.eye(n + 1), (points, 1, 1))
    A[:, :n, :n] = linear.A
    A[:, :n, n] = linear.B[:, :, target]
    C = np.zeros((points, gain_x.shape[1], n + 1))
    C[:, :, :n] = linear.C
    C[:, :, n] = linear.D[:, :, target]
    L = np.concatenate([gain_x, gain_f[None]])
    return (np.eye(n + 1) - L @ C) @ A
