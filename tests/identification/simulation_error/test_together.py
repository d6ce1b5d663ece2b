"""Plants that do nothing sensible without their networks."""

import numpy as np
import pytest

from faultgauge.identification.fit import fit
from faultgauge.identification.samples import channels
from faultgauge.identification.simulation_error import networks
from faultgauge.identification.simulation_error.data import prepare
from faultgauge.identification.simulation_error.records import records_of
from faultgauge.identification.simulation_error.window_fit import simulated
from faultgauge.identification.unknowns import unknowns_of
from faultgauge.identification.validation.evaluation import evaluate
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

pytestmark = pytest.mark.study

TANKS = """
name = "two tanks"
[states.upper]
derivative = "b*u - k*sqrt(max(upper, 0.001))"
min = 0
[states.lower]
derivative = "k*sqrt(max(upper, 0.001)) - outflow(lower)"
[inputs.u]
hold = "zero"
[outputs.lower]
value = "lower"
[parameters]
k = { value = 0.5, min = 0 }
b = { value = 1.0, min = 0 }
[networks.outflow]
hidden = 3
"""
B, K, OUT, STEP, COUNT, NOISE = 1.2, 0.6, 0.7, 0.1, 600, 0.005


def run(seed):
    """The lower tank empties as 0.7 of its level; Euler steps of a tenth of a sample."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0, 1, COUNT // 20), 20)
    upper, lower, levels = 0.5, 0.5, []
    for k in range(COUNT):
        levels.append(lower)
        for _ in range(10):
            through = K * np.sqrt(max(upper, 0.001))
            upper = max(upper + STEP / 10 * (B * u[k] - through), 0.0)
            lower = lower + STEP / 10 * (through - OUT * lower)
    noisy = np.array(levels) + NOISE * rng.standard_normal(COUNT)
    return Run(f"tanks{seed}", "tanks.csv", STEP * np.arange(COUNT), {"u": u, "lower": noisy})


def test_a_network_that_the_physics_cannot_do_without():
    """With a silent network the lower tank only ever fills, and the best physics is that nothing
    flows at all: no start for anything."""
    plant = GrayBoxPlant.untrained(parse_plant(TANKS, "tanks.toml"))
    model, report = fit(plant, [run(0), run(1)], restarts=5)
    tried = dict(report.refinement.tried)
    assert tried["physics"] > 0.5  # or this plant tests nothing
    spread = np.std(np.concatenate([run(seed).columns["lower"] for seed in (0, 1)]))
    # the noise is known to a few percent from a sixth of 1200 samples; Euler's steps and three
    # hidden units may take as much again
    assert report.refinement.error < 1.3 * NOISE / spread
    assert float(model.plant.parameters["k"]) == pytest.approx(K, rel=0.03)
    unseen, _ = evaluate(model.plant, [run(2)], model.max_step)
    assert unseen["outputs"]["lower"]["rmse"] < 1.5 * NOISE


HIDDEN = """
name = "hidden"
[states.h]
derivative = "rate(h, u)"
[inputs.u]
hold = "zero"
[outputs.y]
value = "g*h"
[parameters]
g = { value = 2.0, fixed = true }
[networks.rate]
hidden = 2
"""


def test_an_argument_that_only_networks_move():
    """Nothing moves h at the file's values, so that its range is not known there."""
    plant = GrayBoxPlant.untrained(parse_plant(HIDDEN, "hidden.toml"))
    logs = [
        Run(each.name, each.source, each.t, {"u": each.columns["u"], "y": each.columns["lower"]})
        for each in (run(0), run(1))
    ]
    _, report = fit(plant, logs, restarts=1)
    tried = dict(report.refinement.tried)
    assert tried["physics"] > 0.5  # or nothing would be fitted together
    assert report.refinement.error < 0.5


def test_what_was_fitted_afresh_stands_among_the_others(monkeypatch):
    """With as many substeps as it needed, and its starts beside the others' guesses of them."""
    plant = GrayBoxPlant.untrained(parse_plant(TANKS, "tanks.toml"))
    records = records_of(plant.signals, [run(0)], channels(plant.spec, [run(0)]))
    masks = [np.arange(COUNT) < 500]
    data = prepare(plant.signals, records, masks, [], 1, False, unknowns_of(plant))
    monkeypatch.setattr(networks, "fine_enough", lambda data, candidate: data.substeps >= 2)
    found, lost = networks._together(data, plant, 0, 1, lambda text: None)
    assert lost == 0
    assert data.substeps == 2
    windows = data.windows(data.pieces)
    for each in found:
        theta, z = each.fitted.theta, each.fitted.z
        x, _ = simulated(each.plant, each.unknowns, theta, z, windows, data.substeps)
        # the starts to rounding; what follows them depends on the substeps of its round
        np.testing.assert_allclose(x[:, 0], each.fitted.x[:, 0], rtol=1e-9)
    assert found
