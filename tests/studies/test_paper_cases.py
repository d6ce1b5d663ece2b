"""The paper's faults by hand at every jump, and what each does to a wheel in open loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.closed_loop import Conditions, Controller, closed_loop, with_faults
from faultgauge.simulation.schedules import grid, inject, truth
from faultgauge_studies.paper.cases import CASES, MODE_1, PHYSICAL

SAMPLES, DT, SUBSTEPS = 700, 1.0, 5
TORQUE, START = 0.1, 40.0  # N*m and N*m*s
NAN = np.nan


@pytest.fixture(scope="module")
def wheel():
    return load_plant("reaction_wheel")


def open_loop(wheel, schedules):
    """(h, d(h)/dt, T) under a constant command."""
    injection = inject(schedules, wheel.signals, grid(SAMPLES, DT, SUBSTEPS))
    outputs = len(wheel.signals.outputs)
    record = closed_loop(
        with_faults(wheel, injection.faults),
        Controller(jnp.zeros((1, outputs)), jnp.zeros((1, outputs))),
        jnp.array([START]),
        Conditions(
            jnp.full((SAMPLES, 1), TORQUE),
            jnp.zeros((SAMPLES, outputs)),
            jnp.zeros((SAMPLES, outputs)),
            jnp.asarray(injection.f),
            jax.tree.map(jnp.asarray, injection.stuck),
            jnp.zeros((SAMPLES, outputs), bool),
        ),
        DT,
    )
    return tuple(np.asarray(a[:, 0]) for a in (record.x, record.dx, record.y))


@pytest.fixture(scope="module")
def healthy(wheel):
    return open_loop(wheel, ())


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("mode1_sustained", {0: 0, 499.999: 0, 500: 0.1, 999.999: 0.1}),
        (
            "mode1_intermittent",  # eq (17)
            {0: 0, 499.999: 0, 500: 0.1, 599.999: 0.1, 600: 0.15, 699.999: 0.15}
            | {700: 0.2, 799.999: 0.2, 800: 0, 999.999: 0},
        ),
        ("mode2_sustained", {0: NAN, 499.999: NAN, 500: 0.1, 999.999: 0.1}),
        (
            "mode2_intermittent",  # eq (19): it ends stuck at 0, not healthy
            {0: NAN, 499.999: NAN, 500: 0.05, 549.999: 0.05, 550: 0.08, 599.999: 0.08}
            | {600: 0.1, 649.999: 0.1, 650: 0, 999.999: 0},
        ),
    ],
)
def test_sizes_before_and_after_every_jump(name, table):
    case = CASES[name]
    found = truth(case.fault, np.array(list(table), float))
    np.testing.assert_array_equal(found, list(table.values()))
    # every time at which the table changes is one of its jumps, and there is no other
    changes = [b for a, b in zip(table, list(table)[1:], strict=False) if b - a < 0.01]
    assert list(case.jumps) == changes
    assert max(case.jumps) < case.until


def test_mode_1_adds_its_torque_to_the_wheels(wheel, healthy):
    assert set(MODE_1) == {name for name in CASES if name.startswith("mode1")}
    h, rate, torque = open_loop(wheel, [CASES["mode1_sustained"].fault])
    np.testing.assert_allclose(h[:501], healthy[0][:501], rtol=0, atol=1e-9)  # rounding of 40
    # at 500 s momentum is still that of the healthy wheel, hence friction too
    assert rate[500] - healthy[1][500] == pytest.approx(0.1, abs=1e-9)
    assert torque[500] - healthy[2][500] == pytest.approx(0.1, abs=1e-9)


def test_eq_18_as_written_overwrites_the_output_alone(wheel, healthy):
    h, rate, torque = open_loop(wheel, [CASES["mode2_sustained"].fault])
    # the same program on the same numbers
    np.testing.assert_array_equal(h, healthy[0])
    np.testing.assert_array_equal(rate, healthy[1])
    np.testing.assert_array_equal(torque[:500], healthy[2][:500])
    np.testing.assert_array_equal(torque[500:], 0.1)
    assert abs(healthy[2][500:] - 0.1).min() > 0.03  # friction: the wheel's own is another torque


def test_the_physical_reading_moves_momentum_straight(wheel, healthy):
    h, rate, torque = open_loop(wheel, [PHYSICAL.fault])
    np.testing.assert_array_equal(h[:501], healthy[0][:501])
    np.testing.assert_array_equal(rate[500:], 0.1)
    np.testing.assert_array_equal(torque[500:], 0.1)  # T reads d(h)/dt
    # 1000 roundings of 1e-14
    np.testing.assert_allclose(h[500:], h[500] + 0.1 * np.arange(200), rtol=0, atol=1e-11)
    assert h[-1] - healthy[0][-1] > 1.0  # which an observer closed on momentum can see
