"""Reports as a browser lays them out, in a laptop's window and in half of one."""

import numpy as np
import pytest

from browser import HEIGHT, WIDTHS, check, layouts, picture
from faultgauge.detection.decisions import decide
from faultgauge.reporting import Report, Section, Table, render
from faultgauge.reporting.time_figures import Panel, fault_estimate, panels
from faultgauge.verbs.estimate import Answer
from scenes import SCENES, tank_bank


@pytest.mark.study
def test_nothing_of_a_scene_is_clipped_or_covered(tmp_path):
    bank = tank_bank()
    decided = {name: decide(bank, log()) for name, log in SCENES.items()}
    pages = {
        name: render(Answer(bank.model, [said], bank, [], [], smooth=True).page())
        for name, said in decided.items()
    }
    found = layouts(list(pages.values()), tmp_path)
    for name, both in zip(pages, found, strict=True):
        for layout, width in zip(both, WIDTHS, strict=True):
            assert layout.width == width, name
            check(layout)
    assert "No fault" in found[0][0].text
    assert len(pages) == 13


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
