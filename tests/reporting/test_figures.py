"""Every figure: units on its axes, the same bytes for the same data, nothing lost, nothing run."""

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import matplotlib
import numpy as np
import pytest

from faultgauge.reporting import glance, model_figures, relations, time_figures
from faultgauge.reporting.clock_axis import clock_ticks
from faultgauge.reporting.glance import Compared, ToldSpan, overview
from faultgauge.reporting.model_figures import bars, envelope, fit_history, learned_curve
from faultgauge.reporting.relations import relation
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import (
    Panel,
    curves,
    fault_estimate,
    free_run,
    panels,
    residual,
)
from faultgauge.telemetry.clock import Clock

RNG = np.random.default_rng(0)
T = np.linspace(0.0, 100.0, 1001)
Y = np.sin(T / 7.0)
NOISE = RNG.normal(0.0, 0.01, T.size)
X = np.linspace(-2.0, 2.0, 81)
DATA_X = RNG.uniform(-1.0, 0.5, 900)
LOG = {"h": RNG.normal(0.0, 1.0, 900), "u": RNG.normal(0.0, 2.0, 900)}
OTHER = {"h": np.r_[np.zeros(75), np.full(25, 9.0)], "u": np.zeros(100)}
COSTS = [np.geomspace(1.0, 1e-3, 40), np.geomspace(2.0, 1e-2, 30)]
UNITS = {"h": "N*m*s", "u": "N*m"}


def draw_free_run(**changes: Any) -> Figure:
    values = {"name": "torque", "unit": "N*m", "run": "log 1", "warmup": 50} | changes
    return free_run(T, Y, values.pop("predicted", Y + NOISE), **values)


def draw_residual(**changes: Any) -> Figure:
    values = {"limit": 0.03, "name": "torque", "unit": "N*m", "reference": "free run"} | changes
    return residual(T, NOISE, **values)


def draw_curves(**changes: Any) -> Figure:
    values = {"title": "Both", "name": "friction", "unit": "N*m", "truth": Y} | changes
    return curves(T, {"one": Y, "other": Y + NOISE}, **values)


def draw_estimate(**changes: Any) -> Figure:
    values: dict[str, Any] = {"limit": 0.2, "name": "friction", "unit": "N*m", "truth": Y}
    values |= {"events": [(20.0, 40.0), (90.0, np.inf)], "not_judged": T < 5.0}
    return fault_estimate(T, Y + NOISE, Y - 0.1, Y + 0.1, **(values | changes))


def draw_envelope(**changes: Any) -> Figure:
    return envelope(LOG, UNITS, [("h", "u")], **({"other": OTHER} | changes))


def draw_learned(**changes: Any) -> Figure:
    values: dict[str, Any] = {"x_name": "speed", "x_unit": "rad/s"}
    values |= {"y_name": "drag", "y_unit": "N*m", "reference": X, "band": (X**3 - 1, X**3 + 1)}
    return learned_curve(X, X**3, DATA_X, DATA_X**3, **(values | changes))


def draw_history() -> Figure:
    return fit_history(COSTS, [2.0 * cost for cost in COSTS], chosen=1)


def draw_panels(**changes: Any) -> Figure:
    stack = [Panel("torque", "N*m", {"one": Y, "other": Y + NOISE}, Y), Panel("u", "V", {"u": Y})]
    return panels(T, stack, **({"title": "Both"} | changes))


def draw_relation(**changes: Any) -> Figure:
    looks: dict[str, Any] = {"title": "Rates", "x_name": "speed", "x_unit": "rad/s"}
    looks |= {"y_name": "drag", "y_unit": "N*m", "limit": 0.5, "limit_name": "limit"}
    measured = {"found": np.where(np.arange(X.size) % 9 == 0, X**2, np.nan)}
    return relation(X, {"this": X**2, "that": X**4}, measured=measured, **(looks | changes))


def draw_bars(**changes: Any) -> Figure:
    values = np.array([[1e-3, 5e-4, 2e-3], [0.1, 0.05, 0.5]])
    looks: dict[str, Any] = {"title": "Errors", "name": "RMSE", "unit": "N*m"}
    looks |= {"reference": np.array([0.01, np.nan])}
    return bars(["this", "that"], values, **(looks | changes))


