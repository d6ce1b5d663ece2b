"""A model's observers, one per fault, and how a log becomes what they read."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.remember import once
from faultgauge.detection.rows.prepared import Prepared, StretchStart
from faultgauge.errors import InputError
from faultgauge.identification.validation.evaluation import WARMUP, start_of_run, varying_parameters
from faultgauge.observers import OBSERVERS, Design
from faultgauge.observers.beside import Beside, States
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import bucket, pad, substeps_for
from faultgauge.telemetry import Run, segments

__all__ = [
    "Bank",
    "bandwidth_of",
    "build_bank",
    "check_observer",
    "measured_outputs",
    "operating_points",
    "pad_stretch",
    "rows_between",
    "samples_to_start",
    "start_from_samples",
    "steps_to",
    "stretches",
]

SAMPLES_PER_RADIAN = 10.0  # default bandwidth: omega_o dt = 0.1
SETTLING = 5.0  # hold-off after a start, in units of 1 / omega_o
START_SAMPLES = 20  # whose slopes are the first rates of measured states


@dataclass(frozen=True)
class Bank:
    """One observer per fault that can be estimated, designed for one sample time."""

    model: Model
    designs: dict[str, Design]
    refused: dict[str, str]
    bandwidth: float
    step: float

    @property
    def names(self) -> tuple[str, ...]:
        """The columns that a stretch must have sampled."""
        outputs = (design.output for design in self.designs.values())
        return tuple(dict.fromkeys([*self.model.plant.signals.input_names, *outputs]))

    @property
    def opening(self) -> tuple[str, ...]:
        """The columns that its first sample must have."""
        return self.names

    def begin(self, start: "StretchStart", u: Float[np.ndarray, "inputs"]) -> tuple[Beside, States]:
        """(all observers over the run's own plant, their first states)."""
        judge = Beside.of(self.designs).on(start.plant)
        return judge, judge.init(start.x, u)

    def samples(self, rows: Prepared) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """What the observers' step is given: u, y, dt."""
        return rows.u, rows.y, steps_to(rows.run.t)

    def has_settled(self, since: Float[np.ndarray, "*samples"]) -> Bool[np.ndarray, "*samples"]:
        """Whether the hold-off is over `since` [s] the start of a stretch."""
        return since >= SETTLING / self.bandwidth


@once
def operating_points(model: Model) -> OperatingPoints:
    """The points of the training envelope that the model file keeps."""
    points = np.asarray(model.record.envelope_points, float)
    states = len(model.plant.signals.states)
    return OperatingPoints(points[:, :states], points[:, states:])


def measured_outputs(model: Model, runs: Sequence[Run]) -> tuple[str, ...]:
    """Outputs with a column in every run, limited to `[observer] outputs` where given."""
    signals = model.plant.signals
    wanted = signals.observation.outputs or signals.output_names
    found = tuple(n for n in wanted if all(n in run.columns for run in runs))
    if not found:
        raise InputError(
            f"{runs[0].source}: no column for any of the outputs {', '.join(wanted)}; name one "
            "with --map OUTPUT=EXPRESSION."
        )
    return found


def rows_between(runs: Sequence[Run], output: str) -> int:
    """How many rows it is from sample to sample of `output` in `runs`: 1 but for slow sensors."""
    return int(
        np.median([run.rows_per_sample(output) for run in runs if output in run.columns] or [1])
    )


def bandwidth_of(model: Model, step: float) -> float:
    """`[observer] bandwidth`, or omega_o dt = 0.1 where the plant file gives none."""
    return model.plant.signals.observation.bandwidth or 1.0 / (SAMPLES_PER_RADIAN * step)


def check_observer(name: str) -> None:
    """Raises `InputError` for a `name` that is no observer."""
    if name not in OBSERVERS:
        raise InputError(f"unknown observer {name!r}; legal: {', '.join(OBSERVERS)}, bank.")


def build_bank(model: Model, runs: Sequence[Run], observer: str = "eso") -> Bank:
    """Design an observer for every declared fault that is not disabled.

    A fault that the observer cannot estimate is refused by name; the call fails when none is
    left. Raises `InputError` for a bandwidth that is unstable somewhere in the envelope, with
    one that is not.
    """
    check_observer(observer)
    step = float(np.median([run.step for run in runs]))
    bandwidth = bandwidth_of(model, step)
    measured = measured_outputs(model, runs)
    points = operating_points(model)
    designs: dict[str, Design] = {}
    refused: dict[str, str] = {}

    def design(fault: str, omega: float, dt: float) -> Design:
        return OBSERVERS[observer](model.plant, fault, points, dt, omega, measured, model.max_step)

    for fault in [f.name for f in model.plant.signals.faults if f.monitor != "disabled"]:
        try:
            designs[fault] = design(fault, bandwidth, step)
        except InputError as refusal:
            refused[fault] = str(refusal)
    # A slow sensor corrects at its own samples, over the rows between which the model predicts.
    every = {fault: step * rows_between(runs, d.output) for fault, d in designs.items()}
    if max(every.values(), default=step) > step:
        bandwidth = bandwidth_of(model, max(every.values()))
        substeps = substeps_for(step, model.max_step)
        for fault, dt in every.items():
            found = design(fault, bandwidth, dt)
            designs[fault] = found._replace(observer=replace(found.observer, substeps=substeps))
    for fault, dt in every.items():
        if designs[fault].radius >= 1:
            stable = [
                w for w in bandwidth * 2.0 ** np.arange(-6, 7) if design(fault, w, dt).radius < 1
            ]
            advice = (
                f"bandwidths that are: {', '.join(f'{w:.3g}' for w in stable)} rad/s"
                if stable
                else "none between 1/64 and 64 times it is; measure another state"
            )
            raise InputError(
                f"[observer] bandwidth = {bandwidth:g} rad/s at {dt:g} s per sample is not "
                f"stable over the whole training envelope for fault {fault!r}; {advice}."
            )
    if refused and not designs:
        raise InputError(next(iter(refused.values())))
    return Bank(model, designs, refused, bandwidth, step)


def stretches(run: Run, names: Sequence[str], opening: Sequence[str]) -> Iterator[slice]:
    """Stretches of `run` with `names` sampled throughout, each from its first sample with all of
    `opening`; where slow sensors are never sampled together, from where all are under way."""
    for each in segments(run, names):
        alive = np.all([np.isfinite(run.columns[n][each]) for n in opening], axis=0)
        complete = np.all([np.isfinite(run.own(n)[each]) for n in opening], axis=0)
        found = np.flatnonzero(complete if complete.any() else alive)
        if len(found) and each.stop - each.start - found[0] >= 2:
            yield slice(each.start + int(found[0]), each.stop)


def samples_to_start(model: Model, columns: Collection[str]) -> int:
    """How many samples of a stretch `start_from_samples` looks at."""
    sources = model.record.columns.states
    if varying_parameters(model.plant).parameters or any(c not in columns for c, _ in sources):
        return WARMUP
    return START_SAMPLES if any(order for _, order in sources) else 1


def start_from_samples(model: Model, stretch: Prepared) -> StretchStart:
    """State at a stretch's first sample: as measured, derivatives of measured ones as slopes of
    the first 20, and the rest by the least error of a free run through the first 50. Found once
    for all that starts there."""
    key = float(stretch.run.t[0]), min(len(stretch.u), WARMUP)
    known = stretch.starts.get(key)
    if known is None or known.model is not model:
        known = stretch.starts[key] = _start(model, stretch)
    return known


def _start(model: Model, stretch: Prepared) -> StretchStart:
    signals, run = model.plant.signals, stretch.run
    t = run.t[:START_SAMPLES] - run.t[0]
    known = {}
    for state, (column, order) in zip(
        signals.state_names, model.record.columns.states, strict=True
    ):
        if column not in run.columns:
            continue
        if order == 0:
            known[state] = float(run.columns[column][0])
        else:
            values = run.own(column)[:START_SAMPLES]
            at = np.isfinite(values)
            degree = min(order + 1, max(int(at.sum()) - 1, 0))
            slopes = np.polynomial.polynomial.polyfit(t[at], values[at], degree)
            padded = np.append(slopes, np.zeros(order))
            known[state] = float(padded[order] * np.prod(np.arange(1, order + 1)))
    first = slice(0, WARMUP)
    samples = run.t[first], stretch.u[first], stretch.y[first]
    plant, x = start_of_run(model.plant, *samples, known, model.max_step, model.record.between)
    solved = plant is not model.plant or len(known) < len(signals.states)
    return StretchStart(model, plant, x, min(WARMUP, len(run.t)) if solved else 0)


def steps_to(t: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """Seconds from the sample before to each; 0 to the first."""
    return np.diff(t, prepend=t[:1])


def pad_stretch(
    u: Float[np.ndarray, "samples inputs"],
    y: Float[np.ndarray, "samples outputs"],
    t: Float[np.ndarray, "samples"],
    least: int = 0,
) -> tuple[
    Float[np.ndarray, "padded inputs"],
    Float[np.ndarray, "padded outputs"],
    Float[np.ndarray, "padded"],
]:
    """(u, y, dt) at the length of a bucket, of `least` samples or more; nothing is sampled in what
    was added."""
    length = bucket(max(len(t), least))
    dt = np.zeros(length)
    dt[1 : len(t)] = np.diff(t)
    padded = np.concatenate([y, np.full((length - len(t), y.shape[1]), np.nan)])
    return pad(u, length), padded, dt
