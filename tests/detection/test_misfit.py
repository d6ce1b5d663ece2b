"""Healthy logs that a model does not follow, and those that it only drifts along."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from faultgauge.detection.answer import swapped as columns
from faultgauge.detection.answer.misfit import not_followed
from faultgauge.detection.answer.swapped import swapped, swapped_in
from faultgauge.detection.decisions import unjudged
from faultgauge.detection.rows.prepared import prepared
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from models import record_of
from scenes import log, tank_bank

INTEGRATOR = """
name = "position"
[states.x]
unit = "m"
derivative = "u"
[inputs.u]
unit = "m/s"
[outputs.x]
unit = "m"
value = "x"
"""
USUAL = 0.01  # of the spread: the free run's error on what the fit held out


@pytest.mark.parametrize(("off", "told"), [(0.0, False), (0.002, False), (0.02, True)])
def test_a_plant_that_integrates_is_judged_over_what_a_fit_holds_out(off, told):
    """A rate that is off by 0.002 m/s carries the free run through all 2000 s off by 2.3 m in the
    mean, a fifth of the spread of x; through a seventh of them by a seventh of that."""
    t = np.arange(0.0, 2000.0, 1.0)
    u = np.cos(2 * np.pi * t / 100)
    x = 100 / (2 * np.pi) * np.sin(2 * np.pi * t / 100) + off * t
    model = Model(
        GrayBoxPlant.untrained(parse_plant(INTEGRATOR)),
        record_of(metrics={"validation_free_run_nrmse": USUAL}),
    )
    # u is held from sample to sample: its mean over the step
    held = np.append(np.diff(x - off * t), 0.0)
    run = Run("a", "a.csv", t, {"u": held, "x": x})
    assert bool(not_followed(model, [run])) == told
    assert np.abs(u).max() == 1.0


def test_what_a_free_run_did_not_tell_of_the_fit_it_does_not_tell_of_a_log():
    """Off by ten times the spread, as a plant that runs away without its loop is."""
    t = np.arange(0.0, 2000.0, 1.0)
    run = Run("a", "a.csv", t, {"u": np.full(len(t), 1.0), "x": np.sin(t)})
    plant = GrayBoxPlant.untrained(parse_plant(INTEGRATOR))
    said = [
        not_followed(Model(plant, record_of(metrics={"validation_free_run_nrmse": usual})), [run])
        for usual in (0.49, 0.5, None)
    ]
    assert [len(each) for each in said] == [1, 0, 0]


TWO = """
name = "two rooms"
[states.a]
unit = "degC"
derivative = "(u - a)/20"
[states.b]
unit = "degC"
derivative = "(a - b)/60"
[inputs.u]
unit = "degC"
[outputs.warm]
unit = "degC"
value = "a"
[outputs.cool]
unit = "degC"
value = "b"
"""
BOTH = {"warm": "cool", "cool": "warm"}


def rooms(bias=0.0, seed=0):
    """Two rooms behind each other, exact under the hold, their thermometers in one range."""
    rng, count = np.random.default_rng(seed), 2000
    u = np.repeat(rng.uniform(10, 30, count // 100), 100)
    a, b = np.full(count, u[0]), np.full(count, u[0])
    A = expm(np.array([[-1 / 20, 0.0, 1 / 20], [1 / 60, -1 / 60, 0.0], [0.0, 0.0, 0.0]]))
    for k in range(count - 1):
        a[k + 1], b[k + 1], _ = A @ (a[k], b[k], u[k])
    noise = 0.05 * rng.standard_normal((2, count))
    columns = {"u": u, "warm": a + noise[0] + bias, "cool": b + noise[1]}
    return Run("a", "a.csv", np.arange(float(count)), columns)


def exchanged(run, names):
    return replace(run, columns=run.columns | {a: run.columns[b] for a, b in names.items()})


@pytest.fixture(scope="module")
def two():
    return Model(
        GrayBoxPlant.untrained(parse_plant(TWO)),
        record_of(metrics={"validation_free_run_nrmse": 0.02}),
    )


def test_exchanged_columns_of_one_range_are_told_and_what_to_do(two):
    (said,) = swapped(two, [exchanged(rooms(), BOTH)])
    assert said.startswith("run a: the columns warm and cool look swapped: as they are, the ")
    assert said.endswith(" %; if they are, give --map warm=cool --map cool=warm")
    # an input may be one of them
    (said,) = swapped(two, [exchanged(rooms(), {"warm": "u", "u": "warm"})])
    assert "the columns warm and u look swapped" in said


@pytest.mark.parametrize("bias", [0.0, 2.0, 20.0])
def test_a_log_as_it_is_is_not_taken_for_exchanged(two, bias):
    """Nor one with a fault of any size in one of the two."""
    assert swapped(two, [rooms(bias)]) == []


def test_a_free_run_that_blows_up_is_said_in_words(two, monkeypatch):
    first = iter([np.inf])
    monkeypatch.setattr(columns, "_off", lambda model, run: next(first, 0.02))
    (said,) = swapped(two, [rooms()])
    assert "the healthy model's free run runs away, with the two exchanged 2 %;" in said


def test_columns_of_other_units_are_not_exchanged(two):
    """Two rooms of which one is measured in K: its numbers are no other's."""
    text = TWO.replace('[outputs.cool]\nunit = "degC"', '[outputs.cool]\nunit = "K"')
    other = Model(GrayBoxPlant.untrained(parse_plant(text)), two.record)
    assert swapped(other, [exchanged(rooms(), BOTH)]) == []


def test_of_judged_logs_those_that_look_healthy_are_not_asked(two):
    run = exchanged(rooms(), BOTH)
    rows, model, other = len(run.t), tank_bank().model, log(2)
    judged = unjudged(model, other, prepared(model.plant.signals, other), {})
    for healthy, told in ((0.4, 1), (0.6, 0)):
        count = round(healthy * rows)
        status = ["HEALTHY"] * count + ["FAULT"] * (rows - count)
        one = replace(judged, run=run, status=status)
        assert len(swapped_in(two, [one])) == told
