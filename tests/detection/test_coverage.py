"""Where a network's arguments came together in training: distances against brute force, and a tank
that was only ever seen near its steady states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.coverage import MARGIN, regions_of
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import Decision, decide, decide_runs, table
from faultgauge.detection.posterior.posterior import WIDE
from faultgauge.detection.stream import Stream
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge.telemetry.stream import Sample
from models import record_of

TANK = """
name = "tank"
[states.x]
derivative = "u - 0.2*x + loss(x, u) + curve(x)"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[outputs.flow]
value = "meter(d(x), x)"
[networks.loss]
[networks.curve]
[networks.meter]
[faults.leak]
enters = "state"
target = "x"
"""
STEP, COUNT, SIGMA = 0.5, 400, 0.02
LEVELS = [SIGMA, 1.0], [1e-3], [], [1e-4], [100.0], [1e-3], [5.0], [1e-3] * 3, [0.0] * 3, [0.0] * 3
NOISE = Noise(*(np.array(each) for each in LEVELS))  # next to no error of the model


def model(points):
    record = record_of(
        max_step=1.0,
        envelope_points=np.asarray(points).tolist(),
        columns={"states": [["x", 0]], "outputs": ["x"]},
    )
    return Model(GrayBoxPlant.untrained(parse_plant(TANK)), record)  # its networks are 0


def near_steady(count=400):
    """x = 5 u within 2 % of the range."""
    rng = np.random.default_rng(0)
    u = rng.uniform(0.5, 1.5, count)
    return np.stack([5 * u + rng.uniform(-0.1, 0.1, count), u], axis=1)


def log(u):
    """Exact under the hold, which the zero networks leave linear."""
    rng = np.random.default_rng(1)
    fade, x = np.exp(-0.2 * STEP), np.full(COUNT, u[0] / 0.2)
    for k in range(COUNT - 1):
        x[k + 1] = fade * x[k] + (1 - fade) / 0.2 * u[k]
    y = x + SIGMA * rng.standard_normal(COUNT)
    return Run("stream", "standard input", STEP * np.arange(COUNT), {"u": u, "x": y})


def bank(run):
    return build_fault_bank(model(near_steady()), [run], NOISE)


def brute(points, values):
    """Largest difference over the arguments, of the nearest point."""
    return np.abs(points[None] - values[:, None]).max(axis=2).min(axis=1)


def holds(region, x, u, driven):
    return jax.vmap(region.holds)(*(jnp.asarray(each) for each in (x, u, driven)))


def test_every_network_that_is_used_has_a_region():
    """`meter` stands in an output that is not used."""
    found, calls = model(near_steady()), ["loss(x, u)", "curve(x)", "meter(d(x), x)"]
    for outputs, expected in ((["x"], calls[:2]), (["x", "flow"], calls)):
        names = [r.name for r in regions_of(found, outputs)]
        assert names == expected


def test_a_value_is_covered_within_a_tenth_of_one_point_in_every_argument():
    points = near_steady()
    region, _ = regions_of(model(points), ["x"])
    assert region.reach == MARGIN  # dense: the tenths of the log lie closer than that
    values = np.random.default_rng(1).uniform([2, 0.4], [8, 1.6], (500, 2))
    width = np.ptp(points, axis=0)
    wanted = brute(points / width, values / width) <= MARGIN
    found = holds(region, values[:, :1], values[:, 1:], np.zeros((500, 1)))
    assert found.tolist() == wanted.tolist()
    assert 0.1 < wanted.mean() < 0.9  # either answer was asked for


def test_sparse_training_reaches_as_far_as_its_own_stretches_are_apart():
    points = np.random.default_rng(2).uniform(0, 1, (30, 2))
    region, _ = regions_of(model(points), ["x"])
    scaled = points / np.ptp(points, axis=0)
    apart = [
        brute(np.delete(scaled, range(3 * k, 3 * k + 3), axis=0), scaled[3 * k : 3 * k + 3])
        for k in range(10)
    ]
    assert region.reach == pytest.approx(np.quantile(np.concatenate(apart), 0.99))
    assert region.reach > MARGIN


def test_samples_in_a_row_do_not_vouch_for_one_another():
    """One slow sweep: the next sample is near, the next tenth of the log is not."""
    t = np.linspace(0, 1, 400)
    region, _ = regions_of(model(np.stack([t, t], axis=1)), ["x"])
    # the first tenth and the last are up to 40 of 399 steps away from the rest
    assert region.reach == pytest.approx(40 / 399, rel=0.1)


def test_rates_count_with_what_a_fault_adds():
    """d(x) = u - 0.2 x in training; a fault of 0.5 on it leaves `meter`, one of -0.5 returns."""
    region = regions_of(model(near_steady()), ["flow"])[2]
    x, u = np.array([[5.0], [5.0], [5.0]]), np.array([[1.0], [1.0], [1.5]])
    driven = np.array([[0.0], [0.5], [-0.5]])
    assert holds(region, x, u, driven).tolist() == [True, False, True]


def test_what_is_not_a_number_is_not_covered():
    region, _ = regions_of(model(near_steady()), ["x"])
    nothing = np.array([[np.nan]])
    assert holds(region, nothing, np.array([[1.0]]), np.array([[0.0]])).tolist() == [False]


@pytest.mark.study  # in file and stream, below
def test_a_combination_that_training_never_had_is_not_judged():
    """A large step: state and input each in their range, together never."""
    u = np.where(np.arange(COUNT) < COUNT // 2, 0.6, 1.4)
    run = log(u)
    step = bank(run)
    found = decide(step, run)
    just = slice(COUNT // 2 + 1, COUNT // 2 + 10)
    (reason,) = set(found.reason[just])
    (low_x, high_x), (low_u, high_u) = ((e.min(), e.max()) for e in near_steady().T)
    assert reason == (
        f"outside of what training covered of loss(x, u): x from {low_x:.3g} to {high_x:.3g} "
        f"with u from {low_u:.3g} to {high_u:.3g}"
    )
    assert set(found.status[just]) == {"NOT_JUDGED"}
    size = WIDE * step.size[0]  # the prior, which the interval widens to
    assert np.all(found.posterior.lo[just, 0] <= -size)
    assert np.all(found.posterior.hi[just, 0] >= size)
    assert set(found.status[-50:]) == {"HEALTHY"}


def test_slow_changes_are_judged():
    u = 1.0 + 0.2 * np.sin(2 * np.pi * np.arange(COUNT) / COUNT)
    found = decide(bank(log(u)), log(u))
    assert set(found.status[50:]) == {"HEALTHY"}


def test_a_stream_leaves_the_region_at_the_same_samples():
    run = log(np.repeat(np.random.default_rng(3).uniform(0.5, 1.5, COUNT // 20), 20))
    plain = model(near_steady())
    calibrated = for_bank(plain, NOISE, level=3.0, healthy_s=200.0)
    judge, said = Stream(calibrated, observer="bank"), []
    for k, t in enumerate(run.t):
        said += judge.push(Sample(float(t), {n: float(v[k]) for n, v in run.columns.items()}))
    rows = [each for each in [*said, *judge.finish()] if isinstance(each, Decision)]
    (whole,), _ = decide_runs(calibrated, [run])
    assert table(rows, ["leak"]) == table([whole], ["leak"])
    reasons = {reason for reason in whole.reason if reason}
    outside = "outside of what training covered of loss(x, u): x from "
    assert any(each.startswith(outside) for each in reasons)
