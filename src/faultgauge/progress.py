"""What is being done, and how much of it is: what a callback `progress` is told."""

from collections.abc import Callable, Mapping
from itertools import accumulate

__all__ = ["Step", "in_phases", "within"]


class Step(str):
    """A text that knows which `share` of the work is done, 0 to 1."""

    share: float

    def __new__(cls, text: str, share: float) -> "Step":
        step = super().__new__(cls, text)
        step.share = share
        return step


def in_phases(progress: Callable[[str], None], phases: Mapping[str, int]) -> Callable[[str], None]:
    """`progress`, told the share of the work that is done where a phase begins.

    `phases` are how their texts begin, in order, and how long each takes, about, in any unit. A
    phase may be left out, or be told of several times; the share never falls.
    """
    total = sum(phases.values())
    done = dict(zip(phases, accumulate([0, *phases.values()]), strict=False))
    latest = 0.0

    def told(text: str) -> None:
        nonlocal latest
        begins = max((each for each in done if text.startswith(each)), key=len, default=None)
        latest = latest if begins is None else max(latest, done[begins] / total)
        progress(Step(text, latest))

    return told


def within(progress: Callable[[str], None], first: float, last: float) -> Callable[[str], None]:
    """`progress` of a part of the work, which goes from the share `first` to `last` of all."""

    def told(text: str) -> None:
        share = text.share if isinstance(text, Step) else 0.0
        progress(Step(text, first + (last - first) * share))

    return told
