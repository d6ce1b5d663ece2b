"""The bank along one run: from its first sample, over samples, and across gaps.

In a gap of length T nothing is sampled, and what was known goes on: the weights of all branches and
onsets, and faults as they were, the discrepancy as far as it lasts, exp(-T / tau), and constants
but for what they differ between the stretches of a healthy run. The states begin anew from the
samples after the gap. An output that a branch takes for faulty is
corrected by the fault's estimate before it says where its state is, x = y - f, so that a fault
which outlasts the gap fits as well as it did before.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.envelope import applied, outside
from faultgauge.detection.judged import (
    Past,
    Start,
    record_arrays,
    start_from_samples,
    steps_to,
    stretches,
)
from faultgauge.detection.noise import spread_of_start, start_spread
from faultgauge.identification.samples import in_effect
from faultgauge.observers.branching import BranchInfo, Branching, BranchState
from faultgauge.observers.divided_difference import Belief
from faultgauge.observers.follow import follow
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["Course", "Rows", "run_over"]

BLOCK = 4096  # samples in one call
SHOWS = 40.0  # twice the log-odds that outweigh its prior: information of a fault that shows


class Rows(NamedTuple):
    """What the bank says about the samples `part` of a run.

    `p` of every set and last of the unknown, `f` and `sd` of the declared faults in each, `x` the
    posterior mean of [states, discrepancy, directions], `seen` whether a fault of that direction
    (down, up) would show, `onset` how long ago each fault began (mean, standard deviation [s]) and
    the probability that it `ever` was there, `outside` what is not trusted (see `envelope`); `held`
    back after a start or a gap.
    """

    part: slice
    p: Float[np.ndarray, "samples sets"]
    f: Float[np.ndarray, "samples sets faults"]
    sd: Float[np.ndarray, "samples sets faults"]
    x: Float[np.ndarray, "samples extended"]
    seen: Bool[np.ndarray, "samples faults two"]
    onset: Float[np.ndarray, "samples faults two"]
    ever: Float[np.ndarray, "samples faults"]
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
    ) -> tuple[Branching, BranchState]:
        """(the bank, what is known before the first sample)."""
        modes = self.bank.modes
        if past is not None:
            return modes, resumed(self.bank, past, start.x, u, self.columns)
        sd = start_spread(self.model, self.bank.noise, self.columns)
        x = np.concatenate([start.x, np.zeros(len(sd) - len(start.x))])
        return modes, modes.init(*(jnp.asarray(each) for each in (x, sd, u)))

    def samples(self, run: Run, part: slice) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """What the modes' step is given: u, y, dt."""
        u, y = record_arrays(self.model, run, part)
        y[:, [n not in self.bank.outputs for n in self.model.plant.signals.output_names]] = np.nan
        return u, y, steps_to(run.t[part])

    def rows(
        self,
        part: slice,
        said: BranchInfo,
        u: Float[np.ndarray, "samples inputs"],
        since: Float[np.ndarray, "samples"],
        foreseen: Bool[np.ndarray, "samples"],
    ) -> Rows:
        """What the modes said of the samples `part`, `since` [s] the start of their stretch;
        `foreseen` are those that told that start."""
        p, f, sd, x, seen, onset, ever = (np.asarray(each) for each in said)
        states = len(self.model.plant.signals.states)
        acting, driven = applied(self.model, u, p, f)
        out = outside(self.model, self.bank.regions, x[:, :states], u, acting, driven)
        held = (since < self.bank.hold_off) | foreseen
        return Rows(part, p, f, sd, x, seen >= SHOWS, onset, ever, out, held)


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
            yield course.rows(where, info, given[0][block], t[block] - t[0], foreseen)
        last = float(t[-1])


def resumed(
    bank: FaultBank,
    past: Past,
    x: Float[np.ndarray, "states"],
    u: Float[np.ndarray, "inputs"],
    columns: tuple[str, ...],
) -> BranchState:
    """The state after a gap, before the first sample that follows it, where the states are `x`
    if nothing is wrong."""
    state, gap = past.state, past.gap
    states, driven = len(x), len(bank.noise.size)
    before = state.belief.P.shape[-1]
    M = np.eye(before)
    M[:states] = 0.0
    M[:states, before - bank.modes.kinds :] = -_carried(bank)
    fade = np.exp(-gap / bank.noise.lasting)
    M[range(states, states + driven), range(states, states + driven)] = fade
    # what a gap makes anew of the constants
    new = np.zeros(before)
    end = before - bank.modes.kinds
    new[end - len(bank.noise.renewed) : end] = bank.noise.renewed
    M *= np.sqrt(1 - new)[:, None]
    mean = np.asarray(state.belief.mean) @ M.T
    mean[:, :states] += x
    P = M @ np.asarray(state.belief.P) @ M.T
    sd = spread_of_start(bank.model, bank.noise.sigma, columns)[0]
    more = np.concatenate([sd**2, bank.noise.size**2 * (1 - fade**2)])
    P[:, range(states + driven), range(states + driven)] += more
    P += np.diag(new)
    eta = np.einsum("ij,bjka->bika", M, np.asarray(state.lanes.eta))
    return state._replace(
        belief=Belief(jnp.asarray(mean), jnp.asarray(P)),
        lanes=state.lanes._replace(eta=jnp.asarray(eta)),
        probe=state.probe._replace(J=state.probe.J * np.exp(-gap / bank.knowledge.when)[:, None]),
        u=jnp.asarray(u),
        t=state.t + gap,
    )


def _carried(bank: FaultBank) -> Float[np.ndarray, "states kinds"]:
    """How much of every fault stands in the output that measures a state."""
    signals = bank.plant.signals
    found = np.zeros((len(bank.model.plant.signals.states), bank.modes.kinds))
    for k, fault in enumerate(signals.faults):
        if fault.enters == "output" and fault.target in bank.outputs:
            measures = signals.outputs[signals.output_names.index(fault.target)].measures
            if measures is not None:
                found[signals.state_names.index(measures), k] = 1.0
    return found
