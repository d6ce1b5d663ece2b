"""Campaign files: what they mean, and how they are refused."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from faultgauge.campaigns.axis import Axis
from faultgauge.campaigns.design import run_plans
from faultgauge.campaigns.runs import constants_of, log_of, schedules_of
from faultgauge.campaigns.schema import read_campaign
from faultgauge.errors import InputError
from scenes import SIGMA

ROOT = Path(__file__).parents[2]
RANDOM = ("seeds = 2", 'design = "random"\nruns = 12')


def test_a_grid_has_every_point_so_many_times(written):
    path = written(
        ("onset = 50", 'onset = [40, 60]\nnoise = [1, 3]\npairs = [["leak", "gauge"]]'),
        ("size = 0.3", "size = { low = 0.1, high = 0.4, count = 3, log = true }"),
    )
    runs = run_plans(read_campaign(path))
    found = Counter(tuple(kind.name for kind in run.kinds) for run in runs)
    each = 2 * 2 * 2  # onsets, noises, seeds
    assert found == {
        (): 1,
        ("leak",): 2 * each,
        ("gauge",): 3 * each,
        ("silent",): each,
        ("leak", "gauge"): 6 * each,
    }
    gauges = {run.sizes[0] for run in runs if [k.name for k in run.kinds] == ["gauge"]}
    assert sorted(gauges) == pytest.approx([0.1, 0.2, 0.4])  # a geometric grid
    assert len({run.seed for run in runs}) == len(runs)
    assert [run.number for run in runs] == list(range(len(runs)))


def test_a_random_design_draws_within_its_ends(written):
    path = written(
        RANDOM,
        ("onset = 50", "onset = { low = 30, high = 70 }"),
        ("size = 0.3", "size = { low = 0.01, high = 1, log = true, signs = true }"),
    )
    runs = run_plans(read_campaign(path))
    found = Counter(tuple(kind.name for kind in run.kinds) for run in runs)
    assert found == {(): 1, ("leak",): 4, ("gauge",): 4, ("silent",): 4}
    assert all(30 <= onset <= 70 for run in runs for onset in run.onsets)
    assert runs[5:7] == run_plans(read_campaign(path))[5:7]


def test_a_range_is_drawn_evenly_in_its_logarithm():
    axis = Axis((0.01, 1.0), between=(0.01, 1.0), log=True, signs=True)
    rng = np.random.default_rng(0)
    drawn = np.array([axis.draw(rng) for _ in range(4000)])
    # uniform shares have a mean of 1/2 with a standard error of 0.29 / 63; a sign's is 1 / 63
    assert np.mean(np.log(np.abs(drawn) / 0.01) / np.log(100)) == pytest.approx(0.5, abs=0.02)
    assert np.mean(np.sign(drawn)) == pytest.approx(0.0, abs=0.07)


def test_a_run_has_its_fault_its_noise_and_its_own_constants(written):
    """The tank with k times the noise and a gauge that is off: the healthy twin less the run."""
    plan = read_campaign(written(("onset = 50", "onset = 50\nnoise = 2")))
    run = next(each for each in run_plans(plan) if each.kinds and each.kinds[0].name == "gauge")
    log, twin = log_of(plan, run, schedules_of(plan, run)), log_of(plan, run, ())
    off = log.columns["x"] - twin.columns["x"]
    assert set(log.columns) == {"u", "x"}
    np.testing.assert_allclose(off, np.where(log.t >= 50, 0.3, 0.0), atol=1e-12)  # rounding
    still = run._replace(noise=0.0)
    noise = twin.columns["x"] - log_of(plan, still, ()).columns["x"]
    # of 200 samples the standard deviation is known to 5 %
    assert np.std(noise) == pytest.approx(2 * SIGMA, rel=0.2)


def test_constants_differ_between_runs_by_as_much_as_is_said():
    plan = read_campaign(ROOT / "benchmarks" / "wheel_campaign" / "campaign.toml")
    plan.dispersions["tau_c"] = 0.1
    drawn = np.array([constants_of(plan, seed)["tau_c"] for seed in range(1000)])
    # a mean's standard error is 0.3 %, a standard deviation's 2.2 %
    assert drawn.mean() == pytest.approx(0.03, rel=0.015)
    assert drawn.std() == pytest.approx(0.003, rel=0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("size = 0.3", "sise = 0.3"), ["[faults.gauge] unknown key 'sise'", "'size'"]),
        (("size = 0.3", "size = []"), ["[faults.gauge] size", "the grid is empty"]),
        (("size = 0.3", "size = 0"), ["[faults.gauge] size of 0 is no fault"]),
        (("size = 0.3", "size = { low = 2, high = 1 }"), ["low = 2 must be below high = 1"]),
        (("size = 0.3", "size = { low = 1 }"), ["size", "high"]),
        (("size = 0.3", 'size = "big"'), ["size", "should be a number, a list of them"]),
        (("size = 0.3", 'size = 1\nprofile = "ramp"'), ["[faults.gauge] lasts is missing"]),
        (("size = 0.3", "size = 1\nperiod = 3"), ['"intermittent"']),
        (("[faults.gauge]", "[faults.gouge]"), ["[faults.gouge]", "declares no fault 'gouge'"]),
        (("onset = 50", "onset = [50, 100]"), ["onset has to lie within the run", "100 s"]),
        (("onset = 50", "onset = 50\nnoise = -1"), ["noise is a factor"]),
        (("onset = 50", 'onset = 50\npairs = [["leak", "gage"]]'), ["pairs", "'gauge'"]),
        (("onset = 50", 'onset = 50\npairs = [["leak", "leak"]]'), ["two different faults"]),
        (("seeds = 2", "seeds = 2\nruns = 5"), ["runs is of a random design"]),
        (("seeds = 2", "seeds = 50000"), ["200001 runs", "100000 at most"]),
        (('"model.fgm"', '"none.fgm"'), ["[judge] model = 'none.fgm' is no file"]),
        (('"model.fgm"', '"truth"\nplant = "tonk"'), ["[judge] plant = 'tonk' is no file", "tank"]),
        (("[judge]", "[dispersions]\nk = 0.1\n[judge]"), ["[dispersions] unknown parameter 'k'"]),
        (('effect = "dropout"', 'effect = "dropout"\nsize = 1'), ["a dropout and has no size"]),
        (("[faults.leak]", "[faults.healthy]"), ["not a name of a fault"]),
        (("named = []", 'named = ["a", "b", "c"]'), ["more than two names"]),
    ],
)
def test_mistakes_are_answered_by_their_key(written, change, words):
    with pytest.raises(InputError) as refused:
        read_campaign(written(change))
    text = str(refused.value)
    assert text.startswith(str(written(change)))
    assert text.count("\n") == 0
    for word in words:
        assert word in text


def test_a_scenario_with_faults_of_its_own_is_refused(files, written):
    own = '[faults.leak]\nprofile = "constant"\nsize = 1\n'
    (files / "faulty.toml").write_text((files / "scenario.toml").read_text() + own)
    with pytest.raises(InputError, match=r"'faulty.toml' has \[faults\] of its own"):
        read_campaign(written(('"scenario.toml"', '"faulty.toml"')))


def test_no_fault_at_all_is_an_empty_grid(files):
    text = 'name = "n"\nscenario = "scenario.toml"\nonset = 5\n[judge]\nmodel = "truth"\n[faults]\n'
    (files / "empty.toml").write_text(text)
    with pytest.raises(InputError, match="holds no fault, so the grid is empty"):
        read_campaign(files / "empty.toml")
