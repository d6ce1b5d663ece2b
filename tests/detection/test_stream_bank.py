"""The bank on a stream answers as it does beside the file: the same bits, reasons and events; a
sensor that stands on one value too, counted by hand."""

import numpy as np
import pytest

from calibrations import for_bank, for_observer
from faultgauge.detection.answer.estimation import Estimated, estimate
from faultgauge.detection.answer.estimation import table as plain_table
from faultgauge.detection.answer.standing import standing_in
from faultgauge.detection.answer.unnamed import unnamed_alarms
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import Decision, decide_runs, table, unjudged
from faultgauge.detection.posterior.events import Alarm, BankEvent, Unnamed
from faultgauge.detection.rows.flat_line import FlatLine, longest_repeats
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.stream import Stream
from faultgauge.observers.follow import follow
from faultgauge.telemetry import Run
from faultgauge.telemetry.stream import Sample
from models import as_stated

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
    return as_stated(text, points)


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


def short(run, count):
    columns = {name: values[:count] for name, values in run.columns.items()}
    return Run(run.name, run.source, run.t[:count], columns)


def streamed(judge, run, at_once=1):
    said, samples = [], []
    for k, t in enumerate(run.t):
        samples.append(Sample(float(t), {n: float(v[k]) for n, v in run.columns.items()}))
    for k in range(0, len(samples), at_once):
        said += judge.push(*samples[k : k + at_once])
    return [*said, *judge.finish()]


@pytest.mark.parametrize("of_an_observer", [False, True])
def test_without_calibration_every_row_says_so_as_in_the_file(of_an_observer):
    plain = for_observer(model()) if of_an_observer else model()
    run = short(log(3), 300)
    (judged,), _ = decide_runs(plain, [run])
    said = streamed(Stream(plain, observer="bank"), run)
    names = plain.plant.signals.fault_names
    assert table(said, names) == table([judged], names)
    assert set(judged.status) == {"NOT_JUDGED"}
    assert judged.reason[0].startswith("not calibrated")


LEVELS = [SIGMA], [1e-3], [], [1e-4], [100.0], [1e-3], [5.0], [], []


def judging(text=TANK):
    """A model that is calibrated by hand, with what its logs are; the gauge repeats no value."""
    plain = model(text)
    noise = Noise(*(np.array(each) for each in LEVELS))
    return for_bank(plain, noise, {"x": 1}, level=3.0, healthy_s=700.0)


@pytest.fixture(scope="module")
def calibrated():
    return judging()


@pytest.mark.study  # test_same_bytes.py compares whole logs
def test_every_bit_of_a_holed_log_is_that_of_the_file(calibrated):
    run = holed(log(3, pump=0.3, gauge=0.5))
    run.columns["x"][60:64] += 0.5  # gone before it has a name
    (judged,), bank = decide_runs(calibrated, [run])
    said = streamed(Stream(calibrated, observer="bank"), run)
    rows = [each for each in said if isinstance(each, Decision)]
    names = calibrated.plant.signals.fault_names
    assert table(rows, names) == table([judged], names), "floats compared with =="
    events = sorted((e for e in said if isinstance(e, BankEvent)), key=lambda e: e.start)
    assert events == judged.events
    assert {"pump", "gauge"} <= {e.fault for e in events}
    told = [each for each in said if isinstance(each, Alarm)]
    named = {(a.fault, a.start) for a in told if a.fault is not None}
    assert named == {(e.fault, e.start) for e in events}
    begins = [k for k in range(COUNT) if judged.status[k] == "FAULT" != judged.status[k - 1]]
    assert {a.start for a in told if a.fault is None} <= {run.t[k] for k in begins}
    unnamed = [each for each in said if isinstance(each, Unnamed)]
    assert len(unnamed) == 1
    assert unnamed == unnamed_alarms(bank, judged)
    for at_once in (17, COUNT):
        again = streamed(Stream(calibrated, observer="bank"), run, at_once)
        assert table([e for e in again if isinstance(e, Decision)], names) == table(rows, names)
        told = [each for each in again if isinstance(each, Alarm | BankEvent | Unnamed)]
        assert told == [each for each in said if isinstance(each, Alarm | BankEvent | Unnamed)]


# of one fault, which no limit of the pump hides, and without one of the gauge
LIMITED = TANK.replace('hold = "zero"', 'hold = "zero"\nmin = 0.5\nmax = 1.5')
LIMITED = LIMITED.replace('enters = "input"\ntarget = "u"', 'enters = "state"\ntarget = "x"')
LIMITED = LIMITED.replace('[faults.gauge]\nenters = "output"\ntarget = "x"', "")


@pytest.fixture(scope="module")
def limited():
    return judging(LIMITED)


