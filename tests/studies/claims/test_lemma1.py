"""Lemma 1's study against closed forms, SciPy and the wheel's equation by hand."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.plants.gray_box import load_plant
from faultgauge.telemetry import Run
from faultgauge_studies.paper.claims import lemma1, lemma1_horizon, lemma1_limit
from faultgauge_studies.paper.claims.learned import rates, replay, sized, unseen
from faultgauge_studies.paper.excited import SWEEP, records

J, K, V, R = 0.84, 0.0743, 28.0, 0.85


@pytest.fixture(scope="module")
def wheel():
    return load_plant("reaction_wheel")


def friction(h):
    """The wheel's own, N*m: Coulomb, Stribeck and viscous."""
    w = h / J
    return 2.5e-4 * w + (0.03 + 0.007 * np.exp(-((w / 5) ** 2))) * np.tanh(w)


def over_seeds(values):
    return [{"median": x, "min": x, "max": x} for x in values]


def test_networks_take_the_size_asked_for():
    plant = sized(7)
    assert {net.weights_in.shape for net in plant.networks.values()} == {(7, 2)}
    assert sized(10).spec.derivatives == load_plant("reaction_wheel_network").spec.derivatives


def test_gronwalls_bound_is_reached_by_the_worst_case():
    """x' = L x against z' = L z + epsilon from the same start: the bound with equality."""
    epsilon, lipschitz, t = 2e-4, 0.044, 60.0
    apart = solve_ivp(
        lambda _, d: lipschitz * d + epsilon, (0, t), [0.0], rtol=1e-11, atol=1e-14
    ).y[0, -1]
    # SciPy's own tolerance, times some hundred steps
    assert lemma1_horizon.gronwall(epsilon, lipschitz, t) == pytest.approx(apart, rel=1e-8)


def test_the_wheel_is_steepest_at_rest(wheel):
    h = np.linspace(-100.0, 100.0, 11)[::2] + 3.0
    by_hand = (2.5e-4 + 0.037) / J  # d/dh of viscous friction and of tau_s tanh(w/w_0) at 0
    found = lemma1_horizon.steepest(wheel, h, np.zeros(len(h)))
    assert found == pytest.approx(by_hand, rel=1e-12)  # roundings


def test_the_margin_is_zero_where_more_command_gives_no_more_torque(wheel):
    h = np.array([215.0, 230.0, -240.0])
    kink = np.sign(h) * K * (V - K * abs(h) / J) / R
    zero = lemma1_limit.margin(wheel, h, kink)
    np.testing.assert_allclose(zero, 0, rtol=0, atol=1e-14)  # roundings of 0.8
    step = 1e-3 * np.sign(h)

    def gain(u):
        return (rates(wheel, h, u + step) - rates(wheel, h, u)) / step

    # roundings of 0.8 over a step of 1e-3
    np.testing.assert_allclose(gain(kink - 2 * step), 1, rtol=0, atol=1e-11)
    np.testing.assert_allclose(gain(kink + step), 0, rtol=0, atol=1e-11)


def test_without_the_limit_only_the_limit_is_missing(wheel):
    free = lemma1_limit.without_limit(wheel)
    h, u = np.array([-240.0, 30.0, 240.0]), np.array([-0.8, 0.8, 0.8])
    np.testing.assert_allclose(rates(free, h, u), u - friction(h), rtol=0, atol=1e-14)  # roundings
    lost = rates(free, h, u) - rates(wheel, h, u)
    limit = np.minimum(0.8, K * (V - K * abs(h) / J) / R)
    np.testing.assert_allclose(lost, np.sign(u) * (0.8 - limit), rtol=0, atol=1e-14)  # roundings
    assert abs(lost[0]) > 0.1


def test_order_of_a_power_law():
    hidden = np.array([2.0, 5.0, 10.0, 30.0])
    assert lemma1_limit.order(hidden, 0.3 * hidden**-1.5) == pytest.approx(1.5, rel=1e-12)


