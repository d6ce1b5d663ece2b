"""A proposed test input, simulated by hand, tells what was promised."""

from copy import copy

import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.posterior.unit_faults import effects_of
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.foresight.experiments import KINDS, InputTrials, propose
from faultgauge.foresight.problems import Problem

STEP, SIGMA, SLOW, BASE = 0.1, 0.05, 0.5, 2.0


@pytest.fixture(scope="module")
def bench(modelled, log):
    run = log(np.full(600, BASE))
    bank = build_fault_bank(modelled(), [run], noise_of(modelled()))
    found = InputTrials(bank, run, effects_of(bank, as_it_acts(bank.model.plant.signals, run)))
    found.rows = 200  # a shorter multisine promises too much: KNOWN_GAPS.md, Proposed test inputs
    return found


def response(u):
    """What a unit of u does to x within each step, from rest, at the steps' ends."""
    x, decay, out = 0.0, np.exp(-SLOW * STEP), []
    for each in u:
        x = decay * x + (1 - decay) / SLOW * each
        out.append(x)
    return np.array(out)


def apart_from(u, size_of_rival):
    """The size of push told from a loss of gain, both from the test's begin on, by least squares in
    white noise: the state is known from 60 s before."""
    before = np.append(BASE, u[:-1])  # what is held until a row
    push, loss = response(np.ones(len(u))) / SIGMA, -response(before) / SIGMA
    left = push @ push - (push @ loss) ** 2 / (loss @ loss + size_of_rival**-2.0)
    return (np.sqrt(2 * np.log(49)) + 1.2816) / np.sqrt(left)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_promised_is_what_a_simulation_by_hand_leaves(bench, kind):
    problem = Problem(0, 1, 0.5)
    u = bench.shaped(0, kind, -1.5)
    told = bench.told(u, problem)
    expected = apart_from(u[:, 0], float(bench.bank.size[1]))
    # the state before the test is known to sigma / 24 and not exactly
    assert told.promised == pytest.approx(expected, rel=0.02)
    assert told.obtained == pytest.approx(expected, rel=0.02)
    assert told.safe


def test_the_least_test_that_tells_two_faults_apart(bench):
    problem = Problem(0, 1, 0.5)
    standing = bench.told(bench.shaped(0, "step", 0.0), problem)
    assert not standing.reaches(0.5)  # while the input stands they are one
    found = propose(bench, problem)
    assert found is not None
    assert found.input == "u"
    assert found.base == BASE
    assert -4 <= found.base + found.amplitude <= 4
    assert found.told.reaches(0.5)
    u = bench.shaped(0, found.kind, found.amplitude)
    assert apart_from(u[:, 0], float(bench.bank.size[1])) == pytest.approx(0.5, rel=0.1)
    half = bench.told(bench.shaped(0, found.kind, found.amplitude / 2), problem)
    assert not half.reaches(0.5)


def test_nothing_is_proposed_that_leaves_the_limits_or_tells_nothing(bench):
    assert propose(bench, Problem(0, 1, 1e-6)) is None
    assert bench.room(0) == pytest.approx(-(BASE + 4), abs=0.5)  # what training covered, at most
    tight = copy(bench)
    tight.high = np.array([6.0])  # m, where x would go to (2 + 2) / 0.5
    assert not tight.told(bench.shaped(0, "step", 2.0), Problem(0, 1, 0.5)).safe
