"""The smallest safe test input that would tell a fault of a given size.

Steps, pulses and multisines on each input go on from where the log ends, within the actuator's
limits and what training covered; the least amplitude is found by halving. Each is simulated through
the model, healthy and with the fault: what the fault leaves in the healthy filter's innovations,
beside its rival of any size, must reach what a name takes, and so must what was foretold of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer.smallest import apart_size, information_left, seen_size
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.unit_faults import Effects, effects_along, information
from faultgauge.detection.rows.judged import operating_points
from faultgauge.detection.rows.prepared import Prepared, prepared
from faultgauge.excitation.multisine import multisine
from faultgauge.foresight.problems import Problem
from faultgauge.simulation.free_run import free_run, substeps_for
from faultgauge.telemetry import Run

__all__ = ["KINDS", "InputTrials", "Proposal", "Tested", "propose"]

FEWEST, MOST = 60, 1000  # rows of a test
HALVINGS = 8  # of the amplitude's logarithm
SMALLEST = 1e-3  # of what the limits allow
MARGIN = 0.1  # of the training range, that a state may leave it by
BEGINS, ENDS = 0.1, 0.5  # of the test: where a step begins, where a pulse ends


def _step(k: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "rows"]:
    return (k >= BEGINS) * 1.0


def _pulse(k: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "rows"]:
    return ((k >= BEGINS) & (k < ENDS)) * 1.0


def _sines(k: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "rows"]:
    count = len(k)
    x = multisine(np.random.default_rng(0), count, 1.0, 1 / count, 0.1, 1.0)
    return x / np.abs(x).max()


KINDS: dict[str, Callable[[Float[np.ndarray, "rows"]], Float[np.ndarray, "rows"]]] = {
    "step": _step,
    "pulse": _pulse,
    "multisine": _sines,
}


@dataclass(frozen=True)
class Tested:
    """What a test input told: `promised` and `obtained` are the sizes from which on the fault would
    be told, by the linearised filter and by what the simulated fault left; `safe` whether the
    states stayed where training was, healthy and with the fault."""

    promised: float
    obtained: float
    safe: bool

    def reaches(self, size: float) -> bool:
        return self.safe and max(self.promised, self.obtained) <= size


@dataclass(frozen=True)
class Proposal:
    """`amplitude` (signed, beside `base`; peak of a multisine) [`unit`] of a `kind` of test on an
    input, for `seconds` every `step` [s], and what it told."""

    input: str
    kind: str
    amplitude: float
    base: float
    unit: str
    seconds: float
    step: float
    told: Tested


class InputTrials:
    """Simulated tests that go on from the end of a log."""

    def __init__(self, bank: FaultBank, run: Run, effects: Effects) -> None:
        self.bank, self.before = bank, effects
        model, names = bank.model, bank.model.plant.signals.input_names
        self.x = effects.x[-1, : len(model.plant.signals.states)]
        last = [run.columns[n][np.isfinite(run.columns[n])] for n in names]
        self.u = np.array([each[-1] if len(each) else 0.0 for each in last])
        self.rows = int(np.clip(bank.knowledge.memory / bank.step, FEWEST, MOST))
        points = operating_points(model)
        low, high = points.x.min(axis=0), points.x.max(axis=0)
        self.low, self.high = low - MARGIN * (high - low), high + MARGIN * (high - low)
        limits = model.plant.signals.inputs
        self.least = np.maximum(points.u.min(axis=0), [each.min for each in limits])
        self.most = np.minimum(points.u.max(axis=0), [each.max for each in limits])

    def room(self, which: int) -> float:
        """The farthest that an input may go from where it is, signed."""
        up, down = self.most[which] - self.u[which], self.u[which] - self.least[which]
        return float(max(up, 0.0) if up >= down else -max(down, 0.0))

    def shaped(self, which: int, kind: str, amplitude: float) -> Float[np.ndarray, "rows inputs"]:
        """The inputs of a test."""
        u = np.tile(self.u, (self.rows, 1))
        u[:, which] += amplitude * KINDS[kind](np.arange(self.rows) / self.rows)
        return u

    def simulated(
        self, u: Float[np.ndarray, "rows inputs"], f: Float[np.ndarray, "faults"]
    ) -> tuple[Prepared, Float[np.ndarray, "stood states"]]:
        """(the log of a test with constant faults, its states), without noise."""
        bank, signals = self.bank, self.bank.model.plant.signals
        stood = np.concatenate([self.u[None], u])  # from the log's last row on
        dt, faults = np.full(len(stood), bank.step), np.tile(f, (len(stood), 1))
        x, acting, dt, faults = (jnp.asarray(each) for each in (self.x, stood, dt, faults))
        substeps = substeps_for(bank.step, bank.model.max_step)
        found = free_run(bank.model.plant, x, acting, dt, faults, substeps)
        columns = dict(zip(signals.input_names, u.T, strict=True))
        y = np.asarray(found.y)[1:]
        columns |= {n: y[:, signals.output_names.index(n)] for n in bank.outputs}
        t = self.before.t[-1] + bank.step * np.arange(1, len(stood))
        return prepared(signals, Run("test", "test", t, columns)), np.asarray(found.x)

    def told(self, u: Float[np.ndarray, "rows inputs"], problem: Problem) -> Tested:
        """What a test tells of a fault that is there throughout, and was not before."""
        bank, (fault, rival, size) = self.bank, problem
        one = np.eye(len(bank.size))[fault]
        if bank.model.plant.signals.faults[fault].max < size:
            one = -one
        healthy, x = self.simulated(u, 0 * one)
        if not all(self._inside(each) for each in (x, self.simulated(u, size * one)[1])):
            return Tested(np.inf, np.inf, safe=False)
        effects = effects_along(bank, healthy, self.before)
        rows = len(effects.t)
        found = information(effects, 0, [0], [rows - 1])
        theirs, J22 = np.zeros_like(effects.white), 1.0
        left = float(found.own[-1, fault])
        if rival is not None:
            left = float(information_left(found, bank, fault, rival)[-1])
            theirs = found.left[:, :, rival]
            J22 = float(np.sum(theirs**2)) + float(bank.size[rival]) ** -2.0
        promised = self._size(problem, left)
        # the size itself may be so large that the filter takes it for glitches
        f = min(size, promised)
        faulty, _ = self.simulated(u, f * one)
        moved = effects_along(bank, faulty, self.before).white - effects.white
        obtained = float(np.sum(moved**2) - np.sum(moved * theirs) ** 2 / J22) / f**2
        return Tested(promised, self._size(problem, obtained), safe=True)

    def _size(self, problem: Problem, left: float) -> float:
        if left <= 0:
            return np.inf
        sd = 1 / np.sqrt(left)
        if problem.rival is not None:
            return apart_size(sd)
        return seen_size(self.bank, problem.fault, sd, self.rows * self.bank.step)

    def _inside(self, x: Float[np.ndarray, "stood states"]) -> bool:
        return bool(np.all((x >= self.low) & (x <= self.high)))


def propose(bench: InputTrials, problem: Problem) -> Proposal | None:
    """The test that tells a problem's fault with the least share of what its input may do; None
    where none does."""
    signals, best = bench.bank.model.plant.signals, None
    for which, each in enumerate(signals.inputs):
        room = bench.room(which)
        for kind in KINDS if room else ():
            found = _least(bench, problem, which, kind, room)
            if found is not None and (best is None or found[0] < best[0]):
                share, told = found
                best = share, Proposal(
                    each.name, kind, share * room, float(bench.u[which]), each.unit,
                    bench.rows * bench.bank.step, bench.bank.step, told,
                )  # fmt: skip
    return None if best is None else best[1]


def _least(
    bench: InputTrials, problem: Problem, which: int, kind: str, room: float
) -> tuple[float, Tested] | None:
    """(the least share of `room` that tells, what it told): larger is tried where what is larger
    leaves the safe range only."""

    def at(share: float) -> Tested:
        return bench.told(bench.shaped(which, kind, share * room), problem)

    high, told = 1.0, at(1.0)
    while not told.safe and high > SMALLEST:
        high /= 2
        told = at(high)
    if not told.reaches(problem.size):
        return None
    low = SMALLEST
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        tried = at(middle)
        if tried.reaches(problem.size):
            high, told = middle, tried
        else:
            low = middle
    return high, told
