"""The validation chapter: each sentence from its numbers, each axis with its unit."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from faultgauge.identification.samples import Samples
from faultgauge.identification.validation.evaluation import Prediction
from faultgauge.identification.validation.validate import validate
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.reporting.report import Report, render
from faultgauge.reporting.validation_chapter import validation_section, verdicts

WHEEL = """
name = "wheel"
[states.h]
unit = "N*m*s"
derivative = "u - NN(h)"
[inputs.u]
unit = "N*m"
[outputs.hm]
unit = "N*m*s"
value = "h"
[networks.NN]
hidden = 2
"""
COUNT, RUNS, STEP = 1500, 5, 0.1


def plant():
    return GrayBoxPlant.untrained(parse_plant(WHEEL, "wheel.toml"))


def prediction(errors, u, h, run="a", warmup=0):
    predicted = h[:, None]
    t = 7.0 + STEP * np.arange(len(h))
    return Prediction(run, t, predicted + errors[:, None], predicted, predicted, warmup, u[:, None])


def free_runs(error):
    """Five runs of white signals; `error` makes the residual of (noise, u, h)."""
    rng = np.random.default_rng(0)
    found = []
    for k in range(RUNS):
        noise, u, h = rng.standard_normal((3, COUNT))
        found.append(prediction(error(noise, u, h), u, h, run=f"run {k}"))
    return found


def training(reach=6.0):
    x = np.linspace(-reach, reach, 100)[:, None]
    return Samples(x, x, x, x)


def said(predictions, others=(), band=None):
    found = validate(plant(), predictions, training(), others, band)
    return " ".join(line for each in found.outputs for line in verdicts(each))


def test_a_model_without_fault_is_praised_for_what_was_shown():
    text = said(free_runs(lambda noise, u, h: noise))
    assert "hm: e is white" in text
    assert "cannot be told from zero" in text
    assert "the band keeps its promise" in text
    assert "does not follow input u" in text
    assert "would go unseen" in text
    assert "no place stands out" in text
    assert "% of the output's spread in these data)" in text


def test_a_place_that_is_one_value_is_said_as_one():
    """An error of 0.3 wherever an input of two values has the upper one."""
    rng, runs = np.random.default_rng(0), []
    for k in range(RUNS):
        noise, h = rng.standard_normal((2, COUNT))
        u = rng.choice([-1.0, 1.0], COUNT)
        runs.append(prediction(0.1 * noise + np.where(u > 0, 0.3, 0.0), u, h, run=f"run {k}"))
    assert "RMS, where u is 1\u00a0N·m; " in said(runs)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (lambda noise, u, h: noise + 0.3 * np.roll(u, 5), "e follows input u (r = 0."),
        (lambda noise, u, h: noise + 0.3 * np.roll(u, -5), "input u follows e"),
        (lambda noise, u, h: noise + h**2, "the model is wrong in places, by much"),
        (lambda noise, u, h: np.cumsum(noise) / 30, "e is not white"),
        (lambda noise, u, h: noise + 0.5, "is a lasting offset"),
    ],
)
def test_each_fault_has_its_sentence(error, sentence):
    assert sentence in said(free_runs(error))


def test_a_band_that_promises_too_much_or_too_little():
    runs = free_runs(lambda noise, u, h: noise)
    assert "the band promises too much" in said(runs, band={"hm": 0.5})
    assert "the band is wider than it need be" in said(runs, band={"hm": 4.0})


def test_too_few_independent_samples_confirm_nothing():
    t = np.linspace(0, 3, 300)
    text = said([prediction(np.sin(t), np.cos(9 * t), np.sin(2 * t))])
    assert "too few independent samples to refute the band, or to confirm it" in text
    assert "95 % would take 19 independent samples" in text
    assert "too few independent samples to tell" in text


def test_the_luck_of_the_seed():
    runs = free_runs(lambda noise, u, h: noise)
    # the other start is off by 1 more: mean square error 0.25 + noise, of which 0.25 differs
    other = [p._replace(predicted=p.predicted + 1.0) for p in runs]
    assert "over 2 seeds, each a whole fit, e is" in said(runs, [other])
    lost = [p._replace(predicted=p.predicted * np.inf) for p in runs]
    assert "1 diverge." in said(runs, [other, lost])


def test_runs_that_diverge_or_are_too_short_are_named():
    (run, *_) = free_runs(lambda noise, u, h: noise)
    lost = run._replace(predicted=np.full_like(run.predicted, np.nan))
    assert said([lost]) == "hm: the free run diverges, so nothing else was tested."
    short = prediction(np.arange(5.0), np.arange(5.0), np.arange(5.0))
    assert said([short]) == "hm: 5 samples are too few to test anything."
    section = validation_section(plant(), validate(plant(), [short], training()), [short])
    assert len(section.figures) == 1  # the ranges need no statistics


def test_the_section_has_every_figure_with_units_and_stays_small():
    runs = free_runs(lambda noise, u, h: noise)
    section = validation_section(plant(), validate(plant(), runs, training(2.0)), runs)
    assert len(section.figures) == 4
    words = [" ".join(ET.fromstring(each.svg).itertext()) for each in section.figures]
    for text, wanted in zip(
        words,
        (
            ("(N·m·s)", "time since the start of the run (s)"),
            ("autocorrelation (1)", "correlation with u (1)", "lag (s)"),
            ("h (N·m·s)", "u (N·m)", "error of hm"),
            ("NN: h", "input: u", "% outside"),
        ),
        strict=True,
    ):
        assert all(part in text for part in wanted), (text, wanted)
    page = render(Report("Validation", ("Held out.",), (section,), versions={}))
    # 7500 samples of five runs: each curve is thinned to the width of the page
    assert len(page) < 200_000
    assert "nan" not in " ".join(section.paragraphs).lower()


def test_empty_cells_leave_the_section_whole():
    runs = free_runs(lambda noise, u, h: noise)
    for run in runs:
        run.measured[::7] = np.nan
    section = validation_section(plant(), validate(plant(), runs, training(2.0)), runs)
    assert len(section.figures) == 4
    assert "nan" not in " ".join(section.paragraphs).lower()
    assert "hm: e is white" in said(runs)


def test_the_outermost_argument_is_named():
    runs = free_runs(lambda noise, u, h: noise)
    section = validation_section(plant(), validate(plant(), runs, training(1.0)), runs)
    # |h| > 1 holds for 31.7 % of a normal variable's values, 7500 of them: sd 0.5 %
    (line,) = [text for text in section.paragraphs if "training range of" in text]
    assert 29.8 < float(line.split("%")[0]) < 33.6
    inside = validation_section(plant(), validate(plant(), runs, training(9.0)), runs)
    assert "The unseen data stay inside" in inside.paragraphs[-1]


def test_the_same_numbers_give_the_same_bytes():
    runs = free_runs(lambda noise, u, h: noise)
    pages = [
        render(
            Report(
                "V", (), (validation_section(plant(), validate(plant(), runs, training()), runs),)
            )
        )
        for _ in range(2)
    ]
    assert pages[0] == pages[1]
