"""The size from which on a fault would have shown in a log."""

from collections import deque

import numpy as np

from faultgauge.detection.answer.smallest import smallest_along
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY

__all__ = ["least_told"]

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
