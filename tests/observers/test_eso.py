"""The ESO over a plant in two bodies, against the linear filter that it is at kappa = 1."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import dlsim, place_poles

from faultgauge.errors import InputError
from faultgauge.observers import observe
from faultgauge.observers.eso import design_eso, fal
from faultgauge.observers.gains import bandwidth_poles
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.signals import Fault, Input, Output, Signals, State

DT, OMEGA = 0.1, 1.5


class Mass(Plant):
    """Double integrator: u accelerates, position is measured, the fault adds to u."""

    signals: Signals = eqx.field(static=True)

    def derivative(self, x, u):
        return jnp.stack([x[1], u[0]])

    def output(self, dx, x, u):
        return x[:1]


class Tank(Plant):
    """level' = u - 0.3 sqrt(1 + level^2) + leak; the integrated level is measured too."""

    signals: Signals = eqx.field(static=True)

    def derivative(self, x, u):
        return jnp.stack([u[0] - 0.3 * jnp.sqrt(1.0 + x[0] ** 2), x[0]])

    def output(self, dx, x, u):
        return x


class Product(Plant):
    """x' = x u: how the input acts changes its sign with the state."""

    signals: Signals = eqx.field(static=True)

    def derivative(self, x, u):
        return x * u

    def output(self, dx, x, u):
        return x


def mass(low=-np.inf, high=np.inf):
    return Mass(
        Signals(
            (State("q"), State("v")),
            (Input("u"),),
            (Output("y", measures="q"),),
            (Fault("f", "input", "u", min=low, max=high),),
        )
    )


def tank():
    return Tank(
        Signals(
            (State("level"), State("sum")),
            (Input("u"),),
            (Output("level", measures="level"), Output("sum", measures="sum")),
            (Fault("f", "state", "level"),),
        )
    )


TANK = """
name = "tank"
[states.level]
derivative = "u - 0.3*sqrt(1 + level*level)"
[states.sum]
derivative = "level"
[inputs.u]
[outputs.level]
value = "level"
[outputs.sum]
value = "sum"
[faults.f]
enters = "state"
target = "level"
"""


def points(plant, count=3):
    return OperatingPoints(np.zeros((count, len(plant.signals.states))), np.zeros((count, 1)))


def design(plant, measured=("y",), dt=DT, bandwidth=OMEGA, **options):
    return design_eso(plant, "f", points(plant), dt, bandwidth, measured, 1e9, **options)


def run(built, x0, u, y, dt=DT):
    steps = np.full(len(u), dt)
    steps[0] = 0.0
    arrays = (np.asarray(x0, float), u[:, None], y, steps)
    return observe(built.observer, *(jnp.asarray(a) for a in arrays))


def matrices(dt):
    """(A, B, C) of position, speed and input fault over one sample, exact."""
    A = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    return A, np.array([dt**2 / 2, dt, 0.0]), np.array([1.0, 0.0, 0.0])


def drive(f, u, dt=DT):
    """Measured position of the double integrator from rest."""
    A, B, C = matrices(dt)
    x, y = np.zeros(3), np.empty(len(u))
    for k in range(len(u)):
        x[2] = f[k]
        y[k] = C @ x
        x = A @ x + B * u[k]
    return y


def test_fal_is_continuous_and_odd_at_delta():
    for kappa in (0.25, 0.5, 1.0):
        for delta in (1e-3, 0.1, 2.0):
            edge = delta * (1 + np.array([-1e-9, 0.0, 1e-9]))
            got = np.asarray(fal(jnp.asarray(edge), kappa, jnp.asarray(delta)))
            # both branches have slope <= 1 / delta^(1 - kappa): 1e-9 apart in, 2e-9 apart out
            np.testing.assert_allclose(got, delta**kappa, rtol=2e-9)
            np.testing.assert_array_equal(
                np.asarray(fal(jnp.asarray(-edge), kappa, jnp.asarray(delta))), -got
            )


