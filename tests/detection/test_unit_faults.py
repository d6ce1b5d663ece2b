"""What a unit fault leaves along a log, against closed forms and batch least squares of a lag.

x' = u - A x + f, y = x in white noise: a unit of f moves y by r(t) = (1 - exp(-A t)) / A, and a
loss of gain by minus what u does.
"""

import numpy as np
import pytest

from faultgauge.detection.answer.smallest import around, information_left, smallest_along
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.extended import start_spread
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.posterior.unit_faults import effects_of, information
from faultgauge.detection.rows.prepared import prepared
from faultgauge.telemetry import Run
from models import as_stated

TEXT = """
name = "lag"
[states.x]
derivative = "u - 0.5*x"
[inputs.u]
min = -4
max = 4
hold = "zero"
[outputs.x]
value = "x"
[faults.drive]
enters = "state"
target = "x"
[faults.loss]
enters = "gain"
target = "u"
[faults.push]
enters = "input"
target = "u"
min = -2
max = 2
"""
A, STEP, SIGMA, COUNT, ONSET = 0.5, 0.1, 0.05, 1000, 600
NOISELESS = 1e-9  # of process and discrepancy: nothing beside sigma


@pytest.fixture(scope="module")
def model():
    points = np.random.default_rng(0).uniform(-2, 2, (40, 2))
    return as_stated(TEXT, points)


def bank_of(model, run):
    one = np.array([NOISELESS])
    lasting, none = np.array([50.0]), np.zeros(0)
    noise = Noise(
        np.array([SIGMA]), one, none, one, lasting, one, np.array([5.0]), none, none, none
    )
    return build_fault_bank(model, [run], noise, 1000.0)


def effects_along(bank, run):
    return effects_of(bank, prepared(bank.model.plant.signals, run))


def smallest_in(bank, run, judged=None):
    return smallest_along(bank, prepared(bank.model.plant.signals, run), judged)


