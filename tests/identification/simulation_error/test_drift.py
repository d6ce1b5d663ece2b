"""The walk of a drifting parameter, by hand."""

import numpy as np
import pytest

from faultgauge.identification.samples import channels
from faultgauge.identification.simulation_error.data import prepare
from faultgauge.identification.simulation_error.drift import SlowWalk
from faultgauge.identification.simulation_error.records import records_of
from faultgauge.identification.unknowns import unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run


def test_straight_lines_between_knots():
    drift = SlowWalk(np.array([2.0, 1.0]), across=40, segment=10)
    walk = drift.walk(35)
    assert walk.shape == (35, 4, 2)
    c = np.array([[1.0, 0.0], [-3.0, 0.0], [0.5, 2.0], [9.0, 0.0]])
    course = np.einsum("nks,ks->ns", walk, c)
    unit = np.sqrt(10 / 40)
    knots = 2.0 * unit * np.array([0.0, 1.0, -2.0, -1.5])
    wanted = np.interp(np.arange(31), [0, 10, 20, 30], knots)
    np.testing.assert_allclose(course[:31, 0], wanted, atol=1e-14)
    np.testing.assert_allclose(course[30:, 0], -1.5 + 0.1 * 9.0 * np.arange(5), atol=1e-14)
    np.testing.assert_allclose(course[[0, 20, 25, 34], 1], unit * np.array([0, 0, 1, 2]))


def test_it_walks_as_far_as_its_scale_says():
    """Over `across` samples the variances of independent increments add up to its square."""
    drift = SlowWalk(np.array([0.3]), across=160, segment=10)
    end = drift.walk(161)[-1, :, 0]
    assert np.sum(end**2) == pytest.approx(0.3**2)


def test_longer_windows_hold_what_is_known():
    drift = SlowWalk(np.array([1.0]), across=100, segment=10)
    z = np.arange(8.0).reshape(1, 8)  # a start of three, then five increments of 50 samples
    longer = drift.lengthened(z, 50, 100)
    assert longer.shape == (1, 13)
    short, long = drift.walk(50)[..., 0] @ z[0, 3:], drift.walk(100)[..., 0] @ longer[0, 3:]
    np.testing.assert_allclose(short, long[:50], rtol=1e-14)  # sums in another order
    np.testing.assert_allclose(long[50:], np.sum(z[0, 3:]) * np.sqrt(0.1))


def test_nothing_drifts():
    assert SlowWalk.over(0, 300, 3).walk(64).shape == (64, 0, 0)
    assert SlowWalk.over(2, 300, 3).none().walk(64).shape == (64, 0, 0)


@pytest.mark.parametrize(("runs", "segments"), [(3, 16), (100, 10), (5000, 1)])
def test_many_runs_have_fewer_knots_each(runs, segments):
    """So that the normal equations stay near a thousand unknowns."""
    drift = SlowWalk.over(1, 1600, runs)
    assert drift.increments(1600) == segments


HEATER = """
name = "heater"
[states.T]
derivative = "u - a*T"
[inputs.u]
[outputs.T]
value = "T"
[parameters]
a = { value = 0.5, min = 0, vary = "slow" }
"""


@pytest.mark.parametrize(
    ("fitted", "held", "windows", "knots"),
    [
        ([320, 320], [6400], 2, 16),  # a long log to validate on says nothing of the fitted ones
        ([1600, *[100] * 199], [], 200, 5),  # every run has the longest one's unknowns
        ([300_000], [], 24, 16),  # of 73 windows no more are fitted than 100,000 samples hold
    ],
)
def test_knots_are_counted_over_the_windows_that_are_fitted(fitted, held, windows, knots):
    plant = GrayBoxPlant.untrained(parse_plant(HEATER, "heater.toml"))

    def records(counts):
        logs = [
            Run(
                f"{n}", "heat.csv", 0.1 * np.arange(n), {"u": np.sin(np.arange(n)), "T": np.ones(n)}
            )
            for n in counts
        ]
        return records_of(plant.signals, logs, channels(plant.spec, logs)) if logs else []

    masks = [np.ones(n, bool) for n in fitted]
    unknowns = unknowns_of(plant)
    data = prepare(plant.signals, records(fitted), masks, records(held), 1, False, unknowns)
    longest = max(piece.stop - piece.start for piece in data.whole)
    assert (len(data.whole), data.drift.increments(longest)) == (windows, knots)
