"""Samples that nothing explains."""

from collections import Counter
from collections.abc import Iterator, Sequence

from faultgauge.detection.posterior.glitches import Glitch
from faultgauge.detection.words import moment
from faultgauge.telemetry.clock import Clock

__all__ = ["sentences"]

SHOWN = 3  # of a column's glitches


def sentences(
    source: str, glitches: Sequence[Glitch], clock: Clock | None, step: float
) -> Iterator[str]:
    """One for each output of `source` that has any; its rows are `step` [s] apart."""
    for name, count in Counter(each.output for each in glitches).items():
        own = [each for each in glitches if each.output == name][:SHOWN]
        shown = [f"{each.value:.6g} at {moment(clock, each.t, step)}" for each in own]
        more = [f"and {count - SHOWN} more"] if count > SHOWN else []
        what = "1 sample is" if count == 1 else f"{count} samples are"
        yield (
            f"{source}: {what} far beyond what anything explains, and moved nothing: {name} = "
            f"{', '.join([*shown, *more])}"
        )
