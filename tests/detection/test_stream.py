"""A stream is judged as its file is: the same bits, status, reasons and events."""

from functools import partial

import numpy as np
import pytest
from scipy.signal import cont2discrete

from faultgauge.detection.answer.estimation import Estimated, estimate, table
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.stream import Stream
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge.telemetry.stream import Sample
from models import record_of

by_eso = partial(calibrate, observer="eso")

PLANT = """
name = "two tanks"
[states.upper]
derivative = "u - 0.5*upper"
[states.lower]
derivative = "0.5*upper - c*lower"
[inputs.u]
hold = "zero"
[outputs.first]
value = "upper"
[outputs.level]
value = "lower"
[parameters]
c = { value = 0.8, min = 0, fixed = true }
[faults.leak]
enters = "state"
target = "lower"
[faults.clog]
enters = "state"
target = "upper"
[observer]
bandwidth = 1
"""
DT, COUNT = 0.1, 600


def model(text=PLANT, states=(("first", 0), ("level", 0))):
    grid = np.random.default_rng(9).uniform(0, 3, (50, 3))
    record = record_of(
        max_step=0.1,
        envelope_points=grid.tolist(),
        columns={"states": [list(each) for each in states], "outputs": ["first", "level"]},
    )
    return Model(GrayBoxPlant.untrained(parse_plant(text, "tanks.toml")), record)


def log(seed, leak=0.0, outputs=("first", "level"), late=0):
    """Exact under a zero-order hold; `leak` in the middle third; u acts `late` samples late."""
    A, B = np.array([[-0.5, 0.0], [0.5, -0.8]]), np.eye(2)
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 2))), DT)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0, 2, COUNT // 25), 25)
    x = np.zeros((COUNT, 2))
    for k in range(COUNT - 1):
        x[k + 1] = Ad @ x[k] + Bd @ [u[k], leak if COUNT // 3 <= k < 2 * COUNT // 3 else 0.0]
    y = x + 1e-3 * rng.standard_normal(x.shape)
    columns = {"u": np.append(u[late:], np.full(late, u[-1])), "first": y[:, 0], "level": y[:, 1]}
    kept = {name: columns[name] for name in ("u", *outputs)}
    return Run("stream", "standard input", DT * np.arange(COUNT), kept)


def holed(run):
    """`run` with an empty cell, one sample alone between two, a late row and a gap."""
    columns = {name: values.copy() for name, values in run.columns.items()}
    columns["level"][[300, 302, 350]] = np.nan
    columns["u"][5] = np.nan
    t = run.t.copy()
    t[420:] += 0.07
    t[500:] += 30.0
    t[503:] += 30.0  # three samples between two gaps
    return Run(run.name, run.source, t, columns)


def streamed(judge, run):
    """(table, rows that were answered when their sample came)."""
    said, prompt = [], 0
    for k, t in enumerate(run.t):
        now = list(judge.push(Sample(float(t), {n: float(v[k]) for n, v in run.columns.items()})))
        prompt += any(isinstance(each, Estimated) and each.run.t[0] == t for each in now)
        said += now
    said += judge.finish()
    rows = [each for each in said if isinstance(each, Estimated)]
    return (
        table(rows, judge.model.plant.signals.fault_names),
        prompt,
    )


@pytest.fixture(scope="module")
def calibrated():
    return by_eso(model(), [log(1), log(2)]).model


@pytest.mark.parametrize("reference", ["free", "measured", "observer"])
def test_every_bit_of_a_holed_log_is_that_of_the_file(calibrated, reference):
    run = holed(log(3, leak=-0.3))
    (judged,), _ = estimate(calibrated, [run], reference=reference)
    expected = table([judged], calibrated.plant.signals.fault_names)
    found, prompt = streamed(Stream(calibrated, observer="eso", reference=reference), run)
    assert found == expected, "floats compared with ==, so to the bit"
    assert prompt >= COUNT - 19 - 8, "all but the first 19, and one at the start of each stretch"
    judge = Stream(calibrated, observer="eso", reference=reference)
    cells = {name: values.tolist() for name, values in run.columns.items()}
    samples = [Sample(t, {n: v[k] for n, v in cells.items()}) for k, t in enumerate(run.t.tolist())]
    said = [each for k in range(0, COUNT, 45) for each in judge.push(*samples[k : k + 45])]
    assert table(said, judge.model.plant.signals.fault_names) == expected


@pytest.mark.parametrize(
    ("change", "states", "outputs"),
    [
        ("", (("", 0), ("level", 0)), ("level",)),  # hidden: 50 samples to start
        ("", (("level", 1), ("level", 0)), ("level",)),  # the first state as a rate: 20
        ("vary", (("first", 0), ("level", 0)), ("first", "level")),
        ("delay", (("first", 0), ("level", 0)), ("first", "level")),
    ],
)
def test_whatever_a_stretch_starts_from(change, states, outputs):
    text = {
        "": PLANT,
        "vary": PLANT.replace("fixed = true", 'vary = "run"'),
        "delay": PLANT.replace('"zero"', '"zero"\ndelay = 0.33'),
    }[change]
    late = 3 if change == "delay" else 0
    healthy = [log(k, outputs=outputs, late=late) for k in (1, 2)]
    found = by_eso(model(text, states), healthy).model
    run = holed(log(3, leak=-0.3, outputs=outputs, late=late))
    (judged,), _ = estimate(found, [run])
    expected = table([judged], found.plant.signals.fault_names)
    got, _ = streamed(Stream(found, observer="eso"), run)
    assert got == expected


def test_uncalibrated_and_short_streams():
    run = log(4)
    short = Run(run.name, run.source, run.t[:9], {n: v[:9] for n, v in run.columns.items()})
    (judged,), _ = estimate(model(), [short])
    got, _ = streamed(Stream(model(), observer="eso"), short)
    assert got == table([judged], ("leak", "clog"))
    assert set(got["status"]) == {"NOT_JUDGED"}
    with pytest.raises(InputError, match="fewer than two samples"):
        list(Stream(model(), observer="eso").finish())


def test_what_would_need_the_future_is_refused():
    curved = model(PLANT.replace('"zero"', '"band-limited"'))
    with pytest.raises(InputError, match=r"band-limited.*--reference observer"):
        Stream(curved, observer="eso")
    Stream(curved, observer="eso", reference="observer")
    run = log(5)
    run.columns["level"][1::3] = run.columns["level"][2::3] = np.nan
    with pytest.raises(InputError, match="'level' is sampled at times of its own"):
        streamed(Stream(model(), observer="eso"), run)
