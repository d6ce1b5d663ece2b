"""Standard errors of the equation error against the scatter of fits to many logs."""

import numpy as np
import pytest
from scipy.stats import binom

from faultgauge.identification import equation_fit
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

PLANT = """
name = "first order"
[states.x]
unit = "m"
derivative = "b*u - a*x"
[inputs.u]
unit = "V"
hold = "zero"
[outputs.x]
unit = "m"
value = "x"
[parameters]
a = { value = 1.0, min = 0, unit = "1/s" }
b = { value = 1.0, unit = "m/(V*s)" }
"""
A, B, STEP, COUNT = 0.8, 2.5, 0.05, 800
LOGS = 40
# Process noise of 0.1 m / sqrt(s) scatters x by 0.08 m, where the input moves it by 2 m: what the
# smoothing's two sides let in of it biases a by the square of that, a tenth of its scatter.
NOISE = 0.1


def log(seed):
    """x' = b u - a x + w under a zero-order hold: the exact step of the stochastic equation."""
    rng = np.random.default_rng(seed)
    u, x = np.repeat(rng.uniform(-2, 2, COUNT // 20), 20), np.zeros(COUNT)
    decay = np.exp(-A * STEP)
    w = NOISE * np.sqrt((1 - decay**2) / (2 * A)) * rng.standard_normal(COUNT)
    for k in range(COUNT - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / A * B * u[k] + w[k]
    return Run(f"run{seed}", "a.csv", STEP * np.arange(COUNT), {"u": u, "x": x})


def fitted(text, run):
    return fit(GrayBoxPlant.untrained(parse_plant(text, "plant.toml")), [run], restarts=1)[1]


@pytest.mark.parametrize("points", [10_000, 300])
def test_standard_errors_are_the_scatter(monkeypatch, points):
    """Of all samples, and of the 300 that are drawn from long logs, say."""
    monkeypatch.setattr(equation_fit, "POINTS", points)
    known = [fitted(PLANT, log(seed)).information for seed in range(LOGS)]
    values, errors = (
        np.array([[getattr(c, key) for c in each.constants] for each in known], float)
        for key in ("value", "standard_error")
    )
    scatter = values.std(axis=0, ddof=1)
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / scatter
    # 40 logs tell a scatter to 11 %; three times that. White residuals would give 0.45 of it.
    assert np.all((ratio > 1 / 1.4) & (ratio < 1.4))
    inside = np.sum(np.abs(values - [A, B]) < 1.96 * errors, axis=0)
    assert np.all(inside >= binom.ppf(1e-3, LOGS, 0.95))
    told = np.mean([each.correlation[0, 1] for each in known])
    assert told == pytest.approx(np.corrcoef(values.T)[0, 1], abs=0.35)  # 0.12 of 40, thrice
    assert [c.unit for c in known[0].constants] == ["1/s", "m/(V*s)"]


def test_what_the_log_does_not_tell_has_no_standard_error():
    """c stands in an output without telemetry; b is at its bound."""
    text = PLANT.replace("b = { value = 1.0,", "b = { value = 1.0, max = 2.0,")
    text = text.replace(
        "[parameters]", '[outputs.z]\nvalue = "c*x"\n[parameters]\nc = { value = 3 }'
    )
    constants = {c.name: c for c in fitted(text, log(0)).information.constants}
    assert constants["a"].standard_error is not None
    assert constants["b"].standard_error is None
    assert constants["c"].standard_error is None


def test_two_parameters_that_do_the_same():
    text = PLANT.replace("- a*x", "- a*x - c*x") + "c = { value = 1.0, min = 0 }\n"
    report = fitted(text, log(0))
    assert any("'a' and 'c' cannot be told apart" in each for each in report.warnings)
    assert not any("told apart" in each for each in fitted(PLANT, log(0)).warnings)
