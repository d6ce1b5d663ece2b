"""What goes on from a fit is kept where it is better on samples that no fit has seen, and only
there. The log to fit is of another plant than the one validated on: any refit of the truth is
worse."""

from dataclasses import replace

import numpy as np
import pytest

from faultgauge.identification.samples import channels
from faultgauge.identification.simulation_error import evidence, networks, search, stepping
from faultgauge.identification.simulation_error.candidate import Candidate, validated
from faultgauge.identification.simulation_error.data import prepare
from faultgauge.identification.simulation_error.records import records_of
from faultgauge.identification.unknowns import unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

HEATER = """
name = "heater"
[states.T]
derivative = "b*u - a*T"
[inputs.u]
hold = "zero"
[outputs.T]
value = "T"
[parameters]
a = { value = 0.8, min = 0 }
b = { value = 2.0, min = 0 }
"""
TRUTH, OTHER = (0.8, 2.0), (0.4, 3.0)
STEP, COUNT, NOISE = 0.1, 200, 0.02


def run(seed, plant):
    """T' = b u - a T under a zero-order hold: closed form."""
    a, b = plant
    rng = np.random.default_rng(seed)
    u, T, decay = np.repeat(rng.uniform(-2, 2, COUNT // 10), 10), np.zeros(COUNT), np.exp(-a * STEP)
    for k in range(COUNT - 1):
        T[k + 1] = decay * T[k] + (1 - decay) / a * b * u[k]
    y = T + NOISE * rng.standard_normal(COUNT)
    return Run(f"heat{seed}", "heat.csv", STEP * np.arange(COUNT), {"u": u, "T": y})


def candidate_of(unseen, text=HEATER):
    """(data, the file's constants, the truth) over a log of the other plant, validated on a log of
    `unseen`."""
    plant = GrayBoxPlant.untrained(parse_plant(text, "heater.toml"))
    runs = run(0, OTHER), run(1, unseen)
    how = channels(plant.spec, runs)
    logs, held = (records_of(plant.signals, [each], how) for each in runs)
    unknowns = unknowns_of(plant)
    data = prepare(plant.signals, logs, [np.ones(COUNT, bool)], held, 1, False, unknowns)
    found = data.fit_starts(plant, unknowns, unknowns.vector(plant))
    return data, validated(data, Candidate(plant, unknowns, found, np.inf, "physics"))


def said(text):
    """Nobody listens."""


@pytest.mark.parametrize(("unseen", "better"), [(TRUTH, False), (OTHER, True)])
def test_a_refit_to_all_samples_is_kept_where_it_wins(unseen, better):
    data, before = candidate_of(unseen)
    (after,) = search._on_all_samples(data, [before])
    if better:
        assert after.validation < 0.5 * before.validation
    else:
        np.testing.assert_array_equal(after.fitted.theta, before.fitted.theta)
        # the same constants; their start is fitted again, to a relative tolerance of 1e-5
        assert after.validation == pytest.approx(before.validation, rel=1e-3)


@pytest.mark.parametrize(("unseen", "substeps"), [(TRUTH, 1), (OTHER, 2)])
def test_finer_substeps_are_kept_where_they_win(monkeypatch, unseen, substeps):
    monkeypatch.setattr(search, "fine_enough", lambda data, candidate: data.substeps >= 2)
    data, before = candidate_of(unseen)
    (after,) = search._finer(data, [before], said)
    assert data.substeps == substeps
    assert (after is before) == (substeps == 1)


@pytest.mark.parametrize(("step", "substeps"), [(0.1, 1), (3.1, 1), (3.6, 1), (3.6, 2), (7.2, 2)])
def test_steps_are_stable_where_what_fades_does_so_in_them(step, substeps):
    """A step h of RK4 leaves 1 + z + z^2/2 + z^3/6 + z^4/24 of what fades, z = -0.8 h."""
    data, best = candidate_of(TRUTH)
    data.records = [replace(each, step=step) for each in data.records]
    data.substeps = substeps
    left = np.polyval([1 / 24, 1 / 6, 1 / 2, 1, 1], -0.8 * step / substeps)
    assert stepping.stable(data, best) == (abs(left) < 1)


def test_finer_substeps_are_kept_where_steps_are_not_stable_without(monkeypatch):
    monkeypatch.setattr(search, "fine_enough", lambda data, candidate: data.substeps >= 4)
    monkeypatch.setattr(search, "stable", lambda data, candidate: data.substeps >= 4)
    data, before = candidate_of(TRUTH)  # where no refit wins
    (after,) = search._finer(data, [before], said)
    assert data.substeps == 4
    assert after is not before


@pytest.mark.parametrize(("enough", "left"), [(None, 1), (2, 3), (4, 6), (20, 12)])
def test_no_more_substeps_are_kept_than_matter(monkeypatch, enough, left):
    """A heater moves by 0.08 of its time constant in a sample, for which one step does, unless so
    many are said to be `enough`; 6, 3 and 1 are tried."""
    data, best = candidate_of(TRUTH)
    data.substeps = 12
    if enough:
        monkeypatch.setattr(search, "fine_enough", lambda data, candidate: data.substeps >= enough)
    search._coarser(data, [best])
    assert data.substeps == left


def test_no_fewer_substeps_are_kept_than_rates_ask_for(monkeypatch):
    """A step of 0.02 / 0.8 s at most: four and a little in one of 0.1 s."""
    data, best = candidate_of(TRUTH)
    data.substeps = 12
    monkeypatch.setattr(search, "RATE_STEP", 0.0199)
    search._coarser(data, [best])
    assert data.substeps == 5


@pytest.mark.parametrize(("usable", "warned"), [(2, True), (3, False)])
def test_starts_that_are_lost_together_are_some_of_all(monkeypatch, usable, warned):
    """Three are, and so many others are not: 3 of 5 are most, 3 of 6 are not."""
    data, found = candidate_of(TRUTH)
    base = replace(found, validation=1.0)  # so that all is tried at once, too
    monkeypatch.setattr(networks, "_together", lambda *args: ([], 3))
    monkeypatch.setattr(networks, "_equivalent", lambda *args: [])
    monkeypatch.setattr(networks, "_from_silence", lambda *args: [base] * usable)
    monkeypatch.setattr(networks, "by_evidence", lambda data, each: each)
    notes = []
    networks.with_networks(data, [base], [], 0, 3, said, notes)
    assert [note.split(" start")[0] for note in notes] == ["networks: in 3 of 5"] * warned


@pytest.mark.parametrize(("unseen", "updated"), [(TRUTH, False), (OTHER, True)])
def test_a_new_prior_of_the_drift_is_kept_where_it_wins(monkeypatch, unseen, updated):
    monkeypatch.setattr(search, "drift_by_evidence", lambda data, candidate: np.array([2.0]))
    text = HEATER.replace("b = { value", 'b = { vary = "slow", value')
    data, before = candidate_of(unseen, text)
    prior = data.drift
    (after,) = search._choose_drift(data, [before])
    assert (after is before) != updated
    assert (data.drift is prior) != updated


def test_prior_weights_by_evidence_are_those_of_the_best_round(monkeypatch):
    """Errors of 0.5, 0.4 and 0.45 on unseen samples: the second round's fit."""
    data, before = candidate_of(TRUTH)
    errors = iter([0.5, 0.4, 0.45])
    monkeypatch.setattr(evidence, "_by_evidence", lambda data, candidate: np.zeros(0))
    monkeypatch.setattr(evidence, "fitted_again", lambda data, candidate, *_: candidate)
    monkeypatch.setattr(
        evidence, "validated", lambda data, candidate: replace(candidate, validation=next(errors))
    )
    assert evidence.by_evidence(data, before).validation == 0.4
