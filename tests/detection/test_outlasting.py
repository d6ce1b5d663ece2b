"""What is undeclared is told once it has outlasted the model's own error, and dated from before."""

import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.calibration.bank_calibration import LOWEST, _lowest
from faultgauge.detection.decisions import decide
from faultgauge.detection.posterior.events import UNKNOWN
from lags import COUNT, LAG, NOISE, PLANT, STEP, log, model

ALONE = PLANT + '[faults.bias]\nenters = "output"\ntarget = "x"\n[detection]\n{rules}\n'
LASTING = 30.0  # s: the model's own error
BEGUN = 200.0  # s


def decided(text, lasts=None, push=0.0):
    """With something undeclared that acts on x for so many seconds, or a declared `push`."""
    t = STEP * np.arange(COUNT)
    error = 0.3 * ((t >= BEGUN) & (t < BEGUN + (lasts or 0.0)))
    noise = NOISE._replace(lasting=np.array([LASTING]))
    run = log(4, push=push, error=error)
    bank = build_fault_bank(model(text=text), [run], noise)
    return decide(bank, run), bank


def test_what_is_shorter_than_the_models_own_error_is_not_told():
    decision, bank = decided(ALONE, lasts=LASTING / 3)
    assert bank.outlasts == LASTING  # between a quarter of the memory and sixteen of it
    assert decision.events == []
    assert "FAULT" not in decision.status
    # nor is it called healthy while it is likely
    t = decision.run.t
    during = (t > BEGUN + 5) & (t < BEGUN + LASTING / 3)
    assert set(np.array(decision.status)[during]) == {"NOT_JUDGED"}


def test_what_lasts_is_told_when_it_has_outlasted_that_and_dated_from_before():
    decision, bank = decided(ALONE, lasts=150.0)
    (event,) = decision.events
    assert event.fault == UNKNOWN
    assert event.start >= BEGUN + LASTING
    # a memory until it is likely, and one more until its odds are at the level
    assert event.start <= BEGUN + LASTING + 2 * bank.knowledge.memory
    assert event.onset_lo <= BEGUN <= event.onset_hi
    assert event.onset <= BEGUN + bank.knowledge.memory


def test_a_declared_fault_does_not_wait():
    decision, bank = decided(LAG, push=0.3)
    (event,) = decision.events
    assert event.fault == "push"
    assert event.start < BEGUN + bank.outlasts / 2


@pytest.mark.parametrize("samples", [0.0, 2.0, 2.5])
def test_the_lowest_since_so_many_samples_before(samples):
    score = np.array([3.0, 1.0, 4.0, 1.5, 5.0])
    count = int(np.ceil(samples))
    by_hand = [min(score[k - count : k + 1]) if k >= count else LOWEST for k in range(5)]
    np.testing.assert_array_equal(_lowest(score, samples), by_hand)
