"""Whether the input of a log is the command rather than what was applied.

A loop fights a fault with its command: behind a limit, a lag or dead time that the log does not
show, a fault looks like the actuator and the actuator like a fault. Three kinds of evidence: the
log goes beyond the actuator's limits; a network has learned that the input does nothing beyond a
level that it often exceeds; and what the model leaves of d(x), rho = dx - F(x, u), is u run through
a delay, a lag or a limit: with v that input, and C = [1, x, u] what a refit could absorb,

    rho = C w + g (v - u),   g equal to what v multiplies, b = dF/du + w_u

so that v acts and u does not. Chosen on every other block of the log, tested on the rest. A lag
behind a dead time looks like a longer dead time: both are told where together they explain as much
of what the better one leaves as that one has to explain of rho.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.linalg import solve_banded

from faultgauge.errors import InputError
from faultgauge.identification.log_checks import beyond_limits
from faultgauge.identification.samples import Stretch, channels, collect, in_effect, slow_columns
from faultgauge.plants.expression import Expression, Node, evaluate, names_used, networks_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Input
from faultgauge.programs import program
from faultgauge.telemetry import Run

__all__ = ["command_warnings", "response_warnings"]

DELAYS = (1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40)  # samples
LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # time constants in samples
QUANTILES = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95)  # of |u - median|: levels of a limit
BLOCKS = 10  # even ones choose, odd ones test
EXPLAINED = 0.6  # of what the model leaves: a disturbance that the loop fights reaches a half
GAINS = (0.7, 1.4)  # of g / b, which is 1 where v is what acts
ABOVE_NOISE = 2.0  # times the derivative's own noise, which the loop feeds back into u
EFFECT = 0.02  # of the spread of d(x): less does not matter
FLAT = 0.05  # of the slope in the middle half: a response that has stopped
BEYOND = 0.05  # of the samples lie where it has
EDGE = 0.999  # of a network's training: what lies further out is at its edge


class _Version(NamedTuple):
    """What may have been applied: the plant follows u `words`, and what to do about it."""

    words: str
    cure: str
    of: Callable[[Float[np.ndarray, "samples"]], Float[np.ndarray, "samples"]]
    late: bool = True  # a dead time, a lag, or both


class _Tried(NamedTuple):
    """How a version chosen on one half of the log does on the other: (share of rho, g / b)."""

    version: _Version
    share: float
    ratio: float


def command_warnings(plant: GrayBoxPlant, runs: Sequence[Run]) -> list[str]:
    """A sentence for every input of a fitted `plant` that looks like a command in `runs`."""
    signals, spec = plant.signals, plant.spec
    found = [text for each in signals.inputs for text in beyond_limits(each, runs)]
    how = channels(spec, runs)
    if how.hidden or any(p.vary for p in spec.parameters) or slow_columns(how, runs):
        return found  # there is no rho without simulation
    try:
        stretches, noise = collect(spec, [in_effect(signals, run) for run in runs], how)
    except InputError:  # too short to smooth: nothing can be said
        return found
    return found + response_warnings(plant, stretches, noise)


def response_warnings(
    plant: GrayBoxPlant, stretches: Sequence[Stretch], noise: Mapping[str, Mapping[str, float]]
) -> list[str]:
    """The part of `command_warnings` that looks at d(x); `noise` as `collect` states it."""
    x, u, dx = (
        np.concatenate([getattr(s.samples, name) for s in stretches]) for name in ("x", "u", "dx")
    )
    rates, slopes = map(np.asarray, _responses(plant, jnp.asarray(x), jnp.asarray(u)))
    floor = [noise.get(name, {}).get("derivative_noise", 0.0) for name in plant.signals.state_names]
    rest = dx - rates
    small = np.std(rest, axis=0) <= np.maximum(
        ABOVE_NOISE * np.array(floor), EFFECT * dx.std(axis=0)
    )
    found = []
    for k, each in enumerate(plant.signals.inputs):
        learned = [i for i, e in enumerate(plant.spec.derivatives) if [*_reads(e, each.name)]]
        if learned:
            slope = np.abs(slopes[:, learned, k]).max(axis=1)
            inside = np.asarray(_inside(plant, each.name, jnp.asarray(x), jnp.asarray(u)))
            found += _flat(each, u[inside, k], slope[inside], len(u))
        acting = [i for i in np.flatnonzero(~small) if slopes[:, i, k].any()]
        if acting:
            found += _other_response(plant, k, stretches, rest[:, acting], slopes[:, acting, k])
    return found


@program
def _responses(
    plant: GrayBoxPlant, x: Float[Array, "samples states"], u: Float[Array, "samples inputs"]
) -> tuple[Float[Array, "samples states"], Float[Array, "samples states inputs"]]:
    """F(x, u) and dF/du at every sample."""
    return (
        jax.vmap(plant.derivative)(x, u),
        jax.vmap(jax.jacfwd(plant.derivative, argnums=1))(x, u),
    )


@program
def _inside(
    plant: GrayBoxPlant,
    name: str,
    x: Float[Array, "samples states"],
    u: Float[Array, "samples inputs"],
) -> Bool[Array, "samples"]:
    """Where what networks are told of input `name` is within their training: at its edge and
    beyond they answer the same by design, not because the plant does."""

    def at(x: Float[Array, "states"], u: Float[Array, "inputs"]) -> Bool[Array, ""]:
        values = plant.point(x, u)
        rates = dict(zip(plant.signals.state_names, plant.derivative(x, u), strict=True))
        within = []
        for each in plant.spec.derivatives:
            for called, k, argument in _reads(each, name):
                network = plant.networks[called]
                p = evaluate(argument, values, jnp, derivatives=rates, networks=plant.networks)
                away = jnp.abs((p - network.input_center[k]) / network.input_scale[k])
                within.append(away < EDGE)
        return jnp.all(jnp.stack(within))

    return jax.vmap(at)(x, u)


def _flat(
    each: Input,
    u: Float[np.ndarray, "inside"],
    slope: Float[np.ndarray, "inside"],
    samples: int,
) -> Iterator[str]:
    """Whether a network has learned that `u` does nothing beyond a level; `slope` is |dF/du|, both
    where the network was trained, which is so many of the `samples`."""
    if len(u) < 2:
        return
    low, high = np.quantile(u, [0.25, 0.75])
    middle = float(np.median(slope[(u >= low) & (u <= high)]))
    for sign, side in ((1.0, "above"), (-1.0, "below")):
        order = np.argsort(-sign * u)  # outermost first
        mean = np.cumsum(slope[order]) / np.arange(1, len(u) + 1)
        count = int(np.max(np.flatnonzero(mean < FLAT * middle), initial=-1)) + 1
        level, end = u[order[max(count - 1, 0)]], u[order[0]]
        if count >= BEYOND * samples and sign * (end - level) > BEYOND * np.ptp(u):
            yield (
                f"input {each.name!r} moves on {side} {level:.4g} in {100 * count / samples:.1f} "
                "% of the samples, where the response does not: it looks like the command of a "
                f"saturated actuator; log what was applied, or give min and max in "
                f"[inputs.{each.name}]"
            )


def _reads(expression: Expression, name: str) -> Iterator[tuple[str, int, Node]]:
    """(network, which argument, its expression) wherever `name` is told to a network."""
    for network, calls in networks_used(expression).items():
        for call in calls:
            for k, argument in enumerate(call):
                if name in names_used(Expression("", argument)):
                    yield network, k, argument


def _other_response(
    plant: GrayBoxPlant,
    k: int,
    stretches: Sequence[Stretch],
    rest: Float[np.ndarray, "samples acting"],
    slopes: Float[np.ndarray, "samples acting"],
) -> Iterator[str]:
    """The best of a delay, a lag and a limit, if input `k` run through it explains `rest`."""
    each = plant.signals.inputs[k]
    own = [s.samples.u[:, k] for s in stretches]
    count = sum(len(u) for u in own)
    known = np.concatenate([np.concatenate([s.samples.x, s.samples.u], axis=1) for s in stretches])
    controls = np.concatenate([np.ones((count, 1)), known], axis=1)
    column = 1 + len(plant.signals.states) + k
    settled = np.concatenate([np.arange(len(u)) >= DELAYS[-1] for u in own])
    test = np.arange(count) * BLOCKS // count % 2 == 1
    chosen_on, step = settled & ~test, stretches[0].step
    best = (EXPLAINED, "")
    for rho, slope in zip(rest.T, slopes.T, strict=True):
        halves = [_Left(rho, controls, rows, column) for rows in (chosen_on, settled & test)]
        found = _tried([*_versions(each, np.concatenate(own), step)], own, halves, slope.mean())
        if found.version.late:
            both = _tried([*_behind(each, step)], own, halves, slope.mean())
            if 1 - both.share <= (1 - EXPLAINED) * (1 - found.share):
                found = both
        if found.share >= best[0] and GAINS[0] <= found.ratio <= GAINS[1]:
            best = found.share, _told(each, found.version, found.share)
    if best[1]:
        yield best[1]


def _tried(
    versions: Sequence[_Version],
    own: Sequence[Float[np.ndarray, "_"]],
    halves: Sequence["_Left"],
    gain: float,
) -> _Tried:
    """The version that explains most on the first of `halves`, as it does on the second."""
    choosing, testing = halves

    def moved(version: _Version) -> Float[np.ndarray, "samples"]:
        return np.concatenate([version.of(u) - u for u in own])

    chosen = max(versions, key=lambda version: choosing.explained(moved(version), gain)[0])
    return _Tried(chosen, *testing.explained(moved(chosen), gain))


def _told(each: Input, version: _Version, share: float) -> str:
    """What moves between samples, and has no limits, was measured: no actuator sets it."""
    so = f"{version.words}, which explains {100 * share:.0f} % of what the model leaves"
    if each.hold == "linear" and not (np.isfinite(each.min) or np.isfinite(each.max)):
        return f"the plant follows input {each.name!r} {so}; {version.cure}"
    return (
        f"input {each.name!r} looks like the command, not what was applied: the plant follows "
        f"it {so}; log what the actuator did, or {version.cure}"
    )


def _lagging(u: Float[np.ndarray, "samples"], keep: float) -> Float[np.ndarray, "samples"]:
    """y_k = keep y_(k-1) + (1 - keep) u_k from rest at u_0."""
    bands = np.stack([np.ones(len(u)), np.full(len(u), -keep)])
    return solve_banded((1, 0), bands, (1 - keep) * (u - u[0])) + u[0]


def _late(
    u: Float[np.ndarray, "samples"], samples: int, keep: float
) -> Float[np.ndarray, "samples"]:
    """u so many samples later, then through the lag of `_lagging`."""
    later = np.concatenate([np.repeat(u[:1], samples), u])[: len(u)]
    return _lagging(later, keep) if keep else later


def _versions(each: Input, u: Float[np.ndarray, "samples"], step: float) -> Iterator[_Version]:
    for d in DELAYS:
        yield _Version(
            f"delayed by {d * step:.3g} s",
            f"give delay = {each.delay + d * step:.3g} in [inputs.{each.name}]",
            partial(_late, samples=d, keep=0.0),
        )
    for lag in LAGS:
        yield _Version(
            f"through a lag of {lag * step:.3g} s",
            "add the lag to the plant file as a state",
            partial(_late, samples=0, keep=float(np.exp(-1 / lag))),
        )
    middle = float(np.median(u))
    for side in ("both", "above", "below"):
        away = {"both": np.abs(u - middle), "above": u - middle, "below": middle - u}[side]
        for level in np.quantile(away[away > 0], QUANTILES) if np.any(away > 0) else ():
            low = -np.inf if side == "above" else middle - level
            high = np.inf if side == "below" else middle + level
            ends = [f"{end:.3g}" for end in (low, high) if np.isfinite(end)]
            yield _Version(
                f"only as far as about {' and '.join(ends)}",
                f"give its limits, min and max, in [inputs.{each.name}]",
                lambda u, low=low, high=high: np.clip(u, low, high),
                late=False,
            )


def _behind(each: Input, step: float) -> Iterator[_Version]:
    """Every lag behind every dead time."""
    for d in DELAYS:
        for lag in LAGS:
            yield _Version(
                f"delayed by {d * step:.3g} s and through a lag of {lag * step:.3g} s",
                f"give delay = {each.delay + d * step:.3g} in [inputs.{each.name}] and add the "
                "lag to the plant file as a state",
                partial(_late, samples=d, keep=float(np.exp(-1 / lag))),
            )


class _Left:
    """What `controls` leave of `rho` on `rows`; column `own` of the controls is the input."""

    def __init__(
        self,
        rho: Float[np.ndarray, "samples"],
        controls: Float[np.ndarray, "samples controls"],
        rows: Bool[np.ndarray, "samples"],
        own: int,
    ) -> None:
        self.rows = rows & np.isfinite(rho)  # F may have no value where it was measured
        span, size, back = np.linalg.svd(controls[self.rows], full_matrices=False)
        told = size > len(span) * np.finfo(float).eps * size[0]
        self.span, self.own = span[:, told], back[told, own] / size[told]
        self.rho, self.weight = self._without(rho)

    def _without(self, v: Float[np.ndarray, "samples"]) -> tuple[Float[np.ndarray, "rows"], float]:
        """(v less its least squares by the controls, the input's weight in them)."""
        along = self.span.T @ v[self.rows]
        return v[self.rows] - self.span @ along, float(self.own @ along)

    def explained(self, q: Float[np.ndarray, "samples"], gain: float) -> tuple[float, float]:
        """(share of rho that q explains, g / b), the input's slope in the model being `gain`."""
        left, weight = self._without(q)
        energy, rest = float(left @ left), float(self.rho @ self.rho)
        if energy <= 1e-12 * float(q[self.rows] @ q[self.rows]) or not rest:
            return 0.0, 0.0
        g = float(self.rho @ left) / energy
        acting = gain + self.weight - g * weight
        return g * g * energy / rest, g / acting if acting else 0.0
