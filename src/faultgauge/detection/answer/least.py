"""Below what each fault would not have shown in a log."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.smallest import smallest_along
from faultgauge.detection.answer.telling import unit_of
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY
from faultgauge.detection.words import would_not_show

__all__ = ["least_told", "would_not_show_in"]

# what was asked last: every sentence asks anew
_SMALLEST: deque[tuple[FaultBank, Decision, list[float | None]]] = deque(maxlen=32)


def least_told(bank: FaultBank, decision: Decision, fault: int) -> float | None:
    """The size [the fault's unit] that would have been named by the judged rows of a run had the
    fault begun in the middle of them; None where none would."""
    for one, other, sizes in _SMALLEST:
        if one is bank and other is decision:
            return sizes[fault]
    sizes = smallest_along(bank, decision.acting, np.isin(decision.status, [HEALTHY, FAULT]))
    _SMALLEST.append((bank, decision, sizes))
    return sizes[fault]


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
        least[name] = max(shown) if len(shown) == len(sizes) else None, unit_of(bank, name)
    return would_not_show(least)
