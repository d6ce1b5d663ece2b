"""What is told of a stretch of a log, and the words that all sentences share."""

from collections.abc import Sequence
from typing import NamedTuple

from faultgauge.detection.answer.least import least_told
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.detection.words import moment, would_not_show
from faultgauge.plants.model import Model
from faultgauge.plants.signals import spoken

__all__ = ["Told", "row_time", "unit_of", "would_not_show_in"]


class Told(NamedTuple):
    """What is told of a run from `start` to `end` [s], as a sentence: what a first screen says,
    and the rest; the `causes` that are left of an alarm without a name; `brief`, what it is; the
    `event` that it tells of, if any."""

    start: float
    end: float
    head: str
    rest: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    brief: str = ""
    event: BankEvent | None = None

    @property
    def text(self) -> str:
        return "; ".join((self.head, *self.rest))


def row_time(bank: FaultBank, one: Decision, t: float) -> str:
    """A row's time, as fine as rows are apart."""
    return moment(one.run.clock, t, bank.step)


def unit_of(model: Model, fault: str) -> str:
    """The unit of a declared fault; nothing of a pure number and of what is undeclared."""
    units = {each.name: each.unit for each in model.plant.signals.faults}
    return spoken(units.get(fault, ""))


def would_not_show_in(
    bank: FaultBank, decisions: Sequence[Decision], only: Sequence[str] = ()
) -> str:
    """Below what each fault would not have shown in the least telling of some runs."""
    least = dict[str, tuple[float | None, str]]()
    for k, name in enumerate(bank.model.plant.signals.fault_names):
        if only and name not in only:
            continue
        sizes = [least_told(bank, one, k) for one in decisions]
        shown = [size for size in sizes if size is not None]
        least[name] = max(shown) if len(shown) == len(sizes) else None, unit_of(bank.model, name)
    return would_not_show(least)
