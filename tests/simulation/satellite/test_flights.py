"""Many flights: each is the flight that its seed says, whoever flies beside it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.plant import Stuck
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.satellite.counted import normal
from faultgauge.simulation.satellite.flights import Chance, Spread, flights
from faultgauge.simulation.satellite.loop import NOISES, Now, fly
from faultgauge.simulation.satellite.observatory import paper_satellite, paper_start

SECONDS, SETTLED = 10.0, 4.0
SPREAD = Spread(angles=2.0, momenta=5.0, inertia=0.02, disturbance=0.2, constants=0.1)
CHANCES = (Chance("state", "h", 0.05, 0.2), Chance("gain", "u", 0.1, 0.5))


@pytest.fixture(scope="module")
def satellite():
    return paper_satellite(load_plant("reaction_wheel"))


@pytest.fixture(scope="module")
def flown(satellite):
    return of_11(satellite)


def of_11(satellite, apart=None):
    return flights(
        satellite, 11, SECONDS, spread=SPREAD, chances=CHANCES, settled=SETTLED, together=8,
        apart=apart,
    )  # fmt: skip


@pytest.mark.study  # below, a flight beside others is the one that the loop flies alone
@pytest.mark.parametrize("first", [0, 5])
def test_no_bit_hangs_on_who_flies_beside(satellite, flown, first):
    """In chunks of 8 or of 16, from seed 0 or from seed 5 on."""
    again = flights(
        satellite, 11 - first, SECONDS, spread=SPREAD, chances=CHANCES, settled=SETTLED,
        first=first, together=16,
    )  # fmt: skip
    for a, b in zip(flown, again, strict=True):
        np.testing.assert_array_equal(a[first:], b)


@pytest.mark.study  # another program to compile
def test_a_flight_is_that_of_the_loop(satellite):
    """Without dispersions, with friction: the sums against telemetry of `fly`, by NumPy. Rounding
    of 1e-16 comes back through the loop; see test_satellite_loop.py."""
    chances = tuple(replace(each, low=0.1, high=0.1) for each in CHANCES)
    found = flights(satellite, 8, SECONDS, chances=chances, settled=SETTLED, together=8)
    k = int(np.argmax(found.fault == 0))
    wheel, onset = int(found.wheel[k]), float(found.onset[k])
    fault = Fault("friction", "state", "h")
    flying = paper_satellite(with_faults(load_plant("reaction_wheel"), (fault,)))
    steps = round(SECONDS / 0.25)
    noise = jnp.stack([normal(jnp.uint32(k), jnp.asarray(n), NOISES) for n in range(steps)])
    times = 0.25 * np.arange(steps)[:, None] + 0.05 * np.arange(5)
    f = 0.1 * (times >= onset)[..., None, None] * (np.arange(3) == wheel)[:, None]
    free = Stuck(*(jnp.full((steps, 5, 3, n), jnp.nan) for n in (1, 1, 2)))
    telemetry = fly(flying, paper_start(flying), Now(noise, jnp.asarray(f), free))[1]
    seen = jax.device_get(telemetry)
    np.testing.assert_allclose(found.momentum_peak[k], np.abs(seen.momentum).max(0), rtol=1e-9)
    held = seen.t >= SETTLED
    turned = np.cos(seen.attitude / 2).prod(1) + np.sin(seen.attitude / 2).prod(1)
    pointing = 2 * np.arccos(np.abs(turned[held]))  # yaw, pitch, roll: the quaternion's w
    assert found.pointing_peak[k] == pytest.approx(pointing.max(), rel=1e-9)
    assert found.pointing_rms[k] == pytest.approx(np.sqrt(np.mean(pointing**2)), rel=1e-9)
    # the residual is friction from the first sample after the onset on, and nothing before
    after = (seen.t >= onset)[:, None] * (np.arange(3) == wheel)
    assert found.shift_after[k] == pytest.approx(0.1 * after[-1], abs=1e-9)
    assert found.residual_after[k] == pytest.approx(0.1 * after[-1], abs=1e-9)
    assert found.residual_before[k] == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize(
    "apart",
    [
        # as on a processor, which takes four times as long to compile: ../test_side_by_side.py
        pytest.param(True, marks=pytest.mark.study),
        False,
    ],
)
def test_cases_are_drawn_as_asked(satellite, apart):
    flown = of_11(satellite, apart)
    assert set(flown.fault) <= {-1, 0, 1}
    none = flown.fault < 0
    np.testing.assert_array_equal(flown.wheel[none], -1)
    assert np.isnan(flown.onset[none]).all()
    assert np.all(flown.size[none] == 0)
    low, high = np.array([0.05, 0.1]), np.array([0.2, 0.5])
    mine = flown.fault[~none]
    assert np.all((flown.size[~none] >= low[mine]) & (flown.size[~none] <= high[mine]))
    assert np.all((flown.onset[~none] >= SETTLED) & (flown.onset[~none] <= SECONDS))
    assert np.unique(flown.momentum_peak[:, 0]).size == 11  # no two alike


@pytest.mark.parametrize(("count", "settled"), [(0, 1.0), (1, SECONDS)])
def test_what_cannot_fly_is_refused(satellite, count, settled):
    with pytest.raises(ValueError, match="count"):
        flights(satellite, count, SECONDS, settled=settled)
