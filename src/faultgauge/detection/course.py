"""The bank along one run: from its first sample, over samples, and across gaps.

In a gap of length T nothing is sampled, and what was known goes on as its prior says: the
probabilities by the chain of the modes, p' = p exp(G T), faults and drifting parameters with the
variance of their walk, T more of it. The states begin anew from the samples after the gap. An
output that a mode takes for faulty is corrected by the fault's estimate before it says where its
state is, x = y - f, so that a fault which outlasts the gap fits as well as it did before.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.linalg import expm

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.envelope import applied, inside
from faultgauge.detection.judged import (
    Past,
    Start,
    operating_points,
    record_arrays,
    start_from_samples,
    steps_to,
    stretches,
)
from faultgauge.detection.levels import driven
from faultgauge.detection.noise import spread_of_start
from faultgauge.identification.samples import in_effect
from faultgauge.observers.follow import follow
from faultgauge.observers.interacting import FLOOR, BankInfo, BankState, InteractingModes, cholesky
from faultgauge.observers.modes import with_unknown
from faultgauge.observers.sigma_point import Belief
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant
from faultgauge.telemetry import Run

__all__ = ["AT_START", "Course", "Rows", "run_over"]

BLOCK = 4096  # samples in one call
AT_START = 1e-3  # probability that a given fault is there when a log begins, at most


class Rows(NamedTuple):
    """What the bank over the run's `plant` says about the samples `part` of a run.

    `p` of every mode, `f` and `sd` of its fault slots, `x` the posterior mean of [states,
    drifting parameters], `seen` whether a fault of that direction (down, up) would show,
    `outside` what of the training envelope: 0 nothing, 1 the range of a state or an input, 2 and
    more the region of a network; `held` back after a start or a gap.
    """

    plant: Plant
    part: slice
    p: Float[np.ndarray, "samples modes"]
    f: Float[np.ndarray, "samples modes slots"]
    sd: Float[np.ndarray, "samples modes slots"]
    x: Float[np.ndarray, "samples kept"]
    seen: Bool[np.ndarray, "samples faults two"]
    outside: Int[np.ndarray, "samples"]
    held: Bool[np.ndarray, "samples"]


@dataclass(frozen=True)
class Course:
    """The bank as it runs along one log with these `columns`, stretch by stretch."""

    bank: FaultBank
    columns: tuple[str, ...]

    @property
    def model(self) -> Model:
        return self.bank.model

    @property
    def names(self) -> tuple[str, ...]:
        """The columns that a stretch must have sampled."""
        return self.model.plant.signals.input_names or self.bank.outputs

    @property
    def opening(self) -> tuple[str, ...]:
        """The columns that its first sample must have."""
        return self.bank.outputs

    def begin(
        self, start: Start, u: Float[np.ndarray, "inputs"], past: Past | None = None
    ) -> tuple[InteractingModes, BankState]:
        """(the modes over the run's own plant, what is known before the first sample).

        After a gap the run's own parameters stay: those of a stretch would take up its faults.
        """
        if past is None:
            plant = driven(replace(self.model, plant=start.plant))
            modes = eqx.tree_at(lambda each: each.plant, self.bank.modes, plant)
            return modes, first_state(self.bank, modes, start.x, u, self.columns)
        return past.judge, resumed(self.bank, past, start.x, u, self.columns)

    def samples(self, run: Run, part: slice) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """What the modes' step is given: u, y, dt."""
        u, y = record_arrays(self.model, run, part)
        y[:, [n not in self.bank.outputs for n in self.model.plant.signals.output_names]] = np.nan
        return u, y, steps_to(run.t[part])

    def rows(
        self,
        plant: Plant,
        part: slice,
        said: BankInfo,
        u: Float[np.ndarray, "samples inputs"],
        since: Float[np.ndarray, "samples"],
        foreseen: Bool[np.ndarray, "samples"],
    ) -> Rows:
        """What the modes said of the samples `part`, `since` [s] the start of their stretch;
        `foreseen` are those that told that start."""
        p, f, sd, x, seen = (np.asarray(each) for each in said)
        points = operating_points(self.model)
        trusted = inside(points.x[:, self.bank.read], x[:, : points.x.shape[1]][:, self.bank.read])
        acting, driven = applied(self.model, self.bank.sets, u, p, f)
        trusted &= inside(points.u, u) | inside(points.u, acting)
        outside = np.where(trusted, 0, 1)
        states = x[:, : points.x.shape[1]]
        for k, region in enumerate(self.bank.regions, 2):
            out = np.flatnonzero(~region.holds(states, u, np.zeros_like(driven)) & (outside == 0))
            if len(out):
                out = out[~region.holds(states[out], acting[out], driven[out])]
            outside[out] = k
        held = (since < self.bank.hold_off) | foreseen
        would = (seen >= 1.0) | (np.asarray(self.bank.modes.probes) == 0.0)
        return Rows(plant, part, p, f, sd, x, would, outside, held)


def run_over(bank: FaultBank, log: Run) -> Iterator[Rows]:
    """Blocks of samples in order; what lies between them was not sampled."""
    run = in_effect(bank.model.plant.signals, log)
    course = Course(bank, tuple(run.columns))
    modes, state, last = bank.modes, None, 0.0
    for part in stretches(run, course.names, course.opening):
        start = start_from_samples(bank.model, run, part)
        t, given = run.t[part], course.samples(run, part)
        past = None if state is None else Past(modes, state, float(t[0] - last))
        modes, state = course.begin(start, given[0][0], past)
        for first in range(0, len(t), BLOCK):
            block = slice(first, min(first + BLOCK, len(t)))
            state, info = follow(modes, state, [each[block] for each in given])
            foreseen = np.arange(block.start, block.stop) < start.samples
            where = slice(part.start + block.start, part.start + block.stop)
            yield course.rows(modes.plant, where, info, given[0][block], t[block] - t[0], foreseen)
        last = float(t[-1])


def first_state(
    bank: FaultBank,
    modes: InteractingModes,
    x: Float[np.ndarray, "states"],
    u: Float[np.ndarray, "inputs"],
    columns: tuple[str, ...],
) -> BankState:
    """What is known when a log begins."""
    sd, drifted = spread_of_start(bank.model, bank.noise, columns)
    single = np.minimum(bank.levels.onset * 3600, AT_START)
    unknown = np.minimum(bank.levels.unknown * 3600, AT_START)
    declared = [float(np.prod(single[list(each)])) for each in bank.sets]
    p = np.concatenate([declared, unknown])
    p[0] = 1 - p[1:].sum()
    return modes.init(*(jnp.asarray(each) for each in (x, sd, drifted, u, p)))


def resumed(
    bank: FaultBank,
    past: Past,
    x: Float[np.ndarray, "states"],
    u: Float[np.ndarray, "inputs"],
    columns: tuple[str, ...],
) -> BankState:
    """The state after a gap, before the first sample that follows it, where the states are `x`
    if nothing is wrong."""
    modes, state, gap = past
    states = len(x)
    p = np.maximum(np.asarray(state.p) @ expm(_generator(modes) * gap), FLOOR)
    mixed = _mixed(modes, state, jnp.asarray(gap))
    rest = np.asarray(mixed.mean)[:, states:]
    root = np.asarray(mixed.root)[:, states:]
    P = root @ root.transpose(0, 2, 1)
    walk = np.asarray(modes.hypothesis.walk)
    P += gap * np.einsum("mi,ij->mij", walk**2, np.eye(walk.shape[1]))
    carried = _carried(bank)
    sd = spread_of_start(bank.model, bank.noise, columns)[0]
    mean = np.concatenate([x - np.einsum("mxr,mr->mx", carried, rest), rest], axis=1)
    into = np.concatenate([-carried, np.broadcast_to(np.eye(rest.shape[1]), P.shape)], axis=1)
    P = into @ P @ into.transpose(0, 2, 1)
    P[:, range(states), range(states)] += sd**2
    found = Belief(jnp.asarray(mean), jax.vmap(cholesky)(jnp.asarray(P)))
    seen = state.seen * jnp.exp(-gap / modes.memory)
    shift = jnp.zeros_like(state.shift)
    return BankState(jnp.asarray(p / p.sum()), found, jnp.asarray(u), shift, seen)


@eqx.filter_jit
def _mixed(modes: InteractingModes, state: BankState, gap: Float[Array, ""]) -> Belief:
    return modes.mix(state.p, state.belief, gap)[1]


def _generator(modes: InteractingModes) -> Float[np.ndarray, "modes modes"]:
    """G of the chain of modes: G[i, j] the rate [1/s] from i to j, rows summing to 0."""
    source, rate = np.asarray(modes.links.source), np.asarray(modes.links.rate)
    G = np.zeros((len(source), len(source)))
    target = np.repeat(np.arange(len(source))[:, None], source.shape[1] - 1, axis=1)
    np.add.at(G, (source[:, 1:], target), rate[:, 1:])
    return G - np.diag(G.sum(axis=1))


def _carried(bank: FaultBank) -> Float[np.ndarray, "modes states rest"]:
    """How much of every [drifting parameter, fault slot] of a mode stands in the output that
    measures a state."""
    signals = bank.model.plant.signals
    drifting, slots = len(bank.modes.drifting), bank.modes.hypothesis.select.shape[-1]
    everyone = with_unknown(bank.sets, bank.levels)
    found = np.zeros((len(everyone), len(signals.states), drifting + slots))
    for m, each in enumerate(everyone):
        for slot, k in enumerate(each):
            fault = signals.faults[k] if k < len(signals.faults) else None
            if fault is None or fault.enters != "output" or fault.target not in bank.outputs:
                continue
            measures = signals.outputs[signals.output_names.index(fault.target)].measures
            if measures is not None:
                found[m, signals.state_names.index(measures), drifting + slot] = 1.0
    return found
