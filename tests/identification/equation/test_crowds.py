"""Arguments that seldom leave a small part of their range: where units start is chosen."""

import numpy as np
import pytest

from faultgauge.identification.equation.groups import Group, crowds, scale_networks
from faultgauge.identification.fit import fit
from faultgauge.identification.samples import Samples
from faultgauge.identification.simulation_error.networks import CROWDED
from faultgauge.identification.validation.evaluation import evaluate
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.reporting.chapters import fit_sections
from faultgauge.telemetry import Run

pytestmark = pytest.mark.usefixtures("quick_code")

PLANT = """
name = "filter"
[states.x]
derivative = "g(u) - 2*x"
[inputs.u]
hold = "zero"
[outputs.y]
value = "x"
[networks.g]
hidden = 6
"""
STEP, WIDTH, COUNT, EVERY = 0.05, 10, 2400, 13  # u is far off in every 13th stair


def near(u):
    """All that happens is among the many small inputs."""
    return np.sin(3 * np.clip(u, -1, 1))


def far(u):
    """All that happens is among the few large ones."""
    return 2 * np.tanh((u - 10) / 3) + 2 * np.tanh((u + 10) / 3)


def log(truth, seed, count=COUNT):
    """x' = g(u) - 2 x under a zero-order hold: closed form."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, count // WIDTH)
    rare = np.arange(3, len(u), EVERY)
    u[rare] = rng.uniform(-20, 20, len(rare))
    u = np.repeat(u, WIDTH)
    goal, x, decay = truth(u) / 2, np.zeros(count), np.exp(-2 * STEP)
    for k in range(count - 1):
        x[k + 1] = goal[k] + (x[k] - goal[k]) * decay
    return Run(f"{truth.__name__}{seed}", "f.csv", STEP * np.arange(count), {"u": u, "y": x})


def plant(text=PLANT):
    return GrayBoxPlant.untrained(parse_plant(text, "filter.toml"))


def fitted(truth, seed):
    logs = [log(truth, 3 * seed + k) for k in range(3)]
    model, report = fit(plant(), logs[:1], logs[1:2], seed=seed)
    (group,) = report.groups
    scores, _ = evaluate(model.plant, logs[2:], model.max_step)
    return model, report, group, scores


@pytest.mark.study
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("truth", "crowded"), [(near, True), (far, False)])
def test_units_stand_where_validation_says(truth, crowded, seed):
    model, report, group, scores = fitted(truth, seed)
    assert group.crowded is crowded
    over_range, in_crowd = group.free_run[0::2].min(), group.free_run[1::2].min()
    assert (in_crowd < over_range) == crowded
    (record,) = model.record.metrics.groups
    assert record["crowded"] is crowded
    # unseen stairs: 18 rare ones in training leave gaps of some units of u between them, and what
    # stands in a gap for a thirteenth of the time may be off by half the spread
    assert scores["outputs"]["y"]["nrmse"] < 0.25
    (said,) = [text for text in fit_sections(model, report)[0].paragraphs if "small part" in text]
    assert ("over the whole range" in said) is not crowded


@pytest.mark.study
def test_a_refinement_tries_both_and_names_what_it_chose():
    logs = [log(near, k, 1200) for k in range(2)]
    for each in logs:
        each.columns["y"] *= 2
    body = plant(PLANT.replace('value = "x"', 'value = "2*x"'))  # x is hidden then
    model, report = fit(body, logs[:1], logs[1:], restarts=2)
    refinement = report.refinement
    assert refinement is not None
    tried = dict(refinement.tried)
    for margin in ("1.2", "2"):
        name = f"networks, margin {margin}"
        assert tried[f"{name}, {CROWDED}"] != tried[name]
    assert tried[refinement.chosen] == min(tried.values())
    assert model.record.metrics.refinement["chosen"] == refinement.chosen


def found(u, keys=""):
    """Where A(x, u) crowds over x = -1 ... 1 and `u`, and how it is scaled."""
    text = PLANT.replace("g(u) - 2*x", "g(x, u)").replace("hidden = 6", f"hidden = 6\n{keys}")
    body, x = plant(text), np.linspace(-1, 1, len(u))
    samples = Samples(x[:, None], np.asarray(u)[:, None], x[:, None], x[:, None])
    group = Group((0,), (), ("g",), ())
    body = scale_networks(body, group, samples)
    return crowds(body, group, samples), body.networks["g"]


def test_a_crowd_by_hand():
    """99 inputs from 2 to 4 and one of 103: quantiles at 4.95 and 94.05 of 0 ... 99."""
    u = np.append(np.linspace(2, 4, 99), 103.0)
    boxes, network = found(u)
    low, high = 2 + 4.95 * 2 / 98, 2 + 94.05 * 2 / 98
    np.testing.assert_allclose(boxes["g"].center, [0, (low + high) / 2], atol=1e-12)  # rounding
    np.testing.assert_allclose(boxes["g"].half, [1, (high - low) / 2], rtol=1e-12)
    np.testing.assert_allclose(network.input_center, [0, 52.5])  # the range holds all, as ever
    np.testing.assert_allclose(network.input_scale, [1, 50.5])
    mirrored, _ = found(u, "odd = true")
    np.testing.assert_allclose(mirrored["g"].center, [0, 0], atol=1e-12)
    np.testing.assert_allclose(mirrored["g"].half, [1, high], rtol=1e-12)


@pytest.mark.parametrize(
    "u",
    [
        np.random.default_rng(0).uniform(-1, 1, 10_000),
        np.random.default_rng(0).standard_normal(10_000),
        np.random.default_rng(0).laplace(size=10_000),
        np.where(np.arange(10_000) % 30, 0.0, 1.0),  # at rest but for pulses
    ],
)
def test_usual_signals_do_not_crowd(u):
    assert found(u)[0] == {}
