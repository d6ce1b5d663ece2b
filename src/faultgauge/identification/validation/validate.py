"""All tests of a model on free runs over data that it was not fitted to."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.special import stdtrit

from faultgauge.identification.samples import Samples
from faultgauge.identification.validation.band import Band, free_run_band, given_band
from faultgauge.identification.validation.correlation import (
    InputTest,
    ResidualTest,
    input_test,
    residual_test,
)
from faultgauge.identification.validation.evaluation import Prediction
from faultgauge.identification.validation.operating import Profile, profile
from faultgauge.identification.validation.ranges import Range, argument_ranges
from faultgauge.identification.validation.seeds import SeedSpread, seed_spread
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Output, Signals

__all__ = ["OutputValidation", "Validation", "errors_of", "tested", "validate"]

SAME_STEP = 0.01  # stretches sampled this much alike, relative, share their lags
FEWEST_SAMPLES = 20  # that are worth a statistic

Parts = Sequence[Float[np.ndarray, "_"]]


@dataclass(frozen=True)
class OutputValidation:
    """The tests of one output; `bias` and `rmse` are of e = measured - predicted, in its unit.

    Where the free run diverges, or fewer than 20 samples are scored, only the counts stand.

    Attributes:
        name: the output.
        unit: its unit as declared.
        samples: scored; empty cells are not.
        stretches: that they come from, without a gap in time or inputs.
        diverges: whether a free run leaves the finite numbers.
        rmse: root mean square of e.
        nrmse: that over the standard deviation of the output; None where it does not change.
        bias: mean of e.
        bias_95: half width of that mean's 95 % interval (Student, independent samples).
        time_s: integrated autocorrelation time of e, s.
        independent: what the samples are worth, N / tau with tau of those that are there.
        band: the 95 % band of the free-run error.
        residual: autocorrelation of e.
        inputs: correlation of e with every input that moves.
        profiles: e against every state and input.
        seeds: spread over models fitted with other seeds; None where there are none.
    """

    name: str
    unit: str
    samples: int
    stretches: int
    diverges: bool
    rmse: float | None = None
    nrmse: float | None = None
    bias: float | None = None
    bias_95: float | None = None
    time_s: float | None = None
    independent: float | None = None
    band: Band | None = None
    residual: ResidualTest | None = None
    inputs: tuple[InputTest, ...] = ()
    profiles: tuple[Profile, ...] = ()
    seeds: SeedSpread | None = None


@dataclass(frozen=True)
class Validation:
    """All outputs that have telemetry, and where the unseen data lie against training."""

    outputs: tuple[OutputValidation, ...]
    ranges: tuple[Range, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON; what is not finite becomes None."""
        return _plain(asdict(self))


def validate(
    plant: GrayBoxPlant,
    predictions: Sequence[Prediction],
    training: Samples,
    others: Sequence[Sequence[Prediction]] = (),
    band: Mapping[str, float] | None = None,
) -> Validation:
    """Judge `plant` by its free runs on unseen data.

    `training` are the points that it was fitted on; `others` are free runs of models fitted with
    other seeds over the same stretches. `band` gives, per output, the half width of a 95 % band
    found on other data; without it the unseen runs are held against each other.
    """
    signals, found = plant.signals, []
    for j, output in enumerate(signals.outputs):
        if not any(np.isfinite(p.measured[:, j]).any() for p in predictions):
            continue
        width = None if band is None else band.get(output.name)
        found.append(_output(signals, output, j, predictions, others, width))
    return Validation(tuple(found), argument_ranges(plant, training, predictions))


def errors_of(p: Prediction, output: int) -> Float[np.ndarray, "scored"]:
    """e = measured - predicted of one output after the warm-up; NaN where it was not sampled."""
    return (p.measured[:, output] - p.predicted[:, output])[p.warmup :]


def tested(predictions: Sequence[Prediction], output: int) -> list[int]:
    """The free runs in which an output was sampled twice at least, after the warm-up."""
    cells = [np.isfinite(p.measured[p.warmup :, output]) for p in predictions]
    return [k for k, each in enumerate(cells) if np.sum(each) > 1]


