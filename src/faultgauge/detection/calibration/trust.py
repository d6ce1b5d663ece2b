"""How far the bank's evidence is trusted, so that healthy logs show no fault.

Where they do, the model errs in a way that none of its noise is. There are two remedies, and each
makes faults harder to see:

- noise that is w times as large (`widened`) makes all evidence 1/w^2 of what it was, and each fault
  has to be w times as large;
- what looks like a fault k is taken for one that healthy logs mimic (`posterior.mimicked`): that
  fault alone has to be larger than what they show of it.

By the highest log-odds of each fault, L_k, of which L_0 would be there without any evidence and
L_m may be, noise would have to be  w_k = sqrt((L_k - L_0) / (L_m - L_0))  times as large. Of the
faults with the largest w_k none, one, two, ... are taken for mimicked, and noise is as large as the
others ask. What is `lost` is ln of how many times as large faults have to be, in the mean over all
of them and their ages. Where noise alone loses much, the choice that would lose least by this
forecast is tried, and taken where it does lose clearly less.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import brentq

from faultgauge.detection.answer.smallest import seen_size
from faultgauge.detection.bank.bank import MIMICS, FaultBank
from faultgauge.detection.bank.priors import RARE
from faultgauge.detection.posterior.mimicked import Mimicked
from faultgauge.errors import InputError
from faultgauge.plants.signals import Signals

__all__ = ["LEFT", "LOWEST", "SHORTEST", "WORTH", "Scored", "Trust", "in_full", "trusted"]

SHORTEST = 50  # samples of a stretch that tells
LOWEST = -30.0  # log-odds: what lies below is alike
STEEP = 1.02  # so that few tries are needed
CLOSE = 1.04  # times what is needed, either way: close enough
LARGEST = np.log(1e3)  # of how many times as large noise may be
WIDER = np.log(2.0)  # at once: noise that is far too large breaks a filter that is not linear
MUCH = float(np.log(2.0))  # is lost by noise alone: less is made up for by evidence that adds up
WORTH = float(np.log(1.25))  # is lost where a cause is looked for, other than by chance
LEFT = 0.5  # of what noise alone would lose: what loses more mends nothing
SURE = 30.0  # log-odds from which on a probability is 1 to the last digits
TINY = 1e-300  # no division by 0
LEAST = 1e-2  # of what is allowed: less is alike
LARGER = 1.25  # times as large is what is mimicked taken at least where it was not enough
LEAST_MIMICKED = 1e-4  # of a fault's widest size
MIMICRIES = 200  # sizes between that and the widest, 5 % apart
MOST_ROWS = 1000  # the largest sizes, that tell how large


class Scored(NamedTuple):
    """Samples of a run: the place of the likeliest cause, one behind the faults where that is
    undeclared, and its size there [its unit], with the variance that it would have if no healthy
    log looked like it, and its age [s]; how badly the likeliest explanation fits in each window."""

    run: str
    t: Float[np.ndarray, "samples"]
    score: Float[np.ndarray, "samples"]
    likeliest: Int[np.ndarray, "samples"]
    size: Float[np.ndarray, "samples"]
    variance: Float[np.ndarray, "samples"]
    age: Float[np.ndarray, "samples"]
    nis: Float[np.ndarray, "samples windows"]


class Trust(NamedTuple):
    """Noise is `widened` so many times, and `mimicked` is the size [its unit] of what in healthy
    logs looks like each fault at each age (one standard deviation)."""

    widened: float
    mimicked: Float[np.ndarray, "faults ages"]


Scores: TypeAlias = Sequence[Sequence[Scored]]
Tried: TypeAlias = Callable[[Trust, Sequence[int]], tuple[FaultBank, list[list[Scored]]]]


class Trusted(NamedTuple):
    """What was chosen, the bank and all runs' scores with it, and how much is `lost` by it."""

    trust: Trust
    bank: FaultBank
    scores: Scores
    lost: float


def in_full(signals: Signals) -> Trust:
    """Noise as it was found, and nothing that healthy logs mimic of the faults of `signals`."""
    return Trust(1.0, np.zeros((len(signals.faults), len(MIMICS) + 1)))


def _highest(stretches: Sequence[Scored]) -> float:
    """The highest score of a run; as low as any where it is not judged."""
    return max((float(each.score.max()) for each in _long(stretches)), default=LOWEST)


def trusted(bank: FaultBank, scores: Scores, most: float, tried: Tried, never: str) -> Trusted:
    """The choice by which no run shows log-odds above `most`, from a `bank` that is trusted in full
    and the `scores` of all runs by it; `tried` tells both for some of the runs, with some trust.
    Raises `InputError` where no noise is large enough, with what is said then, `never`.
    """
    first = Trusted(in_full(bank.model.plant.signals), bank, scores, 0.0)
    if max(map(_highest, scores)) <= most:
        return first
    plain = _enough(first, (), most, tried, never)
    assert plain is not None  # without a limit
    lost, limit = _choices(first, most), LEFT * plain.lost
    best = min(lost, key=lambda each: lost[each])
    if not best or plain.lost <= MUCH or lost[best] >= limit:
        return plain
    return _enough(first, best, most, tried, never, limit) or plain


