"""Logs whose time is in another unit than that of the logs that a model was fitted to."""

from collections.abc import Iterable, Sequence

from faultgauge.plants.model import Model
from faultgauge.telemetry.mapping import alias, parse_maps
from faultgauge.telemetry.runs import Run

__all__ = ["other_clock"]

NEAR = 0.01  # of a step, for two steps to be the same but for the unit
# how many times as long a step looks -> what the time looks to be in, what makes seconds of it
LOOKS = {
    1e3: ("milliseconds", "/1000"),
    1e6: ("microseconds", "/1e6"),
    1e9: ("nanoseconds", "/1e9"),
    1e-3: ("thousands of seconds", "*1000"),
}


def other_clock(
    model: Model, runs: Sequence[Run], time: str | None = None, maps: Iterable[str] | None = None
) -> list[str]:
    """A sentence for every log, read with `time` and `maps`, whose step is a thousand times (or a
    million, a thousand million, a thousandth) that of the logs that `model` was fitted to."""
    before = model.record.log_step
    found = {}
    for run in runs:
        step, usual = run.step, float(model.record.sample_time)
        if before is not None:
            step, usual = run.logged or run.step, float(before)
        for times, (unit, factor) in LOOKS.items():
            if abs(step / usual / times - 1) <= NEAR:
                found[run.source] = (
                    f"{run.source} has a sample every {step:.4g} s, {times:g} times the "
                    f"{usual:.4g} s of the logs that the model was fitted to: its time looks to be "
                    f"in {unit}; if it is, give {_remedy(factor, time, parse_maps(maps or ()))}"
                )
    return list(found.values())


def _remedy(factor: str, time: str | None, maps: dict[str, str]) -> str:
    if "t" in maps:
        return f'--map "t=({maps["t"]}){factor}" in place of that of t'
    instead = f" in place of --time {time}" if time not in (None, "t") else ""
    return f'--map "t={alias(time or "t")}{factor}"{instead}'