def _output(
    signals: Signals,
    output: Output,
    j: int,
    predictions: Sequence[Prediction],
    others: Sequence[Sequence[Prediction]],
    half_width: float | None,
) -> OutputValidation:
    index = tested(predictions, j)
    parts = [predictions[k] for k in index]
    rows = [p.warmup + np.flatnonzero(np.isfinite(p.measured[p.warmup :, j])) for p in parts]

    def sampled(arrays: Sequence[np.ndarray]) -> np.ndarray:
        return np.concatenate([a[r] for a, r in zip(arrays, rows, strict=True)])

    errors = [(p.measured - p.predicted)[r, j] for p, r in zip(parts, rows, strict=True)]
    whole = np.concatenate([*errors, np.zeros(0)])
    diverges = not np.isfinite(whole).all()
    counts = (output.name, output.unit, len(whole), len(parts), diverges)
    if diverges or len(whole) < FEWEST_SAMPLES:
        return OutputValidation(*counts)
    grids = [_own_grid(each) for each in rows]
    alike, step = _alike([p.t[grid] for p, grid in zip(parts, grids, strict=True)])
    usual = [(parts[k].measured - parts[k].predicted)[grids[k], j] for k in alike]
    inputs = [parts[k].u[grids[k]] for k in alike]
    residual, time = residual_test(usual, step)
    independent = len(whole) / time
    measured = sampled([p.measured[:, j] for p in parts])
    spread, rmse = float(np.std(measured)), float(np.sqrt(np.mean(whole**2)))
    runs = [predictions, *others]
    free_runs = [sampled([run[k].predicted[:, j] for k in index]) for run in runs]
    times = [p.t[r] - p.t[0] for p, r in zip(parts, rows, strict=True)]
    return OutputValidation(
        *counts,
        rmse=rmse,
        nrmse=rmse / spread if spread > 0 else None,
        bias=float(np.mean(whole)),
        bias_95=float(np.std(whole) * -stdtrit(max(independent - 1.0, 1.0), 0.025))
        / np.sqrt(independent),
        time_s=time * step / float(np.mean(np.isfinite(np.concatenate(usual)))),
        independent=independent,
        band=_band(times, errors, usual, step, half_width),
        residual=residual,
        inputs=_inputs(signals, inputs, usual, step, time),
        profiles=_profiles(
            signals, sampled([p.x for p in parts]), sampled([p.u for p in parts]), whole, time
        ),
        seeds=seed_spread(measured, free_runs) if others else None,
    )


def _inputs(
    signals: Signals,
    inputs: Sequence[Float[np.ndarray, "_ inputs"]],
    errors: Parts,
    step: float,
    time: float,
) -> tuple[InputTest, ...]:
    tests = [
        input_test(name, errors, [u[:, i] for u in inputs], step, time)
        for i, name in enumerate(signals.input_names)
    ]
    return tuple(test for test in tests if test is not None)


def _band(times: Parts, errors: Parts, alike: Parts, step: float, half_width: float | None) -> Band:
    _, time = residual_test([np.abs(e) for e in alike], step)
    if half_width is None:
        return free_run_band(times, errors, time)
    return given_band(times, errors, time, half_width)


def _own_grid(rows: Int[np.ndarray, "_"]) -> slice:
    """Every so many-th row, from the first on: lags of a sensor that is slower than the log."""
    return slice(rows[0], rows[-1] + 1, int(np.median(np.diff(rows))))


def _alike(times: Parts) -> tuple[list[int], float]:
    """The stretches with the most usual sampling time, and that time, s."""
    steps = np.array([np.median(np.diff(t)) for t in times])
    weights = np.array([len(t) for t in times])
    near = np.abs(steps[:, None] / steps - 1.0) < SAME_STEP
    usual = int(np.argmax(near @ weights))
    return np.flatnonzero(near[usual]).tolist(), float(steps[usual])


def _profiles(
    signals: Signals,
    x: Float[np.ndarray, "samples states"],
    u: Float[np.ndarray, "samples inputs"],
    errors: Float[np.ndarray, "samples"],
    time: float,
) -> tuple[Profile, ...]:
    quantities = [*zip(signals.states, x.T, strict=True), *zip(signals.inputs, u.T, strict=True)]
    return tuple(
        profile(signal.name, signal.unit, values, errors, time)
        for signal, values in quantities
        if np.isfinite(values).all()
    )


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    match value:
        case dict():
            return {key: _plain(each) for key, each in value.items()}
        case list() | tuple():
            return [_plain(each) for each in value]
        case float() if not math.isfinite(value):
            return None
        case _:
            return value