def draw_overview(**changes: Any) -> Figure:
    outputs = [
        Compared("torque", "N*m", Y + NOISE, changes.pop("healthy", Y), 0.01),
        Compared("u", "V", Y, Y),
    ]
    told = [ToldSpan("friction", "N*m", NOISE, NOISE - 0.1, NOISE + 0.1, [(20.0, 40.0)], 0.5)]
    looks: dict[str, Any] = {"run": "log 1", "spans": [(20.0, 40.0), (60.0, 70.0)]}
    looks["not_judged"] = T < 5.0
    return overview(T, outputs, told, **(looks | changes))


# drawing -> (unit across, unit up) of each panel; None where an axis carries no quantity of its own
FIGURES: dict[Callable[..., Figure], list[tuple[str | None, str | None]]] = {
    draw_free_run: [(None, "N·m"), ("s", "N·m")],
    draw_residual: [("s", "N·m")],
    draw_curves: [("s", "N·m")],
    draw_estimate: [("s", "N·m")],
    draw_envelope: [("N·m·s", "N·m")],
    draw_learned: [("rad/s", "N·m")],
    draw_history: [("number", "1"), ("number", "1")],
    draw_panels: [(None, "N·m"), ("s", "V")],
    draw_overview: [(None, "N·m"), (None, "V"), ("s", "N·m")],
    draw_relation: [("rad/s", "N·m")],
    draw_bars: [("N·m", None)],
}
every_figure = pytest.mark.parametrize("draw", FIGURES, ids=lambda draw: draw.__name__)


def words(drawing: Figure) -> list[str]:
    root = ET.fromstring(drawing.svg)
    return ["".join(text.itertext()) for text in root.iter("{http://www.w3.org/2000/svg}text")]


