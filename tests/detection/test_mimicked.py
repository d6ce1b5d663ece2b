"""What healthy logs show of a fault, against Bayes' theorem written out."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import norm

from faultgauge.detection.answer.smallest import seen_size
from faultgauge.detection.bank.bank import MIMICS, build_fault_bank
from faultgauge.detection.calibration.bank_calibration import (
    _mimics,
    calibrate_bank,
    calibrated,
)
from faultgauge.detection.decisions import decide
from faultgauge.detection.onset.retrospective import retrospect
from faultgauge.detection.posterior.mimicked import Mimicked, least_real
from faultgauge.observers.branches import BranchInfo
from lags import NOISE, log, model

SETS = 5  # healthy, either fault, both, unknown
HOLDS = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0, 0]], float)
SOURCES = ((1, -1, 3, -1, -1), (2, 3, -1, -1, -1))
SIZE, OFTEN = np.array([2.0, 4.0]), np.array([1e-3, 2e-3])
M = np.array([[0.1, 0.1, 0.05], [0.0, 0.0, 0.0]])  # before 1 s, before 10 s, behind


def mimicked(m=M):
    return Mimicked(HOLDS, SIZE, m, np.array([1.0, 10.0]), OFTEN, SOURCES, bool(m.any()))


def said(first, age):
    """The first fault of so much (size, sd) and of an `age` [s], with the second of 3 +- 0.2."""
    f, sd = np.tile([first[0], 3.0], (SETS, 1)), np.tile([first[1], 0.2], (SETS, 1))
    f[2], sd[2] = (0.0, 3.3), (0.0, 0.2)  # alone the second is told otherwise
    p = np.array([0.01, 0.04, 0.04, 0.9, 0.01])
    onset = np.array([[age, 0.1], [5.0, 0.1]])
    rest = np.zeros(3), np.zeros((2, 2)), onset, np.array([0.94, 0.94]), np.zeros(2)
    jumps = *np.zeros((3, SETS, 2)), np.zeros(2)
    ends = np.zeros(1), np.zeros(2), np.zeros(())
    return BranchInfo(*map(jnp.asarray, (p, f, sd, *rest, *jumps, *ends)))


@pytest.mark.parametrize(("f", "age", "m"), [(0.3, 0.5, 0.1), (0.3, 20.0, 0.05), (0.9, 2.0, 0.1)])
def test_what_healthy_logs_show_too_is_made_up_or_real(f, age, m):
    """By hand; the second fault takes over what is left without the first, as it is told beside
    it, and keeps its own size and certainty."""
    sd = 0.02
    given = said((f, sd), age)
    found = mimicked().told(given)
    real = np.log(1e-3) + norm.logpdf(f, 0, np.sqrt(sd**2 + m**2 + 4.0))
    made_up = np.log(m**2 / (sd**2 + m**2)) + norm.logpdf(f, 0, np.hypot(sd, m))
    share = expit(made_up - real)
    p = np.array([0.01 + 0.04 * share, 0.04 * (1 - share), 0.04 + 0.9 * share, 0.9 * (1 - share)])
    np.testing.assert_allclose(found.p, [*p, 0.01], rtol=1e-9)
    np.testing.assert_allclose(found.f[2, 1], (0.04 * 3.3 + 0.9 * share * 3.0) / p[2])
    np.testing.assert_allclose(found.f[3], [f, 3.0])
    np.testing.assert_allclose(found.sd[3], [np.hypot(sd, m), 0.2])
    np.testing.assert_allclose(found.ever, [0.94 - 0.94 * share, 0.94])


def test_where_healthy_logs_look_like_no_fault_nothing_is_made_up():
    given = said((0.3, 0.02), 0.5)
    assert mimicked(np.zeros((2, 3))).told(given) is given
    assert np.all(np.asarray(mimicked().told(said((0.3, 0.02), 0.5)).f[:, 0])[[1, 3]] == 0.3)


@pytest.fixture(scope="module")
def shown():
    """A bank whose healthy logs look as if pushed by 0.05, for up to a quarter of its memory or for
    good."""
    bank = build_fault_bank(model(), [log(1)], NOISE)
    sizes = np.zeros((2, len(MIMICS) + 1))
    sizes[0] = 0.05
    return replace(bank, mimicked=sizes)


def test_the_least_size_that_is_real_solves_the_odds(shown):
    for sd, level in ((0.0, 3.0), (0.03, 3.0), (0.01, 8.0)):
        size = least_real(shown, 0, sd, level, 0.0)
        odds = Mimicked.of(shown).odds(0, *map(np.array, (size, sd**2, 0.05)))
        np.testing.assert_allclose(odds, level, atol=1e-6)
    assert least_real(shown, 1, 0.01, 3.0, 0.0) == 0.0
    brief = replace(
        shown, mimicked=np.where(np.arange(len(MIMICS) + 1) < 1, 0.05, 0.0) * [[1], [0]]
    )
    assert least_real(brief, 0, 0.01, 3.0, 0.0) > 0
    assert least_real(brief, 0, 0.01, 3.0, float(brief.until[0])) == 0.0
    assert seen_size(brief, 0, 0.01, 300.0) < least_real(shown, 0, 0.01, 3.0, 150.0)


def test_what_is_told_of_mimicked_faults_is_how_large_and_for_how_long(shown):
    """A push of 0.05 (one standard deviation) for good; a bias of as much for a memory, and then
    of none, or of a fifth of it."""
    sizes = shown.mimicked.copy()
    assert _mimics(shown) == f"push below {least_real(shown, 0, 0.0, shown.level, 0.0):.2g}"
    sizes[1] = 0.05, 0.05, 0.0, 0.0, 0.0
    brief = replace(shown, mimicked=sizes * [[0.0], [1.0]])
    first = least_real(brief, 1, 0.0, brief.level, 0.0)
    lasts = f"{brief.until[1]:.3g} s"
    assert _mimics(brief) == f"bias below {first:.2g} in its first {lasts}"
    sizes[1, 2:] = 0.01
    both = replace(shown, mimicked=sizes * [[0.0], [1.0]])
    later = least_real(both, 1, 0.0, both.level, np.inf)
    assert _mimics(both) == f"bias below {first:.2g} in its first {lasts} and {later:.2g} later"


def test_online_and_in_hindsight_a_push_as_healthy_logs_show_it_is_none(shown):
    """One of 0.06 is clear by the noise; beside healthy logs that show 0.05 it is not, and one of
    0.8 is, known no better than those differ."""
    plain = build_fault_bank(model(), [log(1)], NOISE)
    small, large = log(4, push=0.06), log(4, push=0.8)
    assert [e.fault for e in decide(plain, small).events] == ["push"]
    judged = decide(shown, small)
    assert judged.events == []
    assert {each.cause for each in retrospect(shown, judged)} == {"healthy"}
    judged = decide(shown, large)
    (event,) = judged.events
    assert event.fault == "push"
    assert event.hi - event.lo == pytest.approx(2 * 1.96 * 0.05, rel=0.15)
    (told,) = [each for each in retrospect(shown, judged) if each.cause != "healthy"]
    assert told.cause == "push"
    assert told.lo <= 0.8 <= told.hi
    assert told.hi - told.lo == pytest.approx(2 * 1.96 * 0.05, rel=0.15)


def test_calibration_takes_a_bias_that_one_healthy_log_has_for_mimicked_alone():
    """Of 0.3 in one of three logs, known to 0.003: noise as large as hides it would hide as much of
    a push; a push is told as before, and a bias from more than that on."""
    plain = model()
    found = calibrate_bank(plain, [log(1), log(2), log(3, bias=0.3)], NOISE)
    assert set(found.level.mimicked) == {"bias"}
    assert found.level.widened < 1.5
    (text,) = [each for each in found.warnings if "look faulty" in each]
    assert "what looks like a fault there counts for none: bias below 0." in text
    told = calibrated(plain, found)
    bank = build_fault_bank(told, [log(4)], found.noise)
    assert [e.fault for e in decide(bank, log(4, push=0.1)).events] == ["push"]
    assert decide(bank, log(5, bias=0.3)).events == []
    assert [e.fault for e in decide(bank, log(5, bias=1.5)).events] == ["bias"]
