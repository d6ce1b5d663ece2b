"""Free runs that start anew, against the errors of a double integrator by hand."""

import numpy as np
import pytest

import faultgauge as fg
from faultgauge.identification.validation.restarted import SHORTEST_PIECE, pieces, restarted
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

SLED = """
name = "sled"
[states.x]
derivative = "v"
[states.v]
derivative = "u + off"
[inputs.u]
[outputs.x]
value = "x"
[outputs.v]
value = "v"
[parameters]
off = { value = 0.02 }
"""
STEP, COUNT, OFF = 0.05, 1600, 0.02  # s; m/s^2, by which the model's acceleration is off


def plant():
    return GrayBoxPlant.untrained(parse_plant(SLED, "sled.toml"))


def log(count=COUNT):
    """A sled held near a place by u = -x - v about steps of its set-point, sampled exactly."""
    t, x, v = STEP * np.arange(count), 0.0, 0.0
    rows = []
    for k in range(count):
        u = np.sign(np.sin(0.1 * t[k])) - x - v
        rows.append((u, x, v))
        x, v = x + v * STEP + u * STEP**2 / 2, v + u * STEP
    u, x, v = np.array(rows).T
    return Run("sled", "sled.csv", t, {"u": u, "x": x, "v": v})


def test_errors_add_up_as_the_square_of_the_horizon():
    run = log()
    found = restarted(plant(), run, ["x"], STEP, 0, None)
    size = COUNT // round((run.t[-1] - run.t[0]) / found.horizon)
    # a piece begins at what is measured, and is off by OFF t^2 / 2 after a time t
    off = OFF * (STEP * np.arange(size)) ** 2 / 2
    assert found.outputs["x"]["rmse"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-9)


def test_the_longest_horizon_over_which_the_output_is_followed_is_taken():
    run = log()
    spread = np.std(run.columns["x"])
    parts = 2
    while True:
        off = OFF * (STEP * np.arange(COUNT // parts)) ** 2 / 2
        if np.sqrt(np.mean(off**2)) < spread / 2:
            break
        parts *= 2
    assert 2 < parts <= COUNT / SHORTEST_PIECE  # neither the first nor beyond what is tried
    found = restarted(plant(), run, ["x"], STEP, 0, None)
    assert found.horizon == pytest.approx((run.t[-1] - run.t[0]) / parts)


def test_a_log_too_short_to_start_anew_has_none():
    assert restarted(plant(), log(2 * SHORTEST_PIECE - 1), ["x"], STEP, 0, None) is None


def test_pieces_are_the_whole_log_once():
    run = log(1001)
    parts = pieces(run, 4)
    np.testing.assert_array_equal(np.concatenate([p.t for p in parts]), run.t)
    assert {len(p.t) for p in parts} == {250, 251}
    assert sum(len(p.t) for p in pieces(run, 2, 600)) == 600


def test_evaluate_tells_it_of_what_the_free_run_does_not_follow(tmp_path):
    rng = np.random.default_rng(0)
    run = log()
    noisy = {name: a + 0.01 * rng.normal(size=COUNT) for name, a in run.columns.items()}
    noisy["u"] = run.columns["u"]
    fitted = fg.fit(fg.plant(SLED), {"t": run.t, **noisy}).model
    drifting = {"t": run.t, **run.columns, "u": run.columns["u"] - 0.05}  # a command that is off
    said = fg.evaluate(fitted, drifting)
    assert [line for line in said.lines if "x: started anew every" in line]
    assert "restarted" not in fg.evaluate(fitted, {"t": run.t, **noisy}).scores["runs"][0]
