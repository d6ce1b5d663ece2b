"""The bank on a stream answers as it does beside the file: the same bits, reasons and events."""

import numpy as np
import pytest

from faultgauge.detection.calibration import calibrate
from faultgauge.detection.decisions import BankEvent, Decision, decide_runs, table
from faultgauge.detection.episode import Alarm
from faultgauge.detection.online import Online
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge.telemetry.stream import Sample

TANK = """
name = "tank"
[states.x]
derivative = "u - 0.2*x"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[faults.pump]
enters = "input"
target = "u"
[faults.gauge]
enters = "output"
target = "x"
"""
STEP, COUNT, SIGMA = 0.5, 700, 0.02


def model(text=TANK):
    points = np.random.default_rng(0).uniform([0, 0], [12, 2], (60, 2))
    record = {
        "max_step": 1.0,
        "envelope_points": points.tolist(),
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
    }
    return Model(GrayBoxPlant.untrained(parse_plant(text)), record)


def log(seed, pump=0.0, gauge=0.0):
    """Exact under the hold; the pump off in the third quarter, the gauge in the last fifth."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.5, 1.5, COUNT // 20), 20)
    k = np.arange(COUNT)
    late = (k >= COUNT // 2) & (k < 3 * COUNT // 4)
    fade, x = np.exp(-0.2 * STEP), np.full(COUNT, u[0] / 0.2)
    for j in range(COUNT - 1):
        x[j + 1] = fade * x[j] + (1 - fade) / 0.2 * (u[j] + pump * late[j])
    y = x + gauge * (k >= 4 * COUNT // 5) + SIGMA * rng.standard_normal(COUNT)
    return Run("stream", "standard input", STEP * k, {"u": u, "x": y})


def holed(run):
    """`run` with empty cells, one where a stretch would begin, a gap within the fault, and one."""
    columns = {name: values.copy() for name, values in run.columns.items()}
    columns["u"][[100, 102]] = np.nan
    columns["x"][[0, 103, 300]] = np.nan
    t = run.t.copy()
    t[430:] += 60.0
    t[600:] += 8.0
    return Run(run.name, run.source, t, columns)


def streamed(judge, run):
    said = []
    for k, t in enumerate(run.t):
        said += judge.push(Sample(float(t), {n: float(v[k]) for n, v in run.columns.items()}))
    return [*said, *judge.finish()]


@pytest.fixture(scope="module")
def calibrated():
    return calibrate(model(), [log(1), log(2)]).model


def test_every_bit_of_a_holed_log_is_that_of_the_file(calibrated):
    run = holed(log(3, pump=0.3, gauge=0.5))
    (judged,), _ = decide_runs(calibrated, [run])
    said = streamed(Online(calibrated, observer="bank"), run)
    rows = [each for each in said if isinstance(each, Decision)]
    names = calibrated.plant.signals.fault_names
    assert table(rows, names) == table([judged], names), "floats compared with =="
    events = sorted((e for e in said if isinstance(e, BankEvent)), key=lambda e: e.start)
    assert events == judged.events
    assert {"pump", "gauge"} <= {e.fault for e in events}
    alarms = [(a.fault, a.start) for a in said if isinstance(a, Alarm)]
    assert set(alarms) == {(e.fault, e.start) for e in events}
