"""Healthy logs that a model does not follow, and those that it only drifts along."""

import numpy as np
import pytest

from faultgauge.detection.answer.misfit import not_followed
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from models import record_of

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
