"""Priors of the bank where the plant file gives none, from a fault's effect against the noise.

A fault that began n samples ago has left sum |S^-1/2 dv|^2 of information in the innovations of
the healthy Kalman filter (Willsky and Jones, IEEE TAC 21 (1976)); one over its root is `sd(n)`, as
well as it can be known by then. From it, scale-free:

- `size`: a quarter of the range, in the training envelope, of what the fault enters, at least
  30 sd(100), and no more than min and max allow;
- `walk`: with a `rate`, rate sqrt(T) with rate T = sd(T), so that a ramp is followed as fast as
  the noise allows; without, sd(1000) / sqrt(1000 samples): a fault is constant between its jumps;
- `onset`: `prior_per_hour`, or once in 10^7 samples.

In its agile mode a fault walks sd(10) / sqrt(10 samples). What drives the states in the unknown
modes, and by how much they jump there, lies between the two bounds of a size (their geometric
mean): it may be anything, and too wide a prior would lose to a declared fault that fits badly.

A second fault has moved the states by the time it is noticed. Where the first one is a sensor's,
its estimate took that to itself; so with the second fault the sensor's state and estimate may shift
against each other by six standard deviations of the innovation, which is what a fault leaves until
it outweighs its prior odds.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.judged import operating_points
from faultgauge.detection.noise import Noise, spread_of_start
from faultgauge.observers.modes import Levels
from faultgauge.observers.observer import Linearisation, linearise
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant import respond
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.free_run import substeps_for

__all__ = ["MEMORY", "driven", "levels_of", "probes_of", "ranges"]

MEMORY = 100  # samples over which a fault must show to be judged
LONG = 1000  # samples over which a fault without a `rate` is taken for constant
CLEAR = 30.0  # times sd(MEMORY): a fault that nobody would overlook
ONSET = 1e-7  # per sample
AGILE = 10  # samples in which a fault that changes is followed
RECOVERY = 1e-5  # per sample
ALIEN = 0.03  # of the largest onset rate: how often something undeclared happens
BROADER = 4.0  # how much broader the loose mode's innovations are, as a variance
OVERLOOKED = 6.0  # standard deviations: ln odds of 18, from 10^-7 to 10, are sqrt(2 * 18) of them
MOST_DRIVEN = 4  # states that the unknown mode drives, at most


def levels_of(
    model: Model, noise: Noise, step: float, columns: tuple[str, ...]
) -> tuple[Levels, Float[np.ndarray, "times faults"]]:
    """(all levels of the bank, sd(n)) at `step` [s] per sample, for the outputs in `columns`."""
    plant = driven(model)
    signals, declared = plant.signals, model.plant.signals.faults
    substeps = substeps_for(step, model.max_step)
    linear = linearise(plant, operating_points(model), step, substeps)
    measured = [j for j, name in enumerate(signals.output_names) if name in columns]
    known = _knowledge(linear, noise, step, measured)
    least = CLEAR * known[MEMORY - 1]
    size = np.maximum(ranges(model, plant) / 4, np.where(np.isfinite(least), least, 1e-9))
    walk, onset = np.zeros(len(signals.faults)), np.zeros(len(declared))
    agile = np.zeros(len(signals.faults))
    for k, fault in enumerate(signals.faults):
        agile[k] = _walk(known[:, k], step, AGILE, None, float(size[k]))
        if k >= len(declared):
            size[k] = np.sqrt(size[k] * min(least[k], size[k]))
            walk[k] = _walk(known[:, k], step, LONG, None, float(size[k]))
            continue
        widest = max(abs(fault.min), abs(fault.max))
        size[k] = min(size[k], widest / 2 if np.isfinite(widest) else np.inf)
        walk[k] = _walk(known[:, k], step, LONG, fault.rate, float(size[k]))
        per_hour = fault.prior_per_hour
        onset[k] = ONSET / step if per_hour is None else per_hour / 3600
    kinds = _unlike(linear, len(declared), measured)
    usual = _usual(linear, noise, step, measured)
    drifted = spread_of_start(model, noise, columns)[1]
    levels = Levels(
        sigma=noise.sigma,
        process=noise.process,
        drift=noise.drift,
        drifted=drifted,
        walk=walk,
        agile=agile,
        size=size,
        onset=onset,
        jump=_jump(np.ptp(operating_points(model).x, axis=0) / 4, usual, bool(kinds[0])),
        hides=_hides(model, linear, noise, step, measured),
        loose=_loose(linear, noise, step, measured, usual),
        noisier=noise.sigma,
        unknown=ALIEN * onset.max() * kinds,
        recovery=RECOVERY / step,
        settling=1 / (AGILE * step),
    )
    return levels, known


def probes_of(model: Model, levels: Levels) -> Float[np.ndarray, "faults two"]:
    """Sizes (down, up) by which it is tried whether a fault would be seen; 0 where a limit of the
    fault leaves nothing to see."""
    faults = model.plant.signals.faults
    down = [max(-size, f.min) for size, f in zip(levels.size, faults, strict=False)]
    up = [min(size, f.max) for size, f in zip(levels.size, faults, strict=False)]
    return np.stack([np.minimum(down, 0.0), np.maximum(up, 0.0)], axis=1)


def driven(model: Model) -> GrayBoxPlant:
    """The plant with what drives its states in the unknown mode, as faults behind its own."""
    signals = model.plant.signals
    more = tuple(Fault(f"d_{s.name}", "state", s.name) for s in signals.states[:MOST_DRIVEN])
    return with_faults(model.plant, (*signals.faults, *more))


def _walk(
    known: Float[np.ndarray, "times"], step: float, memory: int, rate: float | None, size: float
) -> float:
    if not np.isfinite(known[-1]):  # it moves nothing at the median operating point
        return size / (LONG * step) ** 0.5 if rate is None else rate * (MEMORY * step) ** 0.5
    if rate is None:
        return float(known[memory - 1] / (memory * step) ** 0.5)
    reached = np.flatnonzero(rate * step * np.arange(1, LONG + 1) >= known)
    count = 1 + (reached[0] if len(reached) else LONG - 1)
    return float(rate * (count * step) ** 0.5)


def _unlike(
    linear: Linearisation, declared: int, measured: list[int]
) -> Float[np.ndarray, "unknown"]:
    """1 for every unknown mode that is worth having: where one state is driven and a declared
    fault drives it too, the two would share the probability of one and the same thing."""
    B, D = np.median(linear.B, axis=0), np.median(linear.D, axis=0)[measured]
    moves = np.any(B[:, :declared] != 0, axis=0) & np.all(D[:, :declared] == 0, axis=0)
    alike = B.shape[1] - declared == 1 and bool(moves.any())
    return np.array([0.0 if alike else 1.0, 1.0, 1.0])


def ranges(model: Model, plant: GrayBoxPlant) -> Float[np.ndarray, "faults"]:
    """Range over the training envelope of what each fault enters, in the fault's unit."""
    points, signals = operating_points(model), plant.signals
    rates, outputs = jax.vmap(lambda x, u: respond(plant, x, u))(
        jnp.asarray(points.x), jnp.asarray(points.u)
    )
    found = []
    for fault in signals.faults:
        match fault.enters:
            case "gain":
                found.append(2.0)
                continue
            case "state":
                values = np.asarray(rates)[:, signals.state_names.index(fault.target)]
            case "output":
                values = np.asarray(outputs)[:, signals.output_names.index(fault.target)]
            case "input":
                values = points.u[:, signals.input_names.index(fault.target)]
        values = values[np.isfinite(values)]
        found.append(float(np.ptp(values)) if len(values) else 0.0)
    return np.array(found)


