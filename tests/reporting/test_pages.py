"""Reports as a browser lays them out, in a laptop's window and in half of one."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import faultgauge as fg
from browser import HEIGHT, WIDTHS, check, layouts, picture, save_pictures
from calibrations import for_bank
from faultgauge.detection.decisions import decide
from faultgauge.reporting.report import Report, Section, Table, render
from faultgauge.reporting.time_figures import Panel, fault_estimate, panels
from faultgauge.verbs.estimate import Answer
from scenes import NOISE, SCENES, tank_bank
from tanks import PLANT, log

SEVERAL = ("healthy", "a leak that ends", "a leak that grows")


def answer_page(*decided):
    """What `estimate --smooth` reports."""
    bank = tank_bank()
    bank = replace(bank, model=for_bank(bank.model, NOISE, level=bank.level))
    return render(Answer(bank.model, list(decided), bank, [], [], smooth=True).page())


def laid_out(pages, request, folder):
    """The text of every page, which nothing clips or covers; with pictures where `--pictures` says
    where they go."""
    found = layouts(list(pages.values()), folder)
    if target := request.config.getoption("--pictures"):
        save_pictures(pages, target, folder)
    for name, both in zip(pages, found, strict=True):
        for layout, width in zip(both, WIDTHS, strict=True):
            assert layout.width == width, name
            check(layout)
    return {name: both[0].text for name, both in zip(pages, found, strict=True)}


@pytest.mark.study
def test_nothing_of_a_scene_is_clipped_or_covered(request, tmp_path):
    bank = tank_bank()
    decided = {name: decide(bank, log()) for name, log in SCENES.items()}
    pages = {name: answer_page(said) for name, said in decided.items()}
    runs = [replace(decided[name], run=replace(decided[name].run, name=name)) for name in SEVERAL]
    events = [[replace(e, run=each.run.name) for e in each.events] for each in runs]
    several = [replace(each, events=told) for each, told in zip(runs, events, strict=True)]
    text = laid_out(pages | {"several logs": answer_page(*several)}, request, tmp_path)
    assert "No fault" in text["healthy"]
    assert "run a leak that grows" in text["several logs"].partition("Contents")[0]
    assert len(text) == 14


@pytest.mark.study
def test_nothing_of_a_fit_and_a_calibration_is_clipped_or_covered(request, tmp_path):
    fitted = fg.fit(PLANT, log(1))
    calibrated = fg.calibrate(fitted.model, log(2))
    pages = {"fit": render(fitted.page()), "calibrate": render(calibrated.page())}
    text = laid_out(pages, request, tmp_path)
    assert "free run" in text["fit"]
    assert "What calibration found" in text["calibrate"]


@pytest.mark.study
def test_nothing_of_the_demonstration_is_clipped_or_covered(request, long_jobs, tmp_path):
    command = [sys.executable, "-m", "faultgauge", "demo", "--out", tmp_path]
    subprocess.run(command, env=long_jobs, check=True, capture_output=True)
    text = laid_out({"demo": (tmp_path / "report.html").read_text()}, request, tmp_path)
    assert "free-run position RMSE, pulse given" in text["demo"]
    assert "The paper's Fig 14: estimates, mode 1, sustained." in text["demo"]
    assert "Here the pulse is part of the inputs, so that what is off is" in text["demo"]


@pytest.fixture(scope="module")
def wide_page():
    """Names and tables that are wider than any page."""
    name = "temperature_of_the_outer_bearing_of_the_second_stage"
    t = np.linspace(0.0, 100.0, 50)
    header = ("fault", *(f"what is told in column {k}" for k in range(9)))
    rows = tuple((name, *("0.12 m (0.1 to 0.2)",) * 9) for _ in range(2))
    figures = (
        fault_estimate(t, t, t - 1, t + 1, limit=None, name=name, unit="kg*m**2/s**3"),
        panels(t, [Panel(name, "degC", {f"curve {k}": t + k for k in range(6)})] * 3, title="Many"),
    )
    section = Section(
        "Everything", ("Run `faultgauge fit`.",), (Table(header, rows, name),), figures
    )
    return render(Report("A page", ("One answer.",), (section,)))


def test_long_names_and_wide_tables_are_not_clipped(wide_page, tmp_path):
    (both,) = layouts([wide_page], tmp_path)
    for layout in both:
        check(layout)
        assert layout.shown == 2


@pytest.mark.parametrize("width", WIDTHS)
def test_a_screenshot_shows_the_answer_first_and_nothing_runs_off_it(wide_page, width, tmp_path):
    shot = picture(wide_page, width, tmp_path)
    ink = (shot != shot[-1, -1]).any(axis=2)
    assert shot.shape[1] == width
    assert not ink[-1].any()  # the page ends above
    assert not ink[:, :4].any()
    assert not ink[:, -4:].any()
    assert ink[:HEIGHT].any(axis=1).sum() > HEIGHT // 4  # the answer and what follows
