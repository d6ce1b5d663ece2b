"""`read`: logs as a plant or a model needs them. The command line reads its logs here, too."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Unpack

from faultgauge.detection.words import listed
from faultgauge.errors import InputError
from faultgauge.identification.samples import column_names, jumping
from faultgauge.plants.model import Model
from faultgauge.plants.spec import PlantSpec
from faultgauge.telemetry import Run, read_telemetry
from faultgauge.telemetry.logs import Before, Source
from faultgauge.telemetry.other_clock import other_clock
from faultgauge.telemetry.other_range import other_range
from faultgauge.telemetry.readers.frames import is_frame, read_frame
from faultgauge.telemetry.reading import at_rate
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import plant as as_plant

__all__ = [
    "Runs",
    "read",
    "runs_alone",
    "runs_for_model",
    "runs_for_plant",
    "said_before",
    "unlike_warnings",
]

LEGAL = (
    "a log is a path, a data frame (pandas, Polars, PyArrow), a dict of arrays, runs that "
    "`faultgauge.read` gave, or a list of them"
)


class Runs(list[Run]):
    """Runs, and the `sources` that they were read from, and `how`."""

    def __init__(self, runs: Iterable[Run], sources: Sequence[Source], how: How) -> None:
        super().__init__(runs)
        self.sources, self.how = list(sources), how

    def __repr__(self) -> str:
        told = [f"{run.name}: {len(run.t)} rows of {', '.join(run.columns)}" for run in self[:3]]
        text = "; ".join(told)[:120]
        return f"<{len(self)} run{'' if len(self) == 1 else 's'}: {text}>"


@reads
def read(sources: Any, plant: Any = None, **reading: Unpack[Reading]) -> Runs:
    """Read logs into runs.

    **Arguments**

    - `sources`: a path (a folder stands for the logs in it, `log.xlsx#SHEET` for one sheet), a data
      frame (pandas, Polars, PyArrow, ...), a dict of arrays, or a list of them. A frame's run is
      called `table`, the next `table#2`.
    - `plant`: what the logs are for, a plant (file, preset, text, dict) or a fitted model: it says
      which columns are needed, in which units, which of them are held between samples, and a model
      at which rate. Without one all number columns are taken, and all are smooth. What was said at
      the fit of a model (`time`, `time_format`, `map`) holds for logs that have those columns, too.
    - `time`: the time column, `t` by default: seconds or timestamps.
    - `time_format`: how timestamps are written that are neither ISO 8601 nor day.month.year, as
      `strptime` has it: `"%d/%m/%Y %H:%M:%S"`.
    - `map`: signals made from columns: `"h=wheel_rpm*0.1"`, a list of such, or `{"h": "..."}`.
    - `where`: a condition; only rows that meet it are kept.
    - `resample`: a rate [Hz] that the logs are brought to, anti-aliased.

    Returns the runs, a list. Raises `InputError` for a log that cannot be read or is not what the
    plant needs, naming file, column and row.
    """
    how = How(**reading)
    if plant is None:
        return runs_alone(sources, how)
    if isinstance(plant, Model):
        return runs_for_model(plant, sources, how)
    return runs_for_plant(as_plant(plant).spec, sources, how, fitting=True)


def runs_alone(given: Any, how: How) -> Runs:
    """The runs in `given` with every column of numbers; what are runs already stays as it is."""
    known = _known(given, how)
    if known is not None:
        return known
    sources = _sources(given)
    runs = read_telemetry(
        sources,
        time=how.time,
        maps=how.maps,
        where=how.where,
        resample=how.resample,
        time_format=how.time_format,
    )
    return Runs(runs, sources, how)


def runs_for_plant(
    spec: PlantSpec,
    given: Any,
    how: How,
    *,
    fitting: bool = False,
    slower: Literal["refuse", "keep"] = "refuse",
    before: Before | None = None,
) -> Runs:
    """The runs in `given` with the columns that a plant reads, at the rate that `how` says;
    `fitting`, with its instruments too; what `how` leaves open may have been said `before`. What
    are runs already stays as it is."""
    known = _known(given, how)
    if known is not None:
        return known
    signals, sources = spec.signals, _sources(given)
    required, optional = column_names(signals)
    runs = read_telemetry(
        sources,
        time=how.time,
        maps=how.maps,
        names=required,
        optional=[*optional, *(signals.instruments if fitting else ())],
        held=_held(spec),
        where=how.where,
        units=signals.units,
        resample=how.resample,
        averaged=jumping(spec),
        slower=slower,
        time_format=how.time_format,
        before=before,
    )
    return Runs(runs, sources, how)


def runs_for_model(model: Model, given: Any, how: How) -> Runs:
    """The runs in `given` for a fitted `model`: read as those of its fit where `how` leaves that
    open, and at its own rate, where it has one and they are faster."""
    spec, own, before = model.plant.spec, model.resample, said_before(model)
    known = _known(given, how)
    if known is not None:
        if own is not None:
            faster = [run for run in known if run.resampled is None]
            brought = iter(at_rate(faster, own, _held(spec), jumping(spec), "keep"))
            known[:] = [next(brought) if run.resampled is None else run for run in known]
        return known
    if own is None:
        return runs_for_plant(spec, given, how, before=before)
    if how.resample not in (None, own):
        raise InputError(
            f"--resample {how.resample:g}: the model was fitted at {own:g} Hz, which faster logs "
            "are brought to anyway; leave the option out."
        )
    return runs_for_plant(spec, given, replace(how, resample=own), slower="keep", before=before)


def said_before(model: Model) -> Before:
    """How the logs were read that `model` was fitted to."""
    said = model.reading
    return Before(said.get("time"), said.get("time_format"), tuple(said.get("maps", ())))


def unlike_warnings(model: Model, runs: Runs) -> list[str]:
    """What in `runs` is not as in the logs that `model` was fitted to: a time in another unit,
    signals far from their training ranges, outputs without a column."""
    before = said_before(model)
    maps = runs.how.maps or before.maps
    odd = other_clock(model, runs, runs.how.time or before.time, maps)
    return [*odd, *_without_outputs(model, runs), *other_range(model, runs)]


def _without_outputs(model: Model, runs: Runs) -> list[str]:
    """A sentence for every log that lacks an output of the logs that `model` was fitted to."""
    found = dict[str, str]()
    for run in runs:
        lost = [name for name in model.record.columns.outputs if name not in run.columns]
        if lost:
            which = f"{'column' if len(lost) == 1 else 'columns'} {listed([*map(repr, lost)])}"
            found.setdefault(
                run.source,
                f"{run.source} has no {which}, which the logs had that the model was fitted to: "
                "what shows there alone is not told; if it has another name, say so with --map",
            )
    return list(found.values())


def _held(spec: PlantSpec) -> list[str]:
    return [each.name for each in spec.signals.inputs if each.hold == "zero"]


def _known(given: Any, how: How) -> Runs | None:
    """A copy of what are runs already; None where there is something to read."""
    runs = [given] if isinstance(given, Run) else given
    if not isinstance(runs, list | tuple) or not any(isinstance(each, Run) for each in runs):
        return None
    strange = next((each for each in runs if not isinstance(each, Run)), None)
    if strange is not None:
        raise InputError(f"a list of runs also holds a {type(strange).__name__}; {LEGAL}.")
    if how != How():
        raise InputError(
            "time, time_format, map, where and resample say how logs are read, and these runs are "
            "read already; give them to `faultgauge.read`."
        )
    if isinstance(given, Runs):
        return Runs(given, given.sources, given.how)
    return Runs(runs, (), how)


def _sources(given: Any) -> list[Source]:
    """Paths, and tables of what is in memory."""
    items = given if isinstance(given, list | tuple) else [given]
    found: list[Source] = []
    frames = 0
    for each in items:
        if isinstance(each, str | Path):
            found.append(each)
        elif is_frame(each):
            frames += 1
            found.append(read_frame(each, "table" if frames == 1 else f"table#{frames}"))
        else:
            raise InputError(f"a {type(each).__name__} is no log; {LEGAL}.")
    return found