def _covariance(
    A: Float[np.ndarray, "n n"],
    C: Float[np.ndarray, "m n"],
    Q: Float[np.ndarray, "n n"],
    R: Float[np.ndarray, "m m"],
) -> Float[np.ndarray, "n n"]:
    """Predicted covariance of the healthy Kalman filter after 1000 samples."""
    P = Q + A @ Q @ A.T
    for _ in range(LONG):
        S = C @ P @ C.T + R
        P = A @ (P - P @ C.T @ np.linalg.solve(S, C @ P)) @ A.T + Q
        P = (P + P.T) / 2
    return P


def _knowledge(
    linear: Linearisation, noise: Noise, step: float, measured: list[int]
) -> Float[np.ndarray, "times faults"]:
    """sd(n) of every fault, n = 1 to 1000 samples after its onset; inf where nothing shows."""
    A, B = np.median(linear.A, axis=0), np.median(linear.B, axis=0)
    C, D = np.median(linear.C, axis=0)[measured], np.median(linear.D, axis=0)[measured]
    P = _covariance(A, C, np.diag(noise.process**2 * step), np.diag(noise.sigma[measured] ** 2))
    S = C @ P @ C.T + np.diag(noise.sigma[measured] ** 2)
    K, white = P @ C.T @ np.linalg.inv(S), np.linalg.inv(np.linalg.cholesky(S))
    shift, total = np.zeros(B.shape), np.zeros(B.shape[1])
    known = np.zeros((LONG, B.shape[1]))
    for n in range(LONG):
        shift = A @ shift + B
        change = C @ shift + D
        total += np.sum((white @ change) ** 2, axis=0)
        shift = shift - K @ change
        known[n] = 1 / np.sqrt(np.maximum(total, 1e-300))
    return np.where(known > 1e100, np.inf, known)


