"""Single samples that nothing explains: counted and named, for they move nothing.

An update with the noise as it was found leaves of an innovation e = y - h, of variance S = P + R,
the part e R / S. What is no more than `FAR` sqrt(S) off leaves at most FAR sqrt(R), and what is
further off had its noise raised (`divided_difference`) and stays off. A glitch is a sample that
does between two that do not, and does not change what is told. A sensor's fault begins like one,
or jumps, and stays; what process noise may explain is none.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.extended import sampled_within
from faultgauge.detection.posterior.posterior import Posterior
from faultgauge.observers.divided_difference import FAR
from faultgauge.plants.disturbed import Disturbed
from faultgauge.plants.plant import respond
from faultgauge.programs import program
from faultgauge.simulation.free_run import bucket
from faultgauge.telemetry import Run

__all__ = ["Glitch", "Glitches"]

OTHER = 0.5  # of a cause's probability, by which what is told changes
SMALL = 0.1  # of a glitch: what its neighbours may be off, where faults are undecided


class Glitch(NamedTuple):
    """A sample at `t` [s] that nothing explains."""

    output: str
    t: float
    value: float


class _Samples(NamedTuple):
    """Those of one output: `p` of every cause after it, `x` the states, and `u` and `f`, which it
    was predicted with."""

    t: Float[np.ndarray, "samples"]
    y: Float[np.ndarray, "samples"]
    p: Float[np.ndarray, "samples causes"]
    x: Float[np.ndarray, "samples extended"]
    u: Float[np.ndarray, "samples inputs"]
    f: Float[np.ndarray, "samples faults"]


class Glitches:
    """Of one run or stream; each is known once its output is sampled again."""

    def __init__(self, bank: FaultBank) -> None:
        self.bank = bank
        self.limit = FAR * sampled_within(bank.model, bank.noise)
        self.last: dict[int, _Samples] = {}

    def push(self, rows: Run, found: Posterior) -> list[Glitch]:
        """What is known now that the next `rows` were judged; outputs in them that are no
        measurement are NaN."""
        signals, known = self.bank.model.plant.signals, list[Glitch]()
        p = np.nan_to_num(np.concatenate([found.p, found.unknown[:, None]], axis=1))
        undeclared = self.bank.modes.filter.faults - found.f.shape[1]
        f = np.pad(np.nan_to_num(found.f), ((0, 0), (0, undeclared)))
        u = np.zeros((len(rows.t), 0))
        if signals.inputs:
            u = np.stack([rows.columns[name] for name in signals.input_names], axis=1)
        for j, name in enumerate(signals.output_names):
            if name not in self.bank.outputs:
                continue
            y = rows.own(name)
            at = np.isfinite(y) & np.isfinite(found.healthy)
            each = _Samples(*(a[at] for a in (rows.t, y, p, found.x, u, f)))
            if j in self.last:
                each = _Samples(*map(_joined, self.last[j], each))
            self.last[j] = _Samples(*(a[-2:] for a in each))
            known += [Glitch(name, *(float(a[k]) for a in each[:2])) for k in self._alone(each, j)]
        return sorted(known, key=lambda glitch: glitch.t)

    def _alone(self, each: _Samples, j: int) -> list[int]:
        """The places of glitches."""
        steps = np.diff(each.y)
        jumps = np.sign(steps) * (np.abs(steps) > self.limit[j])
        changed = np.abs(each.p[2:] - each.p[:-2]).max(axis=1, initial=0.0) > OTHER
        peaks = 1 + np.flatnonzero((jumps[:-1] * jumps[1:] < 0) & ~changed)
        if not len(peaks):  # nearly always: nothing is compiled then
            return []
        before, off, after = (self._off(each, j, peaks + k) for k in (-1, 0, 1))
        near = np.maximum(before, after) <= np.maximum(self.limit[j], SMALL * off)
        # a fault that jumped to another size is known by the next sample
        left = np.minimum(off, self._off(each, j, peaks, later=1))
        return peaks[near & (left > self.limit[j])].tolist()

    def _off(
        self, each: _Samples, j: int, at: Int[np.ndarray, "some"], later: int = 0
    ) -> Float[np.ndarray, "some"]:
        """How far samples are off what is believed after them, with the faults as they are believed
        to be so many samples `later`."""
        padded = np.pad(at, (0, bucket(len(at)) - len(at)), mode="edge")
        given = each.x[padded], each.u[padded], each.f[padded + later]
        predicted = _outputs(self.bank.plant, *map(jax.device_put, given))
        return np.abs(each.y[at] - np.asarray(predicted)[: len(at), j])


@program
def _outputs(
    plant: Disturbed,
    x: Float[Array, "some extended"],
    u: Float[Array, "some inputs"],
    f: Float[Array, "some faults"],
) -> Float[Array, "some outputs"]:
    return jax.vmap(lambda *each: respond(plant, *each)[1])(x, u, f)


def _joined(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return np.concatenate([before, after])
