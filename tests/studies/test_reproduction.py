"""The paper's study as `faultgauge reproduce` runs it: contract, goals, report, same bytes."""

import json
import math
import re

import pytest

from faultgauge.cli.app import run
from faultgauge_studies.paper.goals import GOALS, Goal, found, met
from faultgauge_studies.paper.reproduce import as_json, over_seeds, reproduce

pytestmark = pytest.mark.study

SCENARIOS = ("mode1_sustained", "mode1_intermittent", "mode2_sustained", "mode2_intermittent")


@pytest.fixture(scope="module")
def environment(long_jobs):
    """The study's processes inherit it."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in long_jobs.items():
            patch.setenv(name, value)
        yield


@pytest.fixture(scope="module")
def folder(environment, tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduction")
    assert run(["reproduce", "--seeds", "1", "--quick", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def results(folder):
    return json.loads((folder / "results.json").read_text())


def test_the_figures_of_the_contract_are_there(results):
    paths = [
        f"identification.{m}.{k}" for m in ("gbnnm", "desired") for k in ("r2", "rmse", "r2_h")
    ]
    paths += ["model_error.gbnnm.rmse", "floor.rms_f"]
    for scenario in SCENARIOS:
        paths.append(f"residual.{scenario}.rmse_to_desired.gbnnm")
        paths.append(f"residual.{scenario}.desired_rms")
    for scenario in SCENARIOS[:2]:
        for estimator in ("eso", "iesonn", "residual"):
            for key in ("rmse", "settling_s", "overshoot"):
                paths.append(f"fault_estimate.{scenario}.{estimator}.{key}")
        paths.append(f"fault_estimate.{scenario}.iesonn_minus_eso.rmse")
    for policy in ("none", "estimate", "estimate_and_friction", "adrc"):
        paths += [f"accommodation.{policy}.{key}" for key in ("peak_deg", "rms_deg")]
    for path in paths:
        assert set(found(results, path)) == {"median", "min", "max"}, path


@pytest.mark.parametrize("goal", GOALS, ids=lambda goal: f"{goal.path}-{goal.statistic}")
def test_goals_of_the_first_seed(results, goal):
    assert met(goal, results), found(results, goal.path)


def test_a_goal_can_be_missed():
    results = {"a": {"median": 2.0, "min": 1.0, "max": None}, "b": {"median": 0.5}}
    assert met(Goal("", "a", "median", "<=", 2.0), results)
    assert not met(Goal("", "a", "median", "<=", 1.9), results)
    assert not met(Goal("", "a", "median", "<=", 3.0, times="b"), results)  # 2 against 1.5
    assert not met(Goal("", "a", "max", "<=", 9.0), results)  # never settled


def test_the_floor_is_the_disturbance_that_was_put_in(results):
    # theta_a J omega_a^2 / sqrt(2); 1000 s hold 31.8 periods, so the mean is off by 1/200 at most
    by_hand = 0.02 * 0.84 * 0.2**2 / math.sqrt(2)
    assert results["floor"]["rms_f"]["median"] == pytest.approx(by_hand, rel=0.005)


def test_a_second_run_finds_the_same_bytes(environment, folder):
    again = as_json(reproduce([0], quick=True).results)
    assert again.encode() == (folder / "results.json").read_bytes()


def test_numbers_over_seeds_by_hand():
    figures = [{"a": {"b": x}, "c": y} for x, y in ((3.0, math.inf), (1.0, 2.0), (5.0, 1.0))]
    assert over_seeds(figures) == {
        "a": {"b": {"median": 3.0, "min": 1.0, "max": 5.0}},
        "c": {"median": 2.0, "min": 1.0, "max": None},
    }


def test_a_list_is_over_seeds_by_element_and_an_axis_stays():
    figures = [{"hidden": [1, 2], "rmse": [x, 2 * x]} for x in (3.0, 1.0, 2.0)]
    assert over_seeds(figures) == {
        "hidden": [1, 2],
        "rmse": [
            {"median": 2.0, "min": 1.0, "max": 3.0},
            {"median": 4.0, "min": 2.0, "max": 6.0},
        ],
    }


def test_what_is_not_defined_is_null():
    assert over_seeds([{"r2_h": math.nan}, {"r2_h": math.nan}]) == {
        "r2_h": {"median": None, "min": None, "max": None}
    }


def test_the_papers_baselines_are_there(results):
    for name in ("snn", "rnn", "pnn", "spnn", "wiener_hammerstein"):
        assert found(results, f"identification.{name}.rmse")["median"] > 0
        for scenario in SCENARIOS:
            assert found(results, f"residual.{scenario}.rmse_to_desired.{name}")["median"] > 0
            assert found(results, f"residual.{scenario}.rmse_to_desired.{name}_tuned") is not None


def test_the_report_redraws_the_papers_figures(folder):
    page = (folder / "report.html").read_text()
    for figure in ("Fig 9", "Fig 10", "Fig 11", "Fig 12", "Fig 13", "Fig 14", "Fig 15"):
        assert f"{figure}: " in page
    assert "stability" in page.lower()
    assert "Where the paper does not hold" in page
    assert page.count("<svg") >= 18
    assert re.search(r"\bnan\b", page.lower()) is None


def test_the_machine_is_kept_out_of_the_results(folder, results):
    ran = json.loads((folder / "run.json").read_text())
    assert ran["elapsed_s"] > 0
    assert "elapsed" not in (folder / "results.json").read_text()
    assert results["seeds"] == [0]


@pytest.mark.parametrize(
    ("arguments", "word"), [(["--seeds", "0"], "--seeds"), (["--first-seed", "-1"], "--first-seed")]
)
def test_wrong_seeds_are_refused(arguments, word, capsys):
    assert run(["reproduce", *arguments]) == 2
    assert word in capsys.readouterr().err