@pytest.mark.parametrize("observer", [pytest.param("bank", marks=pytest.mark.study), "eso"])
def test_a_command_beyond_its_limits_is_the_limit_in_file_and_stream(limited, observer):
    """The log of a pump that does 0.5 to 1.5 l/s of what it is told, and of one told just that."""
    done = short(log(3), 120)
    u = done.columns["u"]
    u = np.where(u > 1.2, 1.5, np.where(u < 0.7, 0.5, u))
    done = Run(done.name, done.source, done.t, done.columns | {"u": u})
    beyond = np.where(u == 1.5, 5.0, np.where(u == 0.5, -1.0, u))
    told = Run(done.name, done.source, done.t, done.columns | {"u": beyond})
    assert not np.array_equal(u, beyond)
    tables = []
    for run in (done, told):
        if observer == "bank":
            judged, form = decide_runs(limited, [run])[0], table
        else:
            judged, form = estimate(limited, [run])[0], plain_table
        said = streamed(Stream(limited, observer=observer), run)
        rows = [each for each in said if type(each) is type(judged[0])]
        names = limited.plant.signals.fault_names
        tables += [form(judged, names), form(rows, names)]
    for each in tables[1:]:
        for name, cells in tables[0].items():
            np.testing.assert_array_equal(np.array(each[name]), np.array(cells), name)


STILL = "x stands on one value: stuck or saturated"


def readings(*values):
    t = np.arange(len(values), dtype=float)
    return Run("r", "r.csv", t, {"u": np.zeros(len(t)), "x": np.array(values, float)})


def saturated(seed):
    """The gauge ends at 5.2, which the level passes now and then from the middle on."""
    run = log(seed)
    late = np.arange(len(run.t)) > len(run.t) // 2
    x = np.where(late, np.minimum(run.columns["x"], 5.2), run.columns["x"])
    return Run(run.name, run.source, run.t, run.columns | {"x": x})


def believed(flat, run):
    """(what of x is a measurement, the places of outputs that stand still)."""
    return follow(flat, flat.init(), (run.columns["x"][:, None],))[1]


def test_longer_repeats_are_no_measurements():
    """Seven times 1 with an empty cell among them, 2 twice: the 5th to 7th of the ones go."""
    run = readings(0, 1, 1, 1, np.nan, 1, 1, 1, 1, 2, 2)
    flat = FlatLine.of(for_observer(model(LIMITED), {"x": 2}))
    kept, _ = believed(flat, run)
    wanted = [0, 1, 1, 1, np.nan, 1, np.nan, np.nan, np.nan, 2, 2]
    np.testing.assert_array_equal(kept[:, 0], wanted)


def test_what_healthy_logs_repeat_is_allowed_twice_and_an_own_fault_explains_it():
    still = readings(0, *[1] * 6, 2)
    assert longest_repeats(model(LIMITED), [still]) == {"x": 6}
    long = readings(0, *[1] * 14)
    known = {"x": 6}
    used, standing = believed(FlatLine.of(for_observer(model(LIMITED), known)), long)
    assert np.isfinite(used).sum() == 13  # 0, and twelve times 1
    assert standing[-3:].tolist() == [0, 1, 1]
    declared = for_observer(model(), known)  # a fault of the gauge
    assert not believed(FlatLine.of(declared), long)[1].any()
    assert believed(FlatLine.of(declared, sized=False), long)[1][-1] == 1


def test_of_a_gauge_with_a_fault_of_its_own_a_sentence_says_where_it_stands():
    """13 times 1 from 1 s to 13 s where healthy logs have 6 at most; 12 times are nothing odd, nor
    is a gauge without a fault, whose rows say so."""
    declared, long = for_observer(model(), {"x": 6}), readings(0, *[1] * 13, 2)

    def said(model, run):
        one = unjudged(model, run, prepared(model.plant.signals, run), {})
        return standing_in(model, [one])

    (fault,) = (f.name for f in declared.plant.signals.faults if f.enters == "output")
    assert said(declared, long) == [
        "run r: x stands on 1 from 1 s to 13 s, stuck or saturated; the size of "
        f"{fault} there is by how much that is off"
    ]
    assert said(declared, readings(0, *[1] * 12, 2)) == []
    assert said(for_observer(model(LIMITED), {"x": 6}), long) == []


def test_the_bank_says_so_and_names_no_leak(limited):
    run = saturated(3)
    (judged,), _ = decide_runs(limited, [run])
    still = np.array(judged.reason) == STILL
    assert still.sum() > 20
    assert {judged.status[k] for k in np.flatnonzero(still)} == {"NOT_JUDGED"}
    assert "pump" not in {event.fault for event in judged.events}
    rows = [e for e in streamed(Stream(limited, observer="bank"), run) if type(e) is Decision]
    names = limited.plant.signals.fault_names
    assert table(rows, names) == table([judged], names), "floats compared with =="


def test_so_do_the_observers(limited):
    run = saturated(3)
    (judged,), _ = estimate(limited, [run])
    assert judged.reason.count(STILL) > 20
    rows = [e for e in streamed(Stream(limited, observer="eso"), run) if type(e) is Estimated]
    names = limited.plant.signals.fault_names
    assert plain_table(rows, names) == plain_table([judged], names)