def _choices(first: Trusted, most: float) -> dict[tuple[int, ...], float]:
    """What is lost by every choice of faults that are taken for mimicked, as far as the scores of a
    bank that is trusted in full tell."""
    nothing = _nothing(first.scores)
    by_cause = np.full(len(first.bank.size) + 1, -np.inf)
    for each in (each for run in first.scores for each in _long(run)):
        # a probability says no more than 1; f^2 / (2 V) of evidence does
        clear = np.nan_to_num(each.size**2 / np.maximum(2 * each.variance, TINY))
        odds = np.where(each.score > SURE, np.maximum(each.score, nothing + clear), each.score)
        np.maximum.at(by_cause, each.likeliest, odds)
    needed = np.sqrt(np.maximum((by_cause - nothing) / (most - nothing), 1.0))
    order = np.argsort(-needed[:-1])
    found = {}
    for count in range(int(np.sum(needed[:-1] > 1.0)) + 1):
        mimics = tuple(int(k) for k in order[:count])
        widened = float(max(needed[-1], *np.delete(needed[:-1], mimics), 1.0))
        mimicked = _mimicked(first, mimics, most)
        found[mimics] = _lost(first.bank, Trust(widened, mimicked))
    return found


def _lost(bank: FaultBank, trust: Trust) -> float:
    """ln of how many times as large faults must be as by a `bank` that is trusted in full, in the
    mean over them and their ages."""
    known, told = bank.knowledge, []
    mimicking = replace(bank, mimicked=trust.mimicked)
    for age in bank.until:
        for k, sd in enumerate(known.at(k, age) for k in range(len(bank.size))):
            if np.isfinite(sd) and (k,) in bank.sets:
                wide = seen_size(mimicking, k, trust.widened * sd, 2 * age)
                told.append(np.log(wide / seen_size(bank, k, sd, 2 * age)))
    return float(np.mean(told)) if told else float(np.log(trust.widened))


def _enough(
    first: Trusted,
    mimics: Sequence[int],
    most: float,
    tried: Tried,
    never: str,
    limit: float = np.inf,
) -> Trusted | None:
    """As large sizes of what is taken for mimicked, and then as large noise, as it takes; None
    where more than the `limit` is lost."""
    found = first
    while max(map(_highest, found.scores)) > most:
        if found.lost > limit:
            return None
        mimicked = _mimicked(found, mimics, most)
        if np.any(mimicked > found.trust.mimicked):
            trust = found.trust._replace(mimicked=mimicked)
        else:
            trust = _widened(found, most, tried, never)
        bank, scores = tried(trust, range(len(first.scores)))
        found = Trusted(trust, bank, scores, _lost(first.bank, trust))
    return None if found.lost > limit else found


def _mimicked(
    found: Trusted, mimics: Sequence[int], most: float
) -> Float[np.ndarray, "faults ages"]:
    """The sizes, at least those `found`, by which what looks like one of the `mimics` in any row is
    as likely made up as it has to be. What lasts until the end of a log may be of any age."""
    before, bank = found.trust.mimicked, found.bank
    sizes = before.copy()
    for each in (each for run in found.scores for each in _long(run)):
        behind = np.sum(each.age[:, None] >= bank.until, axis=1)
        asking = each.score > most
        for k, n in {*zip(each.likeliest[asking].tolist(), behind[asking].tolist(), strict=True)}:
            if k not in mimics:
                continue
            rows = np.flatnonzero(asking & (each.likeliest == k) & (behind == n))
            size = _mimicking(bank, k, each.size[rows], each.variance[rows], most)
            ages = slice(None) if rows[-1] == len(asking) - 1 else slice(n + 1)
            sizes[k, ages] = np.maximum(sizes[k, ages], max(size, LARGER * before[k, n]))
    return np.minimum(sizes, bank.size[:, None])


def _mimicking(
    bank: FaultBank,
    fault: int,
    f: Float[np.ndarray, "rows"],
    variance: Float[np.ndarray, "rows"],
    most: float,
) -> float:
    """The least size by which a `fault` that is told as `f`, with this `variance`, is real with
    log-odds of `most` in none of the rows."""
    some = np.argsort(np.abs(f))[-MOST_ROWS:]
    sizes = bank.size[fault] * np.geomspace(LEAST_MIMICKED, 1.0, MIMICRIES)[:, None]
    odds = np.asarray(Mimicked.of(bank).odds(fault, f[some], variance[some], sizes))
    enough = np.all(odds <= most, axis=1)
    return float(sizes[np.argmax(enough) if enough.any() else -1, 0])


def _widened(found: Trusted, most: float, tried: Tried, never: str) -> Trust:
    """Noise as large as the run that is worst asks for: evidence falls about with the square of it,
    from the least odds that there are."""
    peaks, nothing = [_highest(each) for each in found.scores], _nothing(found.scores)
    worst = int(np.argmax(peaks))
    low = float(np.log(found.trust.widened))  # ln of it: of what is not enough
    # by ln of how many times as large noise is, that of how many times too large evidence is
    known = {low: float(np.log((peaks[worst] - nothing) / (most - nothing)))}

    def over(larger: float) -> float:
        if larger not in known:
            trust = found.trust._replace(widened=float(np.exp(larger)))
            evidence = _highest(tried(trust, [worst])[1][0]) - nothing
            known[larger] = float(np.log(max(evidence / (most - nothing), LEAST)))
        return known[larger]

    high = low + min(known[low] / 2 + np.log(STEEP), WIDER)
    while over(high) > 0:
        low, high = high, high + min(max(known[high], np.log(CLOSE)), WIDER)
        if high > LARGEST:
            raise InputError(never)
    brentq(over, low, high, xtol=np.log(CLOSE))
    enough = min(each for each in known if known[each] <= 0)
    return found.trust._replace(widened=float(np.exp(enough)))


def _nothing(scores: Scores) -> float:
    """The log-odds without any evidence."""
    return float(min(*map(_highest, scores), np.log(RARE)))


def _long(stretches: Sequence[Scored]) -> list[Scored]:
    return [each for each in stretches if len(each.score) >= SHORTEST]