def _jump(
    widest: Float[np.ndarray, "states"], usual: Float[np.ndarray, "states"], driven: bool
) -> Float[np.ndarray, "states"]:
    """The size of a jump; as wide as it may be where the jump is all that tells the unknown mode
    from a declared fault."""
    return np.sqrt(widest * CLEAR * usual) if driven else np.maximum(widest, CLEAR * usual)


def _usual(
    linear: Linearisation, noise: Noise, step: float, measured: list[int]
) -> Float[np.ndarray, "states"]:
    """Standard deviation of the healthy filter's predicted state."""
    A, C = np.median(linear.A, axis=0), np.median(linear.C, axis=0)[measured]
    R = np.diag(noise.sigma[measured] ** 2)
    return np.sqrt(np.diagonal(_covariance(A, C, np.diag(noise.process**2 * step), R)))


def _hides(
    model: Model, linear: Linearisation, noise: Noise, step: float, measured: list[int]
) -> Float[np.ndarray, "faults faults states"]:
    """How far the second fault's estimate takes to itself what the first does to the state that
    the second one's sensor measures."""
    signals = model.plant.signals
    A, C = np.median(linear.A, axis=0), np.median(linear.C, axis=0)[measured]
    R = np.diag(noise.sigma[measured] ** 2)
    S = C @ _covariance(A, C, np.diag(noise.process**2 * step), R) @ C.T + R
    moved = np.abs(C @ np.median(linear.B, axis=0)) / np.sqrt(np.diagonal(S))[:, None]
    share = moved / np.maximum(moved.max(axis=0), 1e-300)
    count = len(signals.faults)
    found = np.zeros((count, count, len(signals.states)))
    for k, fault in enumerate(signals.faults):
        j = signals.output_names.index(fault.target) if fault.enters == "output" else -1
        if j in measured and signals.outputs[j].measures is not None:
            state = signals.state_names.index(str(signals.outputs[j].measures))
            at = measured.index(j)
            found[:, k, state] = OVERLOOKED * np.sqrt(S[at, at]) * share[at, :count]
    return found


def _loose(
    linear: Linearisation,
    noise: Noise,
    step: float,
    measured: list[int],
    usual: Float[np.ndarray, "states"],
) -> Float[np.ndarray, "states"]:
    """A free walk of the states that, with the noise of the outputs doubled, makes innovations
    `BROADER` in the mean over the outputs."""
    A, C = np.median(linear.A, axis=0), np.median(linear.C, axis=0)[measured]
    R = np.diag(noise.sigma[measured] ** 2)
    free = usual / np.sqrt(step)
    P = _covariance(A, C, np.diag(noise.process**2 * step), R)
    healthy = np.linalg.slogdet(C @ P @ C.T + R)[1]

    def broader(share: float) -> float:
        Q = np.diag((noise.process**2 + (share * free) ** 2) * step)
        S = C @ _covariance(A, C, Q, 2 * R) @ C.T + 2 * R
        return float(np.exp((np.linalg.slogdet(S)[1] - healthy) / len(measured)))

    shares = 2.0 ** np.arange(-4, 12)
    return next((s for s in shares if broader(float(s)) >= BROADER), shares[-1]) * free
