"""Standard errors of the equation error against the scatter of fits to many logs."""

import json

import equinox as eqx
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, chi2

from faultgauge.identification.equation import fit as equation_fit
from faultgauge.identification.equation.uncertainty import equation_information, scatter
from faultgauge.identification.fit import fit
from faultgauge.identification.samples import channels
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.reporting.refinement_chapter import correlation_table
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
A, B, STEP, COUNT = 0.8, 2.5, 0.05, 1600
LOGS = 40
# Process noise of 0.1 m / sqrt(s) scatters x by 0.08 m, where the input moves it by 2 m: what the
# smoothing's two sides let in of it biases a by the square of that, a tenth of its scatter.
NOISE = 0.1
MEMORY = 0.5  # s, of the coloured process noise: ten samples
SENSOR = 0.02  # m, white


def log(seed, kind="process"):
    """x' = b u - a x + w under a zero-order hold, w white (the exact step of the stochastic
    equation), or held and coloured; or x as a noisy sensor shows it."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, COUNT // 20), 20)
    decay, keep, white = np.exp(-A * STEP), np.exp(-STEP / MEMORY), rng.standard_normal(COUNT)
    moved = {
        "process": NOISE * np.sqrt((1 - decay**2) / (2 * A)) * white,
        "coloured": NOISE * (1 - decay) / A * lfilter([np.sqrt(1 - keep**2)], [1, -keep], white),
        "sensor": np.zeros(COUNT),
    }[kind]
    x = lfilter([0, 1], [1, -decay], (1 - decay) / A * B * u + moved)
    x += SENSOR * white if kind == "sensor" else 0.0
    return Run(f"run{seed}", "a.csv", STEP * np.arange(COUNT), {"u": u, "x": x})


def fitted(text, run):
    return fit(GrayBoxPlant.untrained(parse_plant(text, "plant.toml")), [run], restarts=1)[1]


def table(known):
    """(values, standard errors), a row per log."""
    keys = ("value", "standard_error")
    return (np.array([[getattr(c, k) for c in each.constants] for each in known]) for k in keys)


@pytest.mark.parametrize(
    ("kind", "points"),
    [
        # with fewer samples, drawn, below
        pytest.param("sensor", 10_000, marks=pytest.mark.study),
        ("sensor", 300),
        pytest.param("process", 10_000, marks=pytest.mark.study),
        # a sum with memory: `scatter` below
        pytest.param("coloured", 10_000, marks=pytest.mark.study),
    ],
)
def test_standard_errors_are_the_scatter(monkeypatch, kind, points):
    """Of all samples, and of the 300 that are drawn from long logs, say.

    Independent residuals would say 4.1 and 2.5 times the scatter of a and b under the sensor's
    noise and 0.6 of it under the process'. Kernels differ from log to log, so squares are compared:
    their mean is the scatter's, whatever the mixture.
    """
    monkeypatch.setattr(equation_fit, "POINTS", points)
    known = [fitted(PLANT, log(seed, kind)).information for seed in range(LOGS)]
    values, errors = table(known)
    ratio = np.mean(errors**2, axis=0) / values.var(axis=0, ddof=1)
    # The scatter of 40 logs is a chi-square of 39, one in a thousand on either side of it: 0.54 to
    # 2.4. (600 logs: 0.91 to 1.07, each known to 6 %.)
    low, high = (LOGS - 1) / chi2.ppf([0.999, 0.001], LOGS - 1)
    assert np.all((ratio > low) & (ratio < high))
    inside = np.sum(np.abs(values - values.mean(axis=0)) < 1.96 * errors, axis=0)
    assert np.all(inside >= binom.ppf(1e-3, LOGS, 0.93))  # of 24 cosines: Student's t, not normal
    told = np.mean([each.correlation[0, 1] for each in known])
    true = np.corrcoef(values.T)[0, 1]
    # by Fisher's transform, of the scatter's own; three and a half of its standard deviations
    assert np.arctanh(told) == pytest.approx(np.arctanh(true), abs=3.5 / np.sqrt(LOGS - 3))
    assert [c.unit for c in known[0].constants] == ["1/s", "m/(V*s)"]


def test_scatter_of_a_sum_with_and_without_memory():
    """White noise, its difference, and its sum with memory, some of the places left out."""
    rng = np.random.default_rng(0)
    places = np.sort(rng.permutation(3000)[:2000])
    sums, told = [], []
    for _ in range(400):
        white = rng.standard_normal(3001)
        z = np.stack([white[1:], np.diff(white), lfilter([1], [1, -0.8], white)[1:]], axis=1)
        sums.append(z[places].sum(axis=0))
        told.append(np.diag(scatter(z[places], places, 3000)))
    # a variance of 400 is known to 7 %, three of that
    np.testing.assert_allclose(np.mean(told, axis=0), np.var(sums, axis=0), rtol=0.22)


def test_a_fit_that_stopped_early_says_how_far():
    """Off by 0.3, as networks leave a parameter, against 0.02 of noise."""
    plant = GrayBoxPlant.untrained(parse_plant(PLANT, "plant.toml"))
    how = channels(plant.spec, [log(0)])
    given = equation_fit.material(plant.spec, [log(0)], [], how, 0)
    said = equation_fit.fit_equations(plant, how, given, 0, 1, "lm", lambda text: None)
    off = eqx.tree_at(lambda p: p.parameters["b"], said.plant, replace_fn=lambda b: b + 0.3)
    a, b = equation_information(off, how, said.reports, given).constants
    assert b.standard_error == pytest.approx(0.3, rel=0.1)  # what moves b moves the cosines, too
    assert a.standard_error < 0.1


def test_one_that_is_held_by_its_bound_does_not_move():
    """As if the file had fixed it there."""
    told = []
    for key in ("value = 1.0, max = 2.0", "value = 2.0, fixed = true"):
        text = PLANT.replace("b = { value = 1.0", f"b = {{ {key}")
        told.append(fitted(text, log(0)).information.constants[0])
    assert told[0].value == pytest.approx(told[1].value, rel=1e-6)  # where the fits stop
    assert told[0].standard_error == pytest.approx(told[1].standard_error, rel=1e-4)


def test_what_the_log_does_not_tell_has_no_standard_error():
    """c stands in an output without telemetry; b is at its bound."""
    text = PLANT.replace("b = { value = 1.0,", "b = { value = 1.0, max = 2.0,")
    text = text.replace(
        "[parameters]", '[outputs.z]\nvalue = "c*x"\n[parameters]\nc = { value = 3 }'
    )
    report = fitted(text, log(0))
    constants = {c.name: c for c in report.information.constants}
    assert constants["a"].standard_error is not None
    assert constants["b"].standard_error is None
    assert constants["c"].standard_error is None
    (said,) = [each for each in report.warnings if "'c' moves no equation" in each]
    assert "its value, 3, is not the data's" in said
    rows = json.loads(json.dumps(report.information.to_dict(), allow_nan=False))["correlation"]
    assert rows == [[1, None, None], [None, 1, None], [None, None, 1]]
    assert correlation_table(report.information) == ()


def test_two_parameters_that_do_the_same():
    text = PLANT.replace("- a*x", "- a*x - c*x") + "c = { value = 1.0, min = 0 }\n"
    report = fitted(text, log(0))
    assert any("'a' and 'c' cannot be told apart" in each for each in report.warnings)
    assert not any("told apart" in each for each in fitted(PLANT, log(0)).warnings)