@pytest.fixture
def canvases(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The matplotlib drawings made during the test."""
    seen: list[Any] = []
    for module in (time_figures, model_figures, relations, glance):
        original = module.figure

        def record(canvas: Any, title: str, caption: str, original: Any = original) -> Figure:
            seen.append(canvas)
            return original(canvas, title, caption)

        monkeypatch.setattr(module, "figure", record)
    return seen


@every_figure
def test_every_axis_has_its_unit(draw: Callable[..., Figure], canvases: list[Any]):
    drawn = words(draw())
    (canvas,) = canvases
    for axes, units in zip(canvas.axes, FIGURES[draw], strict=True):
        for label, unit in zip((axes.get_xlabel(), axes.get_ylabel()), units, strict=True):
            assert label == "" if unit is None else label.endswith(f"({unit})")
    for unit in {unit for pair in FIGURES[draw] for unit in pair if unit}:
        assert any(text.endswith(f"({unit})") for text in drawn)


@every_figure
def test_same_data_same_bytes_whatever_the_users_style(draw: Callable[..., Figure]):
    first = draw()
    with matplotlib.rc_context({"font.size": 20.0, "xtick.direction": "in"}):
        assert draw() == first
    assert re.search(r"\d{4}-\d\d-\d\dT", first.svg) is None  # no date


@every_figure
def test_drawing_leaves_the_users_style_alone(draw: Callable[..., Figure]):
    before = dict(matplotlib.rcParams)
    draw()
    assert dict(matplotlib.rcParams) == before


@every_figure
def test_has_title_and_needs_no_other_file(draw: Callable[..., Figure]):
    drawing = draw()
    assert drawing.title
    root = ET.fromstring(drawing.svg)
    for element in root.iter():
        assert not element.tag.endswith(("}style", "}script", "}image", "}metadata"))
        for key, value in element.attrib.items():
            assert not key.endswith("href") or value.startswith("#")


def test_bytes_do_not_depend_on_the_process_and_jax_stays_unloaded():
    script = (
        "import sys, hashlib, numpy as np, faultgauge.reporting.time_figures as r;"
        "t = np.arange(50.0);"
        "d = r.fault_estimate(t, t, t - 1, t + 1, limit=3.0, name='f', unit='N',"
        "    not_judged=t < 9);"
        "assert not {'jax', 'matplotlib.pyplot'} & set(sys.modules);"
        "print(hashlib.sha256(d.svg.encode()).hexdigest())"
    )
    paths = os.pathsep.join(path for path in sys.path if path)
    printed = [
        subprocess.run(
            [sys.executable, "-c", script],
            env=os.environ | {"PYTHONPATH": paths, "PYTHONHASHSEED": seed},
            check=True,
            capture_output=True,
        ).stdout
        for seed in ("1", "2")
    ]
    assert printed[0] == printed[1] != b""


def test_a_long_log_gives_a_small_drawing():
    t = np.arange(100_000) * 0.01
    y = RNG.normal(0.0, 1.0, t.size)
    drawing = free_run(t, y, 0.9 * y, name="T", unit="N*m", run="long")
    # Three curves of at most 1200 points, some 18 bytes each, beside 10 kB of axes.
    assert len(drawing.svg) < 100_000


def test_a_spike_survives_the_drawing(canvases: list[Any]):
    t = np.arange(100_000) * 0.01
    r = np.zeros(t.size)
    r[66_666] = 7.0
    residual(t, r, name="T", unit="N*m", reference="free run")
    line = canvases[0].axes[0].lines[0]
    assert line.get_ydata().max() == 7.0
    assert line.get_xdata()[line.get_ydata().argmax()] == t[66_666]


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "a$b$c", "x & y", "流量", "tab\x01"])
def test_any_name_is_only_text(name: str):
    for drawing in (draw_free_run(name=name, run=name), draw_estimate(name=name)):
        assert "<script" not in drawing.svg
        shown = " ".join(words(drawing)).replace("\ufffd", "\x01")
        assert name.split("(")[0] in shown


def test_not_judged_stretches_do_not_set_the_range(canvases: list[Any]):
    wide = np.where(T < 5.0, 1e6, 0.1)
    fault_estimate(T, Y, Y - wide, Y + wide, limit=0.2, name="f", unit="N", not_judged=T < 5.0)
    low, high = canvases[0].axes[0].get_ylim()
    # The estimate spans -1 to 1, its band 0.1 more, the margin 6 % of the whole.
    assert -1.3 < low < -1.1
    assert 1.1 < high < 1.3


def test_hatching_hides_the_band_and_not_the_estimate(canvases: list[Any]):
    draw_estimate()
    axes = canvases[0].axes[0]
    (hatched,) = [patch for patch in axes.patches if patch.get_hatch()]
    assert axes.collections[0].get_zorder() < hatched.get_zorder()
    assert all(line.get_zorder() > hatched.get_zorder() for line in axes.lines)


def test_estimate_says_what_it_shows():
    assert "±0.2\u00a0N·m" in draw_estimate().caption
    assert "2 events" in draw_estimate().caption
    uncalibrated = draw_estimate(limit=None, events=(), not_judged=None, truth=None)
    assert "Not calibrated" in uncalibrated.caption
    assert not {"limit", "event", "not judged", "truth"} & set(words(uncalibrated))
    assert {"limit", "event", "not judged", "truth"} <= set(words(draw_estimate()))


def test_nothing_but_nan_is_still_a_figure():
    nothing = np.full(T.shape, np.nan)
    everywhere = np.ones(T.shape, dtype=bool)
    assert words(residual(T, nothing, name="T", unit="N", reference="free run"))
    assert words(
        fault_estimate(
            T, nothing, nothing, nothing, limit=None, name="f", unit="N", not_judged=everywhere
        )
    )


def test_a_diverging_free_run_does_not_hide_what_was_measured(canvases: list[Any]):
    drawing = draw_free_run(predicted=np.exp(T**2 / 15.0))  # up to 1e289
    low, high = canvases[0].axes[0].get_ylim()
    assert low < -1.0 < 1.0 < high < 4.0  # measured: -1 to 1; shown: its range on either side
    assert "diverges" in drawing.caption
    assert "diverges" not in draw_free_run().caption


def test_envelope_reports_the_share_outside():
    assert "25.0 % of (h, u)" in draw_envelope(other_name="suspect").caption  # 25 of 100 at h = 9
    assert "%" not in draw_envelope(other=None).caption


def test_envelope_draws_one_panel_per_pair(canvases: list[Any]):
    envelope(LOG, UNITS, [("h", "u"), ("u", "h"), ("h", "u")])
    assert len(canvases[0].axes) == 3


@pytest.mark.parametrize("points", [100, 5000])
def test_every_training_point_is_covered_by_ink(points: int, canvases: list[Any]):
    x, y = np.random.default_rng(5).normal(0.0, 1.0, (2, points))
    envelope({"x": x, "y": y}, {}, [("x", "y")])
    axes = canvases[0].axes[0]
    if points > 600:  # a density: the lightest level is a path around every cell with a point
        widest = axes.patches[0].get_path()
        inside = np.zeros(points, dtype=bool)
        for corners in widest.vertices.reshape(-1, 5, 2):
            low, high = corners.min(axis=0) - 1e-9, corners.max(axis=0) + 1e-9
            inside |= ((low <= np.stack([x, y], 1)) & (np.stack([x, y], 1) <= high)).all(axis=1)
        assert inside.all()
    else:
        drawn = axes.lines[0].get_xdata()
        # Of points within one of 176 x 112 cells, one is drawn: each has ink within 1/176.
        nearest = np.abs(drawn[np.isfinite(drawn)][:, None] - x).min(axis=0)
        assert nearest.max() <= np.ptp(x) / 176


def test_ranges_without_data_are_greyed(canvases: list[Any]):
    assert "no data" in words(draw_learned())
    spans = sorted(
        (patch.get_x(), patch.get_x() + patch.get_width())
        for patch in canvases[0].axes[0].patches
        if patch.get_label() == "no data" or patch.get_zorder() == 0.5
    )
    # The data lie densely in -1 to 0.5, the curve runs from -2 to 2.
    np.testing.assert_allclose(spans, [(-2.0, -1.0), (0.5, 2.0)], atol=0.01)


def test_history_marks_the_trial_with_the_lowest_validation_cost():
    validation = [np.array([5.0, 4.0, 6.0]), np.array([9.0, 2.0, 3.0, 8.0])]
    drawing = fit_history([np.ones(3), np.ones(4)], validation, chosen=1)
    assert "trial 2," in drawing.caption


def test_bars_show_numbers_and_missing_ones():
    values = np.array([[0.5, 0.25, 0.75], [np.nan, np.nan, np.nan]])
    drawn = words(bars(["a", "b"], values, title="x", name="R2", unit="1"))
    assert "0.5 [0.25, 0.75]" in drawn
    assert "no value" in drawn


@pytest.mark.parametrize(("largest", "scale"), [(2.0, "linear"), (500.0, "log")])
def test_bars_go_logarithmic_over_decades(largest: float, scale: str, canvases: list[Any]):
    bars(["a"], np.array([[1.5, 1.0, largest]]), title="x", name="RMSE", unit="N")
    assert canvases[0].axes[0].get_xscale() == scale


QUIET = 1e-6 * NOISE


@pytest.mark.parametrize(
    ("draw", "panel", "low", "high"),
    [
        (lambda: residual(T, QUIET, name="T", unit="N", reference="x", noise=0.1), 0, -0.5, 0.5),
        (lambda: free_run(T, Y, Y + QUIET, name="T", unit="N", run="x", noise=0.1), 1, -0.5, 0.5),
        # about the middle of what was measured, 3
        (lambda: free_run(T, QUIET + 3, QUIET + 3, name="T", unit="N", run="x", noise=0.1), 0,
         2.5, 3.5),
        (lambda: fault_estimate(T, QUIET, QUIET, QUIET, limit=None, name="f", unit="N", least=0.2),
         0, -0.2, 0.2),
        (lambda: panels(T, [Panel("f", "N", {"f": QUIET}, span=(-2.0, 4.0))], title="x"), 0,
         -2.0, 4.0),
        (lambda: overview(T, [Compared("T", "N", QUIET, QUIET, 0.1)], [], run="x"), 0, -0.5, 0.5),
        (draw_overview, 2, -0.5, 0.5),
    ],
)  # fmt: skip
def test_what_is_smaller_than_the_noise_looks_small(draw, panel, low, high, canvases: list[Any]):
    """Five standard deviations of the noise on either side, or the least size that is told."""
    draw()
    bottom, top = canvases[0].axes[panel].get_ylim()
    assert bottom == pytest.approx(low, rel=1e-6)  # what was drawn is 1e-6 of it
    assert top == pytest.approx(high, rel=1e-6)


def test_a_large_residual_is_seen_whole_whatever_the_noise(canvases: list[Any]):
    residual(T, 9.0 * Y, name="T", unit="N", reference="x", noise=0.1)
    bottom, top = canvases[0].axes[0].get_ylim()
    assert bottom < -8.9
    assert top > 8.9


def test_an_overview_shades_the_faults_and_stops_a_healthy_model_that_diverges(canvases: list[Any]):
    drawing = draw_overview(healthy=np.exp(T**2 / 15.0))  # up to 1e289
    assert drawing.caption.endswith("The healthy model runs out of the picture of torque.")
    assert "leaves" not in draw_overview().caption
    first, _, last = canvases[0].axes
    low, high = first.get_ylim()
    assert low < -1.0 < 1.0 < high < 6.0  # measured: -1 to 1; shown: 1.5 times its range beyond
    spans = [[(p.get_x(), p.get_x() + p.get_width()) for p in axes.patches if not p.get_hatch()]
             for axes in (first, last)]  # fmt: skip
    np.testing.assert_allclose(spans[0], [(20.0, 40.0), (60.0, 70.0)])
    np.testing.assert_allclose(spans[1], [(20.0, 40.0)])


def test_an_overview_shades_an_alarm_without_a_name_in_another_colour(canvases: list[Any]):
    drawing = draw_overview(alarms=[(45.0, 55.0)])
    assert drawing.caption.endswith("In grey: an alarm for which no fault was named.")
    of_colour = {}
    for patch in canvases[0].axes[0].patches:
        of_colour.setdefault(patch.get_facecolor(), []).append(patch.get_x())
    assert sorted(of_colour.values()) == [[20.0, 60.0], [45.0]]
    nothing = draw_overview(spans=[], alarms=[(45.0, 55.0)])
    assert "No fault was told" not in nothing.caption


@pytest.mark.parametrize(
    "draw",
    [draw_free_run, draw_residual, draw_curves, draw_estimate, draw_panels, draw_overview],
    ids=lambda draw: draw.__name__,
)
def test_a_log_with_a_clock_is_drawn_in_its_time(draw: Any, canvases: list[Any]):
    drawn = words(draw(clock=Clock(datetime(2026, 5, 1, 23, 59, 0))))
    # 100 s from 23:59:00, every 30 s; midnight is 60 s after the start
    assert {"23:59:00", "2026-05-01", "23:59:30", "00:00:00", "2026-05-02"} <= set(drawn)
    axes = canvases[0].axes[-1]
    assert dict(zip(axes.get_xticks(), [t.get_text() for t in axes.get_xticklabels()],
                    strict=True))[60.0] == "00:00:00\n2026-05-02"  # fmt: skip
    assert axes.get_xlabel() == "time"


@pytest.mark.parametrize(
    ("length", "labels"),
    [
        (0.02, ["08:41:10.250\n2026-05-01", "08:41:10.255", "08:41:10.260", "08:41:10.265",
                "08:41:10.270"]),
        (2.0, ["08:41:10.5\n2026-05-01", "08:41:11.0", "08:41:11.5", "08:41:12.0"]),
        (3600.0, ["08:50:00\n2026-05-01", "09:00:00", "09:10:00", "09:20:00", "09:30:00",
                  "09:40:00"]),
        (86400.0, ["12:00:00\n2026-05-01", "18:00:00", "00:00:00\n2026-05-02", "06:00:00"]),
        (3 * 86400.0, ["12:00:00\n2026-05-01", "00:00:00\n2026-05-02", "12:00:00",
                       "00:00:00\n2026-05-03", "12:00:00", "00:00:00\n2026-05-04"]),
        (10 * 86400.0, ["2026-05-03", "2026-05-05", "2026-05-07", "2026-05-09", "2026-05-11"]),
    ],
)  # fmt: skip
def test_ticks_lie_at_round_times_of_the_clock(length: float, labels: list[str]):
    clock = Clock(datetime(2026, 5, 1, 8, 41, 10, 250_000))
    places, found = clock_ticks(clock, 0.0, length)
    assert found == labels
    assert all(0.0 <= place <= length for place in places)
    assert len(places) <= 8  # that fit side by side


def test_the_zone_of_a_clock_is_told(canvases: list[Any]):
    draw_residual(clock=Clock(datetime(2026, 5, 1, tzinfo=UTC)))
    assert canvases[0].axes[0].get_xlabel() == "time (UTC)"