def test_bins_and_counts_by_hand():
    at = np.array([0.1, 0.2, 1.5, 3.5, -1.0])
    found = lemma1_limit.binned(at, np.array([3.0, 4.0, -2.0, 7.0, 9.0]), np.arange(5.0))
    np.testing.assert_allclose(found, [np.sqrt(12.5), 2.0, np.nan, 7.0], rtol=1e-14)
    assert lemma1_limit.units_to((2, 5, 10), [0.3, 0.1, 0.2], 0.2) == 5.0
    assert lemma1_limit.units_to((2, 5, 10), [0.3, 0.3, 0.3], 0.2) == np.inf


def test_records_are_three_and_the_wheel_replays_them(wheel):
    given = records(wheel, SWEEP, 3, ())
    new = unseen(wheel, SWEEP, 3, ())
    assert len({run.content_hash for run in (*given, new)}) == 3
    found = replay(wheel, new)
    # RK4 with steps of 0.2 s against 0.05 s: friction's rate of 0.044 1/s gives (0.0088)^4 a step
    # of at most 0.2 N*m*s; what crosses zero speed keeps some of it
    np.testing.assert_allclose(found.x[:, 0], new.columns["hm"], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.y[:, 0], new.columns["T"], rtol=0, atol=1e-6)
    at_once = rates(wheel, new.columns["hm"], new.columns["u"])
    np.testing.assert_allclose(at_once, new.columns["d_h"], rtol=0, atol=1e-13)  # roundings


def test_a_record_is_thinned_over_its_whole_length():
    t = np.arange(1000.0)
    log = Run("log", "log", t, {"u": np.sin(t)})
    thin = lemma1.thinned(log, 50)
    np.testing.assert_array_equal(thin.t, np.arange(0.0, 1000.0, 20.0))
    np.testing.assert_array_equal(thin.columns["u"], np.sin(thin.t))


def found(with_f, without_f):
    return {
        "lemma1": {
            "hidden": [1, 10, 40],
            "floor": over_seeds([1.0])[0],
            "rmse": over_seeds(with_f),
            "rmse_without_f": over_seeds(without_f),
        }
    }


def test_the_verdict_follows_the_numbers():
    good = lemma1.verdict(found([9.0, 1.05, 1.2], [9.0, 0.01, 0.02]))
    assert good.holds
    assert "10 units come within 10%" in good.found
    assert "900 times" in good.found
    assert "2 times larger again" in good.found
    assert not lemma1.verdict(found([9.0, 1.2, 1.2], [9.0, 0.01, 0.02])).holds  # not at the floor
    assert not lemma1.verdict(found([9.0, 1.0, 1.0], [9.0, 0.1, 0.2])).holds  # 90 times, not 100
    falling = lemma1.verdict(found([9.0, 1.0, 1.0], [9.0, 0.02, 0.01])).found
    assert "larger again" not in falling


def horizon(last, bound):
    return {
        "seconds": [100, 1000, 4000],
        "momentum": over_seeds([0.1, 1.0, last]),
        "bound": over_seeds([bound, 50.0, 1e9]),
    }


def test_the_horizons_verdict_follows_the_numbers():
    steady = lemma1_horizon.horizon_verdict(horizon(1.9, 0.2))
    assert "does not grow with T" in steady
    assert "stays below Gronwall's" in steady
    growing = lemma1_horizon.horizon_verdict(horizon(4.0, 0.05))
    assert "it grows with T" in growing
    assert "does not stay below" in growing
    assert "friction damps" not in growing


def limits(largest, order):
    def case(size, p):
        return {
            "rms": over_seeds([1.0, size]),
            "order": over_seeds([p])[0],
            "rms_near_limit": over_seeds([6.0])[0],
            "rms_far_from_limit": over_seeds([2.0])[0],
            "share_beyond_limit": over_seeds([0.02])[0],
        }

    return {"hidden": [2, 30], "reaching": case(largest, order), "limit_removed": case(0.1, 1.0)}


def test_the_limits_verdict_follows_the_numbers():
    costly = lemma1_limit.limit_verdict(limits(0.5, 0.6))
    assert "it matters: at 30 units the error is 5 times" in costly
    assert "it is 3 times that beyond" in costly
    assert costly.endswith("is slower.")
    cheap = lemma1_limit.limit_verdict(limits(0.2, 1.1))
    assert "only 2 times" in cheap
    assert "not slower" in cheap
