"""Where the size of a fault that stays jumps: another event begins."""

from itertools import pairwise

import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.onset.retrospective import retrospect
from faultgauge.detection.posterior.jumps import Sizes, jumps
from faultgauge.reporting.words.hindsight import sentences
from faultgauge.telemetry import Run
from lags import COUNT, NOISE, SIGMA, STEP, driven, model

ROWS, DT, MEMORY, OLD = 400, 0.1, 2.0, 1.0
T = DT * np.arange(ROWS)


def sizes(f, half=0.1, since=None):
    """Intervals of `half` on both sides of `f`; by default all is as old as OLD [s]."""
    since = np.stack([np.full(ROWS, OLD), np.full(ROWS, 0.01)], axis=1) if since is None else since
    return Sizes(T, f - half, f + half, since)


def test_a_step_is_a_jump_between_its_rows_and_dated_by_the_moments_of_a_mixture():
    """With probability 0.3 the fault is as old as the step, at 19.5 s, and with 0.7 as before."""
    w, step = 0.3, 19.5
    after = T >= 20.0
    mean = np.where(after, (1 - w) * OLD + w * step, OLD)
    sd = np.where(after, np.sqrt(w * (1 - w)) * (step - OLD), 0.0)
    (found,) = jumps(sizes(np.where(after, 2.0, 1.0), since=np.stack([mean, sd], 1)), MEMORY)
    assert (found.last, found.first) == (199, 200)
    assert found.began == pytest.approx(step)


def test_what_lies_between_two_sizes_for_less_than_a_memory_is_neither():
    """From row 195 to 204 the interval holds both."""
    f = np.where(np.arange(ROWS) < 200, 1.0, 2.0)
    wide = np.where((np.arange(ROWS) >= 195) & (np.arange(ROWS) < 205), 1.0, 0.1)
    (found,) = jumps(sizes(f, wide), MEMORY)
    assert found.first == 205
    assert found.last == 194  # the last that is as sure of the first size as before


@pytest.mark.parametrize("rate", [0.02, 0.09, 0.2, 1.0, 5.0])
def test_what_grows_steadily_has_none(rate):
    """From nothing in an interval's width per memory to fifty."""
    assert jumps(sizes(rate * T), MEMORY) == []


def test_a_size_that_does_not_last_has_none():
    """A memory is 20 rows: a peak of 15 is none, and neither are 15 rows at the end."""
    k = np.arange(ROWS)
    assert jumps(sizes(np.where((k >= 200) & (k < 215), 2.0, 1.0)), MEMORY) == []
    assert jumps(sizes(np.where(k >= ROWS - 15, 2.0, 1.0)), MEMORY) == []
    assert len(jumps(sizes(np.where((k >= 200) & (k < 240), 2.0, 1.0)), MEMORY)) == 2


def test_intervals_that_meet_are_of_one_size():
    assert jumps(sizes(np.where(T < 20.0, 1.0, 1.19)), MEMORY) == []
    assert len(jumps(sizes(np.where(T < 20.0, 1.0, 1.21)), MEMORY)) == 1
    assert jumps(Sizes(*np.zeros((3, 0)), np.zeros((0, 2))), MEMORY) == []


def steps(fault, levels, seed):
    """A log in which `fault` has these levels from row 200 on, for 150 rows each."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, COUNT // 20), 20)
    size = np.zeros(COUNT)
    for k, level in enumerate(levels):
        size[200 + 150 * k : 350 + 150 * k] = level
    push, bias = (size, 0.0) if fault == "push" else (0.0, size)
    y = driven(u + push) + bias + SIGMA * rng.standard_normal(COUNT)
    return Run("steps", "lag.csv", STEP * np.arange(COUNT), {"u": u, "x": y})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("fault", "levels"),
    [("push", (0.3, 0.8, 0.4)), ("push", (-0.8, -0.3, -0.6)), ("bias", (0.5, 1.0, 0.3))],
)
def test_a_staircase_is_an_event_for_each_step(fault, levels, seed):
    """Each with its own size and date."""
    (decision,), _ = decide_runs(for_bank(model(), NOISE), [steps(fault, levels, seed)])
    told = decision.events
    assert [each.fault for each in told] == [fault] * 3
    assert [each.size for each in told] == pytest.approx(levels, rel=0.1)
    begun = STEP * (200 + 150 * np.arange(3))
    assert [each.onset for each in told] == pytest.approx(begun, abs=4 * STEP)
    for before, after in pairwise(told):
        assert before.end <= after.onset <= after.onset_hi <= after.start
        assert after.onset_lo <= after.onset


def test_hindsight_has_each_step_until_the_next():
    """As told online: dates within a sample, and an end for each but the last."""
    levels = (0.3, 0.8, 0.4)
    (decision,), bank = decide_runs(for_bank(model(), NOISE), [steps("push", levels, 0)])
    *found, rest = retrospect(bank, decision)
    assert rest.cause == "healthy"
    assert [each.cause for each in found] == ["push"] * 3
    assert [each.size for each in found] == pytest.approx(levels, rel=0.1)
    begun = STEP * (200 + 150 * np.arange(4))
    assert [each.onset for each in found] == pytest.approx(begun[:3], abs=2 * STEP)
    assert [each.end for each in found[:2]] == pytest.approx(begun[1:3], abs=2 * STEP)
    said = sentences(bank, [decision], [*found, rest])
    assert f" until {found[0].end:g} s" in said[0]
    assert f" until {found[1].end:g} s" in said[1]


@pytest.mark.parametrize(("back", "loose"), [(False, 0), (True, 1)])
def test_a_jump_that_the_plant_answers_at_once_is_no_single_sample(back, loose):
    """A bias jumps from 0.5 to 2.5 as x falls by 1 a sample: up and down at once. Where it is
    as before in the sample after, that sample is one that nothing explains."""
    k = np.arange(COUNT)
    u = np.where((k < 380) | (k > 400), 1.0, -1.0)
    bias = np.where(k < 200, 0.0, 0.5) + 2.0 * (k == 383 if back else k >= 383)
    noise = SIGMA * np.random.default_rng(0).standard_normal(COUNT)
    run = Run("jump", "lag.csv", STEP * k, {"u": u, "x": driven(u, x=5.0) + bias + noise})
    (decision,), _ = decide_runs(for_bank(model(), NOISE), [run])
    assert [each.fault for each in decision.events] == ["bias"] * (1 if back else 2)
    assert len(decision.glitches) == loose
