"""Faults of an ordinary size that a log does not tell: unseen, or taken for another one."""

from typing import NamedTuple

import numpy as np

from faultgauge.detection.answer.smallest import (
    apart_size,
    deviations,
    information_left,
    rivals_of,
    seen_size,
)
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.unit_faults import Information

__all__ = ["ORDINARY", "Problem", "problems_of", "size_told"]

ORDINARY = 0.25  # of the widest prior: a size that shall be told
MOST = 4  # problems that help is looked for


class Problem(NamedTuple):
    """A fault of `size` [its unit], by its place, that is not seen (`rival` None) or not told from
    its rival."""

    fault: int
    rival: int | None
    size: float


def size_told(
    bank: FaultBank, found: Information, fault: int, rival: int | None, seconds: float
) -> float:
    """The size from which on it is seen, or told from the rival, by the last row of `found`."""
    own = float(found.own[-1, fault])
    if rival is None:
        sd = deviations(own, [])[0]
        return seen_size(bank, fault, sd, seconds) if np.isfinite(sd) else np.inf
    left = float(information_left(found, bank, fault, rival)[-1])
    return apart_size(deviations(own, [left])[1])


def problems_of(bank: FaultBank, found: Information, seconds: float) -> list[Problem]:
    """The worst first; of a pair once."""
    listed = list[tuple[float, Problem]]()
    for k in [k for k in range(len(bank.size)) if (k,) in bank.sets]:
        size = ORDINARY * float(bank.size[k])
        for rival in [None, *rivals_of(bank, k)]:
            told = size_told(bank, found, k, rival, seconds)
            if told > size:
                listed.append((told / size, Problem(k, rival, size)))
                if rival is None:
                    break  # unseen beside no other either
    kept = dict[frozenset[int | None], Problem]()
    for _, each in sorted(listed, key=lambda one: -one[0]):
        kept.setdefault(frozenset([each.fault, each.rival]), each)
    return list(kept.values())[:MOST]