def moved(u, dt=STEP):
    """x under a held input, exactly, from rest."""
    x, decay = np.zeros(len(u)), np.exp(-A * dt)
    for k in range(len(u) - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / A * u[k]
    return x


def log(u, keep=None):
    t = STEP * np.arange(len(u))
    keep = np.ones(len(u), bool) if keep is None else keep
    return Run("r", "r.csv", t[keep], {"u": u[keep], "x": moved(u)[keep]})


def steps():
    return np.where(np.arange(COUNT) % 100 < 50, 1.5, -0.5)


def test_the_information_on_a_drive_is_the_sum_over_its_step_response(model):
    run = log(steps())
    bank = bank_of(model, run)
    found = information(effects_along(bank, run), ONSET, [ONSET], [ONSET + 50, COUNT - 1])
    t = STEP * np.arange(1, COUNT - ONSET + 1)  # an onset at a row acts from the row before on
    J = np.cumsum(((1 - np.exp(-A * t)) / A / SIGMA) ** 2)
    # what the first 600 rows leave open of the state costs exp(-A 60 s) of it, next to nothing
    assert found.own[:, 0] == pytest.approx([J[50], J[-1]], rel=1e-4)
    assert found.other[:, 0, 0] == pytest.approx(found.own[:, 0])
    assert found.shared[:, 0, 0, 0] == pytest.approx(found.own[:, 0])


def test_a_loss_of_gain_is_seen_as_the_input_moves(model):
    u = steps()
    run = log(u)
    found = information(effects_along(bank_of(model, run), run), ONSET, [ONSET], [COUNT - 1])
    late = np.where(np.arange(COUNT) >= ONSET - 1, u, 0.0)
    J = np.sum((moved(late) / SIGMA) ** 2)
    assert found.own[0, 1] == pytest.approx(J, rel=1e-4)
    still = log(0 * u)
    found = information(effects_along(bank_of(model, still), still), ONSET, [ONSET], [COUNT - 1])
    assert found.own[0, 1] == 0.0
    assert found.own[0, 0] > 0.0


def test_two_faults_that_are_one_leave_what_their_priors_say(model):
    """J - J^2 / (J + 1 / s^2) = J / (1 + J s^2), by hand."""
    run = log(steps())
    bank = bank_of(model, run)
    found = information(effects_along(bank, run), ONSET, around(ONSET, COUNT), [COUNT - 1])
    J, s = found.own[0, 0], float(bank.size[2])
    assert found.own[0, 2] == pytest.approx(J, rel=1e-6)
    left = information_left(found, bank, 0, 2)[0]
    # other onsets explain less than its own does, but for what a coarser one may round
    assert left == pytest.approx(J / (1 + J * s**2), rel=1e-3)
    assert left < 1e-3 * J


def test_a_gap_begins_the_states_anew_and_no_fault(model):
    """By least squares over both stretches, the second from a state that nobody knows."""
    u = steps()
    keep = (np.arange(COUNT) < 700) | (np.arange(COUNT) >= 800)
    run = log(u, keep)
    bank = bank_of(model, run)
    effects = effects_along(bank, run)
    assert len(effects.t) == 900
    found = information(effects, ONSET, [ONSET], [899])
    before = STEP * np.arange(1, 700 - ONSET + 1)
    J = np.sum(((1 - np.exp(-A * before)) / A / SIGMA) ** 2)
    after = STEP * np.arange(200)
    r, free = (1 - np.exp(-A * after)) / A, np.exp(-A * after)
    sd = start_spread(model, bank.noise, ())[0]
    C = SIGMA**2 * np.eye(200) + sd**2 * np.outer(free, free)
    J += r @ np.linalg.solve(C, r)
    assert found.own[0, 0] == pytest.approx(J, rel=1e-4)


def test_an_output_that_is_not_sampled_says_nothing(model):
    run = log(steps())
    sparse = np.where(np.arange(COUNT) % 4 == 0, run.columns["x"], np.nan)
    slow = Run("s", "s.csv", run.t, {**run.columns, "x": sparse})
    found = information(effects_along(bank_of(model, run), slow), ONSET, [ONSET], [COUNT - 1])
    k = np.arange(ONSET, COUNT)
    r = (1 - np.exp(-A * STEP * (k - ONSET + 1))) / A
    assert found.own[0, 0] == pytest.approx(np.sum((r[k % 4 == 0] / SIGMA) ** 2), rel=1e-3)


def test_the_smallest_size_by_hand(model):
    """2 ln odds of 98 %, 1.28 sd for nine in ten, prior and Occam factor of a log of 100 s."""
    run = log(steps())
    bank = bank_of(model, run)
    found = smallest_in(bank, run)
    assert found[0] is None  # drive and push are one
    J = np.sum((moved(np.where(np.arange(COUNT) >= COUNT // 2 - 1, steps(), 0.0)) / SIGMA) ** 2)
    level, prior = max(bank.level, np.log(49)), np.log(3 / (bank.onset[1] * 99.9))
    occam = np.log1p((0.02 * bank.size[1]) ** 2 * J) / 2
    alone = (np.sqrt(2 * (level + prior + occam)) + 1.2816) / np.sqrt(J)
    # beside a drive from any onset less is left, and a name needs that
    assert alone <= found[1] < 3 * alone


def test_the_smallest_size_is_of_the_judged_rows(model):
    """The first half of the log alone, and a fault that begins in the middle of that: what the
    other half would show counts for nothing, nor how long it is."""
    run = log(steps())
    bank = bank_of(model, run)
    half = np.arange(COUNT) < COUNT // 2
    found = smallest_in(bank, run, half)
    effect = moved(np.where(np.arange(COUNT) >= COUNT // 4 - 1, steps(), 0.0))
    J = np.sum((effect / SIGMA)[half] ** 2)
    level, prior = max(bank.level, np.log(49)), np.log(3 / (bank.onset[1] * 49.9))
    occam = np.log1p((0.02 * bank.size[1]) ** 2 * J) / 2
    alone = (np.sqrt(2 * (level + prior + occam)) + 1.2816) / np.sqrt(J)
    assert alone <= found[1] < 3 * alone
    assert found[1] > smallest_in(bank, run)[1]
    assert smallest_in(bank, run, np.zeros(COUNT, bool)) == [None] * 3
