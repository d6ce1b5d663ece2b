"""How well a fault can be known: closed forms of an integrator; and priors of a plant file."""

import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.knowledge import longest_delay
from faultgauge.detection.bank.noise import Noise
from faultgauge.telemetry import Run
from models import as_stated

TEXT = """
name = "integrator"
[states.x]
derivative = "u"
[inputs.u]
[outputs.x]
value = "x"
[faults.drive]
enters = "state"
target = "x"
[faults.bias]
enters = "output"
target = "x"
rate = 0.01
prior_per_hour = 3.6
max = 0.5
min = -0.5
"""
STEP, SIGMA, PROCESS, LENGTH = 0.5, 0.1, 0.2, 2000.0


MOVING = np.random.default_rng(0).uniform(-1, 1, (40, 2))


def bank(
    size=1e-9, lasting=100.0, sigma=SIGMA, process=PROCESS, text=TEXT, points=MOVING, settling=5.0
):
    model = as_stated(text, points)
    small = [1e-9]
    levels = [sigma], [process], [], [size], [lasting], small, [settling], [], []
    t = np.arange(0.0, 100.0, STEP)
    run = Run("r", "r.csv", t, {"u": 0 * t, "x": 0 * t})
    return build_fault_bank(model, [run], Noise(*(np.array(each) for each in levels)), LENGTH)


def test_a_constant_drive_of_an_integrator_in_white_noise():
    """x is seen to sigma, and is driven by white noise of q per sqrt(s): a drive f is the slope of
    a random walk, known after t >> sigma^2 / q^2 to q / sqrt(t), however often it is sampled."""
    known = bank().knowledge
    for t in (100.0, 400.0):
        # the ends, known to sigma, cost as much as sigma^2 / q^2 = 0.25 s and a step or two
        assert known.at(0, t) == pytest.approx(PROCESS / np.sqrt(t), rel=0.02)


def test_a_drive_beside_a_discrepancy_is_known_to_its_mean():
    """d lasts tau and has the size s: its mean over t >> tau scatters by s sqrt(2 tau / t). Known
    before, it cannot jump as a drive does: of an autoregression by phi from row to row n rows tell
    (1 + n (1 - phi)^2) / (1 - phi^2) / s^2, by the rows' own step for the first 400 of them, and by
    two of them, on the grid of a quarter of 2000 s, behind."""
    size, tau = 0.05, 5.0
    known = bank(size, tau, sigma=1e-4, process=1e-6).knowledge
    for t, dt in ((200.0, STEP), (400.0, 2 * STEP)):
        phi = np.exp(-dt / tau)
        told = (1 + t / dt * (1 - phi) ** 2) / (1 - phi**2)
        # the mean of d over a row, along which x is driven, is not its value at one end
        assert known.at(0, t) == pytest.approx(size / np.sqrt(told), rel=0.02)
        assert known.at(0, t) == pytest.approx(size * np.sqrt(2 * tau / t), rel=0.15)


def test_a_sensor_that_jumps_is_known_at_once_however_long_the_healthy_logs_are():
    """A bias of a sensor of 0.1 shows in its first row beside a state that is driven by 0.2 per
    sqrt(s): in steps of the long grid of 1 s it would take as long."""
    known = bank().knowledge
    assert known.t[0] == STEP
    S = known.sd[0, 1] ** 2
    # the innovation of a random walk: sigma^2 beside P + q^2 dt, P of Riccati's equation
    q2 = PROCESS**2 * STEP
    predicted = (q2 + np.sqrt(q2**2 + 4 * q2 * SIGMA**2)) / 2
    assert pytest.approx(predicted + SIGMA**2, rel=0.02) == S


def test_what_settles_within_less_than_a_step_leaves_it_as_it_is():
    """Steps of 1 s are ten times as long as that, far beyond what one Runge-Kutta step bears."""
    known = bank(settling=0.1).knowledge
    assert known.at(0, 400.0) == pytest.approx(PROCESS / np.sqrt(400.0), rel=0.02)


def test_a_loss_of_gain_is_known_from_how_far_its_input_moves_about_nothing():
    """dx = (1 - f) u is a drive of -f u, of root mean square f u_rms over the envelope."""
    lossy = bank(text=TEXT + '[faults.loss]\nenters = "gain"\ntarget = "u"\n')
    u = np.asarray(lossy.model.record.envelope_points)[:, 1]
    assert abs(np.median(u)) < np.sqrt(np.mean(u**2)) / 2
    expected = lossy.knowledge.at(0, 100.0) / np.sqrt(np.mean(u**2))
    assert lossy.knowledge.at(2, 100.0) == pytest.approx(expected, rel=1e-9)


def test_keys_of_the_plant_file_and_what_stands_in_for_them():
    found = bank()
    # nothing given: a fault in a thousand records as long as the healthy ones
    assert found.onset == pytest.approx([1e-3 / LENGTH, 3.6 / 3600])
    assert found.size[1] == 0.25  # half of max
    points = np.asarray(found.model.record.envelope_points)
    assert found.size[0] == pytest.approx(np.ptp(points[:, 1]) / 4)  # the range of d(x)
    prior = found.modes.prior
    assert float(prior.size[-1]) == 0.01  # the growth that `rate` declares
    assert float(prior.low[1]), float(prior.high[1]) == (-0.5, 0.5)


def test_the_delay_falls_with_size_and_rises_with_the_level():
    known = bank().knowledge
    sizes = [longest_delay(known, 0, size, 1e-6, 3.0) for size in (0.2, 0.4, 0.8)]
    assert sizes == sorted(sizes, reverse=True)
    assert longest_delay(known, 0, 0.4, 1e-6, 10.0) >= sizes[1]
    # f^2 / (2 sd^2) = needed, at twice the size in a quarter of the time (sd falls as t^-1/2)
    assert sizes[0] / sizes[1] == pytest.approx(4.0, rel=0.1)


def test_what_acts_on_a_plant_may_be_so_large_that_it_shows():
    """At rest no rate has a range. A drive of an integrator with noise of q per sqrt(s) is known to
    q / sqrt(t), and may be 24 times as large as that is in the end, after 400 steps of 1 s: it
    shows, by 8 times, after a ninth of that. Where the file says how large it is, it is that."""
    still = np.zeros((40, 2))
    found = bank(points=still)
    assert found.size[0] == pytest.approx(24 * PROCESS / np.sqrt(400.0), rel=0.02)
    assert found.knowledge.when[0] == pytest.approx(400.0 / 9, rel=0.05)
    limits = TEXT.replace(
        'target = "x"\n[faults.bias]', 'target = "x"\nmax = 0.002\nmin = 0\n[faults.bias]'
    )
    assert bank(points=still, text=limits).size[0] == 0.001


def test_what_never_shows_clearly_shows_once_it_is_known_nearly_as_well_as_ever():
    """A drive known to q / sqrt(t) is 8 times that, 0.08, after 400 steps of 1 s. One of 0.05 at
    most never is; it is known to 1.25 times what it comes to after 400 s / 1.25^2."""
    limits = TEXT.replace(
        'target = "x"\n[faults.bias]', 'target = "x"\nmax = 0.1\nmin = -0.1\n[faults.bias]'
    )
    found = bank(text=limits)
    assert found.size[0] == 0.05
    assert found.knowledge.when[0] == pytest.approx(400.0 / 1.25**2, rel=0.02)
