"""A sensor whose noise grows is undeclared, and named: it is no flurry of biases."""

import inspect

import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.decisions import as_dicts, decide_runs
from faultgauge.detection.onset.retrospective import retrospect
from faultgauge.detection.posterior import events as event_module
from faultgauge.detection.posterior.events import UNKNOWN
from faultgauge.reporting.decision_chapter import _row
from faultgauge.reporting.words.event_sentence import told_event
from faultgauge.reporting.words.hindsight import sentences
from faultgauge.telemetry import Run
from lags import COUNT, NOISE, SIGMA, STEP, log, model


def louder(seed, times):
    """A log of which the second half has `times` the noise."""
    run, more = log(seed), np.sqrt(times**2 - 1)
    rng = np.random.default_rng([7, seed])
    there = np.arange(COUNT) >= COUNT // 2
    x = run.columns["x"] + more * SIGMA * rng.standard_normal(COUNT) * there
    return Run(run.name, run.source, run.t, {**run.columns, "x": x}, STEP)


def judged(runs):
    return decide_runs(for_bank(model(), NOISE), runs)


@pytest.fixture(scope="module")
def loud():
    return judged([louder(seed, 5.0) for seed in range(4)])


def test_noise_that_grows_is_told_once_and_of_which_output(loud):
    decisions, bank = loud
    began = STEP * COUNT / 2
    for each in decisions:
        (event,) = each.events
        assert (event.fault, event.noisy, event.end) == (UNKNOWN, "x", each.run.t[-1])
        # a sample has 10 nats on the mean, (1 - 1/4^2) 5^2 / 2 - ln 4, but less of what is far off,
        # which no filter believes; 25 or so are sure, and then it has to last
        assert began + bank.outlasts <= event.start <= began + bank.outlasts + 40 * STEP
        assert began <= event.onset <= event.start
        assert as_dicts([event])[0]["noisy"] == "x"
        said = "something undeclared (x has far more noise than in healthy logs)"
        assert told_event(bank, each, event).head.startswith(said)
        assert _row(bank, each, event)[1] == said  # the report's table says it, too


def test_hindsight_leaves_that_output_out_while_it_is_loud(loud):
    decisions, bank = loud
    found = [window for each in decisions for window in retrospect(bank, each)]
    assert {each.cause for each in found} == {"healthy"}
    assert all("no fault but the noise of x" in each for each in sentences(bank, decisions, found))


@pytest.mark.parametrize("times", [1.0, 1.4])  # 1.7 times is as likely as none
def test_noise_that_hardly_grows_is_none(times):
    decisions, _ = judged([louder(seed, times) for seed in range(4)])
    assert [each.events for each in decisions] == [[]] * 4


@pytest.mark.parametrize(
    ("share", "noisy"), [([0.9, 0.05], "a"), ([0.1, 0.8], "b"), ([0.3, 0.3], None), ([], None)]
)
def test_an_output_is_named_where_its_noise_is_likelier_than_all_else(share, noisy):
    class Bank:
        outputs = ("a", "b")

    rows = np.tile(share, (3, 1))
    assert inspect.unwrap(event_module._noisy)(Bank, rows) == noisy
    assert inspect.unwrap(event_module._noisy)(Bank, np.where(rows > 1, rows, np.nan)) is None
