"""The smallest size of a fault that would be named.

A fault of size f leaves f^2 / (2 sd^2) of log-likelihood, which must outweigh the prior odds of an
onset, and what not knowing the size costs, by the level of an alarm or a name; beside the fault
that is most like it, as much must be left as a name takes. One that does so 9 times in 10 is 1.3 sd
larger. What healthy logs show too has to be real by as much (`posterior.mimicked`).
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.mimicked import least_real
from faultgauge.detection.posterior.unit_faults import Effects, Information, effects_of, information
from faultgauge.detection.posterior.verdicts import NAMED
from faultgauge.detection.rows.prepared import Prepared, as_it_acts
from faultgauge.observers.branches import SCALES
from faultgauge.telemetry import Run

__all__ = [
    "apart_size",
    "around",
    "deviations",
    "information_left",
    "least_size",
    "possible",
    "rivals_of",
    "seen_size",
    "smallest_along",
    "smallest_from",
]

NINE_IN_TEN = 1.2816  # standard deviations
NEARBY = 12  # onsets of another fault on either side
_LAST: deque[tuple[FaultBank, Prepared, Effects]] = deque(maxlen=2)  # what was walked last


def seen_size(bank: FaultBank, fault: int, sd: float, seconds: float, rarer: float = 1.0) -> float:
    """The size that would raise an alarm in a log of `seconds`, its standard deviation being `sd`;
    with false alarms `rarer` times as rare as calibrated, for which evidence must be as many times
    as strong (Ville's inequality)."""
    named = float(np.log(NAMED / (1 - NAMED)))
    level = max(bank.level + np.log(rarer), named)
    prior = np.log(len(SCALES) / (bank.onset[fault] * seconds))
    occam = np.log1p((SCALES[-1] * float(bank.size[fault]) / sd) ** 2) / 2
    told = sd * (np.sqrt(2 * max(level + prior + occam, 1.0)) + NINE_IN_TEN)
    real = least_real(bank, fault, sd, level, seconds / 2)
    return float(max(told, real and real + NINE_IN_TEN * sd))


def apart_size(sd: float) -> float:
    """The size that would be told from another fault, its standard deviation beside that being
    `sd`."""
    return float(sd * (np.sqrt(2 * np.log(NAMED / (1 - NAMED))) + NINE_IN_TEN))


def least_size(
    bank: FaultBank, fault: int, sd: float, apart: float, seconds: float, rarer: float = 1.0
) -> float | None:
    """The larger of both; None where it is no smaller than the fault may be at its widest."""
    if not max(sd, apart) < bank.size[fault]:
        return None
    return max(seen_size(bank, fault, sd, seconds, rarer), apart_size(apart))


def possible(bank: FaultBank, fault: int, size: float | None) -> float | None:
    """`size`, None where the fault cannot be that large: its widest prior is half of that."""
    return None if size is None or size > 2 * bank.size[fault] else size


def rivals_of(bank: FaultBank, fault: int) -> list[int]:
    """The declared faults that it may be taken for."""
    return [k for k in range(len(bank.size)) if k != fault and (k,) in bank.sets]


def information_left(
    found: Information, bank: FaultBank, fault: int, other: int
) -> Float[np.ndarray, "ends"]:
    """What is left of J about `fault` where `other` is fitted beside it, of any size that its prior
    allows, from the onset that leaves least."""
    J12, J22 = found.shared[:, fault, other], found.other[:, other]
    explained = J12**2 / (J22 + float(bank.size[other]) ** -2.0)
    return np.maximum(found.own[:, fault] - explained.max(axis=1), 0.0)


def around(reference: int, rows: int) -> list[int]:
    """Rows at which another fault may begin: with the `reference`, and ever sparser on either side
    of it, within `rows`."""
    far = {int(each) for each in np.geomspace(1, max(rows // 2, 1), NEARBY)}
    near = {reference, *(reference + k for k in far), *(reference - k for k in far)}
    # a fixed number, so that one program serves all logs
    legal = sorted(k for k in near if 0 <= k < rows)
    return [*legal, *[reference] * (2 * NEARBY + 1 - len(legal))]


def smallest_along(
    bank: FaultBank, acting: Prepared, judged: Bool[np.ndarray, "rows"] | None = None
) -> list[float | None]:
    """For each declared fault the size [its unit] that would have been named by the rows of a run,
    whose inputs are those that act, that were `judged` (by default all) had it begun in the middle
    of them; None where none would.
    """
    effects = _effects(bank, acting)
    at = np.ones(len(effects.t), bool)
    if judged is not None:
        at = judged[np.searchsorted(acting.run.t, effects.t)]
    rows = np.flatnonzero(at)
    if len(rows) < 2:
        return [None] * len(bank.size)
    heard = effects._replace(G=np.where(at[:, None, None], effects.G, 0.0))
    return _from(bank, heard, int(rows[len(rows) // 2]), len(rows))


def _effects(bank: FaultBank, acting: Prepared) -> Effects:
    """`effects_of`, which the same run is asked for again where it was judged anew."""
    for one, other, effects in _LAST:
        if one is bank and other is acting:
            return effects
    effects = effects_of(bank, acting)
    _LAST.append((bank, acting, effects))
    return effects


def smallest_from(bank: FaultBank, run: Run, shares: Sequence[float]) -> list[list[float | None]]:
    """For each of some `shares` of `run` what would have been named had it begun there, by all rows
    and with one walk of the filter."""
    effects = effects_of(bank, as_it_acts(bank.model.plant.signals, run))
    rows = len(effects.t)
    if rows < 2:
        return [[None] * len(bank.size) for _ in shares]
    return [_from(bank, effects, int(share * rows), rows) for share in shares]


def _from(bank: FaultBank, effects: Effects, onset: int, judged: int) -> list[float | None]:
    """By the end of the log, of which so many rows were `judged`, of a fault that begins at row
    `onset`."""
    rows = len(effects.t)
    found = information(effects, onset, around(onset, rows), [rows - 1])
    # a fault may begin in these rows alone
    seconds = (judged - 1) * float(np.median(np.diff(effects.t)))
    return [
        _smallest(bank, found, k, seconds) if (k,) in bank.sets else None
        for k in range(len(bank.size))
    ]


def _smallest(bank: FaultBank, found: Information, k: int, seconds: float) -> float | None:
    left = [float(information_left(found, bank, k, j)[-1]) for j in rivals_of(bank, k)]
    sd, apart = deviations(float(found.own[-1, k]), left)
    return possible(bank, k, least_size(bank, k, sd, apart, seconds))


def deviations(own: float, left: Sequence[float]) -> tuple[float, float]:
    """(sd of a fault alone, beside the one that leaves least) from information."""
    sd, apart = (1 / np.sqrt(J) if J > 0 else np.inf for J in (own, min([own, *left])))
    return float(sd), float(apart)
