"""Decisions on a drive whose friction is a learned network, measured and simulated, and on the
wheel with a sine in its plant file."""

import numpy as np
import pytest

from decision_studies.drive_pulses import bodies, by_bank, trained
from decision_studies.harmonic import PRESETS, harmonic_bank, intermittent
from faultgauge_studies import merit
from faultgauge_studies.drive import measured_logs, simulated_logs

pytestmark = pytest.mark.study

BODY = "network of speed, 2 units"


def test_a_learned_network_runs_in_the_bank():
    """A simulated drive, encoder noise of 1e-7 m, ripple of 3 N that the network does not know.

    Its motion goes beyond what the first half covers, where nothing may be judged.
    """
    logs = simulated_logs(12.0)
    found = by_bank(trained(BODY, bodies()[BODY], logs, 0), logs)
    assert found.pulses is not None
    status = np.array(found.pulses.status)
    settled = merit.settled(logs.faulty.t, merit.edges_of(logs.pulse), 0.06)
    assert set(status[settled & (logs.pulse > 0)]) <= {"FAULT", "NOT_JUDGED"}
    assert set(status[settled & (logs.pulse == 0)]) <= {"HEALTHY", "NOT_JUDGED"}
    assert [event.fault for event in found.pulses.events] == ["pulse"] * 12
    # one healthy log of 2.4 s tells the constants badly: wide intervals, which hold the truth
    assert [event.size for event in found.pulses.events] == pytest.approx([5.0] * 12, rel=0.15)
    inside = [event.lo <= 5.0 <= event.hi for event in found.pulses.events]
    assert sum(inside) >= 11  # of 12 intervals of 95 %
    assert found.figures["alarms_on_healthy_stretch"] == 0
    assert found.figures["coverage_settled"] > 0.8  # 25 half periods: 25 draws of model error


def test_measured_pulses_are_told_from_a_healthy_stretch():
    logs = measured_logs()
    if logs is None:
        pytest.skip("the EMPS records are absent; set FAULTGAUGE_DATA to the folder with emps/")
    found = by_bank(trained(BODY, bodies()[BODY], logs, 0), logs).figures
    assert found["half_periods"] == 50
    assert found["half_periods_wrong"] == 0
    assert found["alarms_on_healthy_stretch"] == 0
    assert found["rmse_share"] <= 0.02
    assert found["settling_max_s"] <= 0.06
    assert found["coverage_settled"] > 0.9


def test_a_sine_in_the_plant_file_is_told_from_friction():
    flown = intermittent(harmonic_bank(PRESETS[0], flights=1), 0)
    assert flown.quality.rmse <= 2e-4  # N*m, the goal
    run, error = flown.decision.run, flown.estimate - flown.truth
    edges = merit.edges_of(flown.truth)
    assert run.t[edges] == pytest.approx([500.0, 600.0, 700.0, 800.0], abs=0.3)  # eq (17)
    scored = merit.settled(run.t, edges, 50.0) & (run.t >= 500.0)
    assert flown.quality.rmse == pytest.approx(float(np.sqrt(np.mean(error[scored] ** 2))))
    assert {e.fault for e in flown.decision.events} == {"friction"}
