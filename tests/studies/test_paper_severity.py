"""What the residual says of a fault's size, against the wheel's own equation and arithmetic."""

import numpy as np
import pytest

from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.free_run import Trajectory
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import run
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper.cases import CASES, EQ_17, Case, inner_disturbance
from faultgauge_studies.paper.learning import beside, scores
from faultgauge_studies.paper.severity import (
    SIZES,
    channels_at,
    growth,
    jumps,
    mean,
    output_offset,
    severities,
    torque_residual,
)

SECONDS, PITCH, ONSET = 1000.0, 1, 2000  # the onset's sample: 500 s at 4 Hz
# Roundings of 100 N*m*s, 1e-14, over 20,000 steps that forget them (friction damps).
ROUNDING = 1e-9
OFFSET = Case("", Schedule("d1", "output", "T", EQ_17), SECONDS, EQ_17.times)


def friction(h):
    """The wheel's own, N*m: Coulomb, Stribeck and viscous."""
    w = h / 0.84
    return 2.5e-4 * w + (0.03 + 0.007 * np.exp(-((w / 5) ** 2))) * np.tanh(w)


@pytest.fixture(scope="module")
def wheel():
    return load_plant("reaction_wheel")


def made_up(torque, momentum):
    """Telemetry of pitch alone."""
    unknown = np.full(len(torque), np.nan)
    no = np.full((len(torque), 3), np.nan)

    def pitch(x):
        return np.stack([unknown, np.asarray(x, float), unknown], axis=1)

    return Telemetry(unknown, no, pitch(torque), pitch(momentum), no, no, no, unknown)


def test_a_reference_with_the_measured_state_is_the_wheels_equation(wheel):
    """With h and u telemetered, an input fault is left in the residual whole, at all times."""
    flown = run(wheel, SECONDS, 0, faults={"pitch": [Schedule("d", "input", "u", EQ_17)]})
    u, h = flown.u[:, PITCH], flown.momentum[:, PITCH]
    assert abs(u).max() + 0.2 > 0.82  # at first the command is at the wheel's limit
    found = beside(wheel, flown, "measured")
    np.testing.assert_allclose(found.y[:, 0], u - friction(h), rtol=0, atol=ROUNDING)
    assert abs(u[ONSET:]).max() + 0.2 < 0.82  # under the fault it is not
    d = EQ_17.sizes(np.asarray(flown.t))
    r = flown.torque[:, PITCH] - found.y[:, 0]
    np.testing.assert_allclose(r, d, rtol=0, atol=ROUNDING)


def test_an_input_fault_shows_whole_at_its_onset_and_then_by_friction(wheel):
    """Against the free reference: r = d + xi(hhat) - xi(h), and hhat is h less r's integral."""
    found = severities(wheel, wheel, 0, ())
    assert tuple(found) == SIZES
    for size, r in found.items():
        np.testing.assert_allclose(r[:ONSET], 0, rtol=0, atol=ROUNDING)
        assert r[ONSET] == pytest.approx(size, abs=ROUNDING)
    flown = run(wheel, SECONDS, 0, faults={"pitch": [CASES["mode1_sustained"].fault]})
    h, r = flown.momentum[:, PITCH], found[0.1]  # on an unlimited input, mode 1 is the same fault
    apart = 0.25 * np.concatenate([[0.0], np.cumsum((r[1:] + r[:-1]) / 2)])
    wanted = np.where(flown.t < 500, 0.0, 0.1) + friction(h - apart) - friction(h)
    # The trapezoid takes half a period of the jump for its own: 0.0125 N*m*s of `apart`, by
    # friction's greatest slope, 0.037/0.84 1/s, is 4.4e-4; half a period more for its bends.
    np.testing.assert_allclose(r, wanted, rtol=0, atol=9e-4)
    assert abs(r[ONSET:] - 0.1).max() > 0.01  # friction does show


def test_an_output_fault_is_the_residual(wheel):
    r = output_offset(wheel, wheel, 0, (), 0.1)
    np.testing.assert_allclose(r[:ONSET], 0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(r[ONSET:], 0.1, rtol=0, atol=ROUNDING)


def test_the_residual_jumps_by_an_output_faults_size(wheel):
    for inner, tolerance in (
        ((), ROUNDING),
        # f(t) moves by 0.02 * 0.84 * 0.2^3 * 0.25 s = 3.4e-5 N*m in a period; friction on
        # what it left in h moves by less
        ((inner_disturbance(wheel),), 7e-5),
    ):
        flown = run(wheel, SECONDS, 0, inner, {"pitch": [OFFSET.fault]})
        found = jumps(OFFSET, torque_residual(wheel, flown))
        wanted = {"500s": 0.1, "600s": 0.05, "700s": 0.05, "800s": -0.2}
        assert found == pytest.approx(wanted, abs=tolerance)


def test_scores_by_hand():
    """Eqs (20) and (21): errors of 0.1 in torques of variance 5/4, of 1 in momenta of 5."""
    torque, momentum = np.array([1.0, 2, 3, 4]), np.array([0.0, 2, 4, 6])
    y = torque + np.array([0.1, -0.1, 0.1, -0.1])
    x = momentum + np.array([1.0, -1, -1, 1])
    found = scores(
        Trajectory(x[:, None], np.full((4, 1), np.nan), np.stack([y, np.full(4, np.nan)], axis=1)),
        made_up(torque, momentum),
    )
    assert found == pytest.approx((1 - 0.01 / 1.25, 0.1, 1 - 1 / 5), rel=1e-12)  # roundings


def test_scores_of_a_record_as_numpy_has_them():
    rng = np.random.default_rng(0)
    torque, momentum, y, x = rng.normal(size=(4, 500))
    found = scores(Trajectory(x[:, None], x[:, None], y[:, None]), made_up(torque, momentum))
    rmse = np.linalg.norm(torque - y) / np.sqrt(500)
    r2 = 1 - rmse**2 / np.std(torque) ** 2
    r2_h = 1 - np.linalg.norm(momentum - x) ** 2 / (500 * np.std(momentum) ** 2)
    assert found == pytest.approx((r2, rmse, r2_h), rel=1e-12)  # roundings


def shown(before, at, later):
    """A channel that is `before`, `at` over the 20 s from 500 s, `later` from 590 s to 610 s."""
    x = np.full(4000, 7.0)  # everywhere else: read by nothing
    x[480 * 4 : 500 * 4] = before
    x[500 * 4 : 520 * 4] = at
    x[590 * 4 : 610 * 4] = later
    return x


def test_means_read_their_20_seconds_alone():
    x = shown(1.0, 2.0, -3.0)
    assert (mean(x, 480.0), mean(x, 500.0), mean(x, 590.0)) == (1.0, 2.0, -3.0)
    assert growth(x) == 1.5
    assert mean(np.arange(4000.0), 500.0) == 2039.5  # samples 2000 to 2079
    channels = {"a": x, "b": shown(0.5, 9.0, 0.75)}
    assert channels_at(channels) == {"a": -4.0, "b": 0.25}


def test_jumps_are_from_the_last_sample_before():
    r = np.arange(4000.0) / 1000  # it rises by 0.001 a sample
    for k, t in enumerate((500, 550, 600, 650)):
        r[t * 4 :] += 10.0**k
    found = jumps(CASES["mode2_intermittent"], r)
    wanted = {"500s": 1.001, "550s": 10.001, "600s": 100.001, "650s": 1000.001}
    assert found == pytest.approx(wanted, rel=1e-12)  # roundings
