"""How far evidence is trusted, against the odds that healthy logs may show."""

from dataclasses import replace

import numpy as np
import pytest

from faultgauge.detection.bank.bank import MIMICS, build_fault_bank
from faultgauge.detection.calibration.trust import Scored, Trust, trusted
from faultgauge.detection.posterior.mimicked import Mimicked
from faultgauge.errors import InputError
from lags import NOISE, log, model

PUSH, UNDECLARED = 0, 2
TIMES = np.arange(60.0)


@pytest.fixture(scope="module")
def bank():
    return build_fault_bank(model(), [log(1)], NOISE)


def scored(peak, cause=UNDECLARED, times=TIMES, size=1.0, age=0.0):
    count = len(times)
    told = (np.full(count, size), np.full(count, 1e-6), np.full(count, age))
    own = np.full(count, peak), np.full(count, cause), *told
    return Scored("a", times, *own, np.ones((count, 2)))


def by_widened(bank, *peaks):
    """Runs whose log-odds of something undeclared noise so many times as large makes what one of
    `peaks` says; and which of them are asked for."""
    asked = []

    def tried(trust, some):
        asked.extend(some)
        short = scored(99.0, times=TIMES[:9])
        return bank, [[scored(peaks[k](trust.widened)), short] for k in some]

    first = tried(Trust(1.0, np.zeros((2, len(MIMICS) + 1))), range(len(peaks)))[1]
    asked.clear()
    return first, tried, asked


def test_evidence_falls_with_the_square_of_how_far_it_is_trusted(bank):
    """Runs under a filter with noise s times as large: ln odds -7 + E / s^2 with E the evidence, so
    E = 42 at most shows none from s = sqrt(42 / 7) on, and s is taken no more than 8 % larger. A
    run whose odds fall more slowly, -7 + 20 / s, asks for s = 20 / 7 although it shows less at
    first. A stretch too short for a block asks for nothing."""
    runs = [lambda s: -7 + 12 / s**2, lambda s: -7 + 42 / s**2, lambda s: -7.0]
    scores, tried, asked = by_widened(bank, *runs)
    found = trusted(bank, scores, 0.0, tried, "never")
    assert np.sqrt(6) <= found.trust.widened <= 1.08 * np.sqrt(6)
    assert not found.trust.mimicked.any()
    # every fault has to be as many times as large, and a little more: as much has to be ruled out
    assert found.lost == pytest.approx(np.log(found.trust.widened), rel=0.1)
    assert all(each.score.max() <= 0.0 for each, _ in found.scores)
    assert asked.count(1) > asked.count(0) == asked.count(2) == 1  # the others once, at the end
    scores, tried, _ = by_widened(bank, *runs, lambda s: -7 + 20 / s)
    found = trusted(bank, scores, 0.0, tried, "never")
    assert 20 / 7 <= found.trust.widened <= 1.08 * 20 / 7
    calm = [[scored(-0.1)]]
    found = trusted(bank, calm, 0.0, tried, "never")
    assert (found.trust.widened, found.lost, found.scores) == (1.0, 0.0, calm)


def test_noise_that_breaks_the_filter_is_not_taken_for_too_little(bank):
    """Evidence of 690 that s = 4 leaves nothing of, and a filter that is no longer sound beyond s =
    8, where all looks faulty again: by the square of s alone s = 10 would be tried first."""
    scores, tried, _ = by_widened(bank, lambda s: 690.0 if s > 8 else 690.0 / s**2 - 44.0)
    found = trusted(bank, scores, 0.0, tried, "never")
    assert np.sqrt(690 / 44) <= found.trust.widened <= 1.08 * np.sqrt(690 / 44)
    assert found.scores[0][0].score.max() <= 0.0
    scores, always, _ = by_widened(bank, lambda s: 690.0)
    with pytest.raises(InputError, match="never"):
        trusted(bank, scores, 0.0, always, "never")


def by_mimicked(bank, pushed, undeclared, size, age):
    """A run that looks pushed by `size`, with log-odds -7 + `pushed` / s^2 and no more than this
    `size` is real with, and then undeclared with -7 + `undeclared` / s^2."""

    def one(trust):
        m = trust.mimicked[PUSH, np.sum(age >= bank.until)]
        odds = -7 + pushed / trust.widened**2
        if m:
            real = Mimicked.of(replace(bank, mimicked=trust.mimicked)).odds(
                PUSH, np.array(size), np.array(1e-6), np.array(m)
            )
            odds = min(odds, float(real))
        late = scored(-7 + undeclared / trust.widened**2, times=60 + TIMES)
        return [scored(odds, PUSH, size=size, age=age), late]

    def tried(trust, some):
        return replace(bank, mimicked=trust.mimicked), [one(trust) for _ in some]

    return [one(Trust(1.0, np.zeros((2, len(MIMICS) + 1))))], tried


def test_one_fault_that_healthy_logs_mimic_leaves_the_other_one_as_clear(bank):
    """A push of 0.02 asks for noise 10 times as large, all else for 1.5 times: of that fault alone
    as much is taken for mimicked as makes it made up, at that age and before."""
    size, age = 0.02, float(bank.until[1])
    scores, tried = by_mimicked(bank, 700.0, 7 * 1.5**2, size, age)
    found = trusted(bank, scores, 0.0, tried, "never")
    assert 1.5 <= found.trust.widened <= 1.5 * 1.08
    assert found.lost < np.log(10)
    mimicked = found.trust.mimicked
    assert not mimicked[1 - PUSH].any()
    assert mimicked[PUSH, 0] == mimicked[PUSH, 2] > 0
    odds = Mimicked.of(found.bank).odds(PUSH, *map(np.array, (size, 1e-6, mimicked[PUSH, 0])))
    assert -1.0 < odds <= 0  # sizes that are tried are 5 % apart: a tenth of z^2 / 2
    assert np.all(mimicked[PUSH, 3:] == mimicked[PUSH, 0])  # it lasts until the end of its log
    # where all else asks for as much, nothing is gained by it
    scores, tried = by_mimicked(bank, 700.0, 700.0, size, age)
    found = trusted(bank, scores, 0.0, tried, "never")
    assert 10 <= found.trust.widened <= 10 * 1.08
    assert not found.trust.mimicked.any()


def test_what_is_mimicked_for_a_while_counts_for_as_long(bank):
    size, age = 0.02, float(bank.until[1])
    scores, tried = by_mimicked(bank, 700.0, 0.0, size, age)
    scores[0][0] = scores[0][0]._replace(score=np.append(scores[0][0].score[:-1], -7.0))
    mimicked = trusted(bank, scores, 0.0, tried, "never").trust.mimicked
    assert mimicked[PUSH, 2] > 0
    assert not mimicked[PUSH, 3:].any()