@pytest.mark.parametrize("zeta", [1 / np.sqrt(2), 1.2])
def test_two_integrators_in_it_is_its_linear_closed_form(zeta):
    """xhat_k = (I - L C)(A xhat + B u)_(k-1) + L y_k, with SciPy's gain and SciPy's filter."""
    rng = np.random.default_rng(3)
    u, f = rng.uniform(-1, 1, 150), np.where(np.arange(150) >= 40, 0.6, 0.0)
    y = drive(f, u)
    built = design(mass(), zeta=zeta)
    assert (built.order, built.output) == (3, "y")
    got = run(built, [0, 0], u, y[:, None])

    A, B, C = matrices(DT)
    poles = bandwidth_poles(3, OMEGA, zeta, DT)
    L = place_poles(A.T, (C @ A)[:, None], poles).gain_matrix[0]
    keep = np.eye(3) - np.outer(L, C)
    inputs = np.stack([y, u], axis=1)
    driven = np.stack([keep @ A @ L, keep @ B], axis=1)
    read = np.stack([L, np.zeros(3)], axis=1)
    wanted = dlsim((keep @ A, driven, np.eye(3), read, 1.0), inputs)[1]
    # two gains that agree to 1e-12, through 150 steps of values up to 100
    np.testing.assert_allclose(got.f, wanted[:, 2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(got.x, wanted[:, :2], rtol=0, atol=1e-9)
    assert got.f[-1] == pytest.approx(0.6, abs=1e-3)  # 11 s at 1.5 rad/s: e^-10 and its envelope
    np.testing.assert_allclose(built.poles, np.log(poles) / DT, rtol=1e-9)


@pytest.mark.parametrize("speed", [0.01, 1.1, 10.0])
def test_two_integrators_in_it_converges_at_any_omega_dt(speed):
    samples = int(20 / speed) + 100
    built = design(mass(), bandwidth=speed / DT)
    assert built.radius < 1
    y = drive(np.full(samples, -0.4), np.zeros(samples))
    got = run(built, [0, 0], np.zeros(samples), y[:, None])
    # 20 / omega: e^-(20 / sqrt 2) = 7e-7 of an error whose transient reaches a few f
    assert got.f[-1] == pytest.approx(-0.4, abs=1e-5)


def test_below_kappa_1_a_constant_fault_is_still_found():
    built = design(mass(), kappa=0.6, delta=0.01)
    samples = 400
    y = drive(np.full(samples, 0.3), np.zeros(samples))
    got = run(built, [0, 0], np.zeros(samples), y[:, None])
    # inside delta it is the linear observer: 40 s at 1.5 rad/s leave nothing to see
    assert got.f[-1] == pytest.approx(0.3, abs=1e-6)
    linear = run(design(mass()), [0, 0], np.zeros(samples), y[:, None])
    assert not np.allclose(got.f, linear.f, atol=1e-3)  # but on the way it is another filter


@pytest.mark.parametrize(("low", "high", "bound"), [(-0.1, 0.2, 0.2), (-0.2, 0.1, -0.2)])
def test_the_estimate_stays_inside_the_limits_of_the_fault(low, high, bound):
    samples = 200
    y = drive(np.full(samples, 5 * bound), np.zeros(samples))
    got = np.asarray(run(design(mass(low, high)), [0, 0], np.zeros(samples), y[:, None]).f)
    assert np.all((got >= low) & (got <= high))
    assert got[-1] == bound


def test_without_samples_it_predicts_and_afterwards_it_returns():
    samples, rng = 300, np.random.default_rng(5)
    u, f = rng.uniform(-1, 1, samples), np.full(samples, 0.5)
    y = drive(f, u)
    holes = y.copy()
    holes[150:170] = np.nan
    got = run(design(mass()), [0, 0], u, holes[:, None])
    assert np.all(np.isfinite(got.f))
    np.testing.assert_array_equal(got.f[150:170], got.f[149])
    # it has settled to e^-10 of its transient, and 2 s without a sample leave 2 s^2 / 2 of that
    np.testing.assert_allclose(got.x[169, 0], y[169], atol=1e-3)
    np.testing.assert_array_equal(got.innovation[150:170], 0.0)


def test_a_plant_file_and_the_same_physics_by_hand_give_the_same_estimate():
    rng = np.random.default_rng(1)
    u = rng.uniform(0, 1, 120)
    y = rng.normal(size=(120, 2)).cumsum(axis=0) * 0.1
    bodies = (tank(), GrayBoxPlant.untrained(parse_plant(TANK, "tank.toml")))
    by_hand, by_file = (run(design(body, ("level", "sum")), [0.1, 0.0], u, y) for body in bodies)
    # the same operations in another order, at most: a few roundings
    np.testing.assert_allclose(by_file.f, by_hand.f, rtol=0, atol=1e-13)
    np.testing.assert_allclose(by_file.x, by_hand.x, rtol=0, atol=1e-13)
    assert np.abs(by_hand.f).max() > 0.1


def test_a_measured_state_off_the_chain_is_corrected_at_first_order():
    """`sum` starts 1 too high: the error shrinks by e^(-omega dt) at every sample."""
    level, sums, u = np.full(50, 0.2), DT * 0.2 * np.arange(50), np.full(50, 0.3 * np.sqrt(1.04))
    y = np.stack([level, sums], axis=1)
    got = run(design(tank(), ("level", "sum")), [0.2, 1.0], u, y)
    wanted = sums + np.exp(-OMEGA * DT * np.arange(1, 51))
    np.testing.assert_allclose(got.x[:, 1], wanted, rtol=0, atol=1e-12)  # rounding of 50 steps
    alone = run(design(tank(), ("level",)), [0.2, 1.0], u, y)
    np.testing.assert_allclose(alone.x[:, 1], sums + 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.f, 0, rtol=0, atol=1e-12)


def test_outputs_that_may_not_be_used_are_not():
    with pytest.raises(InputError, match=r"measured outputs \(none\).*measures v"):
        design(mass(), ())
    assert design(tank(), ("level", "sum")).output == "level"
    assert design(tank(), ("sum",)).order == 3  # the longer way round


def test_an_input_whose_sign_changes_with_the_state_is_refused():
    plant = Product(
        Signals(
            (State("x"),), (Input("u"),), (Output("y", measures="x"),), (Fault("f", "input", "u"),)
        )
    )
    both = OperatingPoints(np.array([[-1.0], [0.0], [1.0]]), np.zeros((3, 1)))
    with pytest.raises(InputError, match="'f'"):
        design_eso(plant, "f", both, DT, OMEGA, ("y",), 1e9)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"bandwidth": np.inf}, r"bandwidth = inf .*\(0, inf\)"),
        ({"zeta": 11.0}, r"zeta = 11 .*\(0, 10\]"),
        ({"kappa": -0.5}, r"kappa = -0.5 .*\(0, 1\]"),
        ({"kappa": np.nan}, r"kappa = nan .*\(0, 1\]"),
        ({"delta": -1.0}, r"delta = -1 .*\(0, inf\)"),
        ({"delta": np.inf}, r"delta = inf .*\(0, inf\)"),
    ],
)
def test_a_gain_out_of_range_is_refused_with_what_is_legal(options, sentence):
    with pytest.raises(InputError, match=sentence):
        design(mass(), **options)
