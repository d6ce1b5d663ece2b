"""The demonstration meets its goals on the measured drive, and runs without the data."""

import numpy as np
import pytest

from faultgauge.telemetry import Run
from faultgauge.verbs.checkup import black_box, parts, with_some_fault
from faultgauge_studies import merit
from faultgauge_studies.drive import BODIES, SETTLED, measured_logs, run_drive, simulated_logs


@pytest.fixture(scope="module")
def measured(data_dir):
    if not (data_dir / "emps").is_dir():
        pytest.skip("the EMPS records are absent: set FAULTGAUGE_DATA to the folder with emps/")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAULTGAUGE_DATA", str(data_dir))
        logs = measured_logs()
    assert logs is not None
    return {name: run_drive(logs, name).figures for name in BODIES}


@pytest.mark.study
@pytest.mark.parametrize("body", list(BODIES))
def test_goals_on_the_measured_drive(measured, body):
    figures = measured[body]
    assert figures["free_run_rmse_mm"] <= 11.0
    assert figures["pulse_rmse_share"] <= 0.03
    # with friction by physics one of 49 estimates stays 6 % off, inside its interval
    late = "settling_max_s" if body == "network" else "settling_median_s"
    assert figures[late] <= 0.15
    assert figures["half_periods"] == 50  # 49 edges
    assert figures["half_periods_wrong"] == 0
    assert figures["events_on_held_out_nominal"] == 0
    # an ESO at 50 rad/s, alone
    assert figures["eso_pulse_rmse_share"] <= 0.03
    assert figures["eso_settling_max_s"] <= 0.15


@pytest.mark.study
def test_a_network_does_as_well_as_the_physics_within_20_percent(measured):
    for key in ("free_run_rmse_mm", "pulse_rmse_v"):
        assert measured["network"][key] <= 1.2 * measured["physics"][key]


@pytest.mark.study
def test_the_simulated_drive_stands_in():
    logs = simulated_logs()
    assert logs.source.startswith("simulated")
    drive = run_drive(logs, "physics")
    # the screw's ripple, which the model does not know, leaves one half period of 50 undecided
    assert drive.figures["half_periods_wrong"] <= 1
    status = np.array(drive.decision.status)
    settled = merit.settled(logs.faulty.t, merit.edges_of(logs.pulse), SETTLED)
    assert "HEALTHY" not in status[settled & (logs.pulse > 0)]
    assert "FAULT" not in status[settled & (logs.pulse == 0)]
    assert drive.figures["pulse_rmse_share"] <= 0.03


def test_the_pulse_is_hidden_from_the_input(data_dir, monkeypatch):
    monkeypatch.setenv("FAULTGAUGE_DATA", str(data_dir))
    logs = measured_logs()
    raw = np.loadtxt(data_dir / "emps" / "test_pulses.csv.gz", delimiter=",", skiprows=1)
    np.testing.assert_allclose(logs.faulty.columns["u"] + logs.pulse, raw[:, 3], atol=1e-12)


def test_without_data_there_are_no_measured_logs(monkeypatch, tmp_path):
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    assert measured_logs() is None


def test_parts_share_no_sample_and_lose_none():
    run = Run("r", "r.csv", np.arange(100.0), {"x": np.arange(100.0)})
    pieces = parts([run], 0.5, 0.75)
    together = np.concatenate([piece.t for (piece,) in pieces])
    np.testing.assert_array_equal(together, run.t)


def test_a_black_box_may_have_a_fault_on_each_of_its_states():
    columns = {"u": np.sin(np.arange(100.0)), "speed": np.arange(100.0), "φ": np.arange(100.0)}
    plant = with_some_fault(black_box([Run("r", "r.csv", np.arange(100.0), columns)], "log"))
    faults = plant.signals.faults
    assert [(f.name, f.enters, f.target) for f in faults] == [
        ("speed_drift", "state", "speed"),
        ("φ_drift", "state", "φ"),
    ]
    assert with_some_fault(plant) is plant


def test_a_black_box_needs_an_input():
    run = Run("r", "r.csv", np.arange(100.0), {"speed": np.arange(100.0)})
    with pytest.raises(Exception, match="no column looks like an input"):
        black_box([run], "log")
