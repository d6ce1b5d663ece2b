"""The ESO and its gains against closed forms, and what it refuses."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import place_poles

from faultgauge.errors import InputError
from faultgauge.observers import observe
from faultgauge.observers.eso import design_eso, fal
from faultgauge.observers.gains import ackermann, bandwidth_poles
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Fault, Input, Output, Signals, State


class Chain(Plant):
    """u into the last of n integrators, the first of which is measured."""

    signals: Signals = eqx.field(static=True)

    def derivative(self, x, u):
        return jnp.append(x[1:], u[0])

    def output(self, dx, x, u):
        return x[:1]


def chain(n, enters="state", low=-np.inf, high=np.inf):
    target = {"state": f"x{n - 1}", "input": "u", "output": "y", "gain": "u"}[enters]
    return Chain(
        Signals(
            states=tuple(State(f"x{k}") for k in range(n)),
            inputs=(Input("u"),),
            outputs=(Output("y", measures="x0"),),
            faults=(Fault("f", enters, target, min=low, max=high),),
        )
    )


def design(plant, dt=0.1, bandwidth=1.0, **options):
    points = OperatingPoints(np.zeros((3, len(plant.signals.states))), np.zeros((3, 1)))
    return design_eso(plant, "f", points, dt, bandwidth, ("y",), 1e9, **options)


def estimate(plant, observer, f, dt, u=None, y=None):
    """Fault estimate for a constant fault on a chain that is integrated exactly."""
    samples, n = len(f), len(plant.signals.states)
    x, measured = np.zeros(n), np.empty((samples, 1))
    for k in range(samples):
        measured[k] = x[0]
        a = f[k]
        x = (
            np.array([x[0] + dt * a])
            if n == 1
            else np.array([x[0] + dt * x[1] + dt**2 / 2 * a, x[1] + dt * a])
        )
    steps = np.full(samples, dt)
    steps[0] = 0.0
    info = observe(
        observer,
        jnp.zeros(n),
        jnp.zeros((samples, 1)),
        jnp.asarray(measured if y is None else y(measured)),
        jnp.asarray(steps),
    )
    return np.asarray(info.f), measured[:, 0]


@pytest.mark.parametrize("order", [2, 3])
def test_ackermann_agrees_with_scipy(order):
    rng = np.random.default_rng(order)
    for _ in range(10):
        A, C = rng.normal(size=(order, order)), rng.normal(size=order)
        poles = np.linspace(0.2, 0.6, order).astype(complex)
        wanted = place_poles(A.T, C[:, None], poles.real).gain_matrix[0]
        # both solve an ill-conditioned system: agreement to about sqrt(machine precision)
        np.testing.assert_allclose(ackermann(A, C, poles), wanted, rtol=1e-6, atol=1e-8)


def test_ackermann_says_when_nothing_is_observed():
    with pytest.raises(np.linalg.LinAlgError):
        ackermann(np.eye(2), np.array([1.0, 0.0]), np.array([0.1, 0.2], complex))


@pytest.mark.parametrize("zeta", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("speed", [1e-3, 0.1, 1.1, 10.0, 50.0])
def test_poles_lie_inside_the_unit_circle_at_any_speed(zeta, speed):
    for order in (1, 2, 3):
        assert np.abs(bandwidth_poles(order, speed, zeta, 1.0)).max() < 1


def test_fal_is_equation_12():
    e = np.array([-2.0, -0.1, -0.05, 0.0, 0.05, 0.1, 2.0])
    kappa, delta = 0.5, 0.1
    by_hand = [
        np.sign(v) * abs(v) ** kappa if abs(v) > delta else v / delta ** (1 - kappa) for v in e
    ]
    np.testing.assert_allclose(fal(jnp.asarray(e), kappa, jnp.asarray(delta)), by_hand, rtol=1e-14)


@pytest.mark.parametrize("zeta", [1 / np.sqrt(2), 1.01])
def test_with_kappa_1_the_eso_is_its_linear_closed_form(zeta):
    """One integrator: fhat answers a step f through the placed poles z1, z2 of the error."""
    dt, omega = 0.1, 1.3
    built = design(chain(1), dt, omega, zeta=zeta)
    got, measured = estimate(chain(1), built.observer, np.ones(200), dt)
    z1, z2 = bandwidth_poles(2, omega, zeta, dt)
    # e+ = (I - L C A) e of the current form: L from trace and determinant, by hand
    l1 = 1 - (z1 * z2).real
    l2 = ((1 - z1) * (1 - z2)).real / dt
    x = f = 0.0
    wanted = []
    for k in range(200):
        if k:
            x += dt * f
        e = x - measured[k]
        x, f = x - l1 * e, f - l2 * e
        wanted.append(f)
    np.testing.assert_allclose(got, wanted, atol=1e-10)  # rounding over 200 steps
    assert got[-1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("n", "order"), [(1, 2), (2, 3)])
@pytest.mark.parametrize("speed", [0.05, 1.1, 10.0])
def test_a_constant_fault_is_found_at_any_omega_dt(n, order, speed):
    dt = 0.1
    built = design(chain(n, "input"), dt, speed / dt)
    assert built.order == order
    assert built.radius < 1
    got, _ = estimate(chain(n, "input"), built.observer, np.full(2000, 0.7), dt)
    assert got[-1] == pytest.approx(0.7, abs=1e-6)  # settled: 2000 samples >> 1 / speed


def test_missing_outputs_are_bridged_and_the_estimate_stays_in_its_range():
    dt = 0.1

    def holes(y):
        y = y.copy()
        y[50:60] = np.nan
        return y

    plant = chain(1, high=0.5)
    got, _ = estimate(plant, design(plant, dt).observer, np.ones(300), dt, y=holes)
    assert np.all(np.isfinite(got))
    assert got.max() == 0.5
    np.testing.assert_array_equal(got[50:60], got[49])


def test_what_an_eso_cannot_reach_is_refused_with_the_output_that_is_needed():
    with pytest.raises(InputError, match="add an output that measures x2"):
        design(chain(3))
    with pytest.raises(InputError, match="enters output y directly"):
        design(chain(1, "output"))
    with pytest.raises(InputError, match="gain loss"):
        design(chain(1, "gain"))


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"bandwidth": 0.0}, "bandwidth"),
        ({"bandwidth": -1.0}, "bandwidth"),
        ({"zeta": 0.0}, "zeta"),
        ({"kappa": 1.2}, "kappa"),
        ({"kappa": 0.0}, "kappa"),
        ({"delta": 0.0}, "delta"),
    ],
)
def test_gains_out_of_range_are_refused_by_name(options, name):
    with pytest.raises(InputError, match=f"{name} = .* out of range"):
        design(chain(1), **options)


def test_condition_13_is_reported_and_enforced_in_paper_mode_alone():
    assert not design(chain(1), zeta=0.707).real_poles
    assert design(chain(1), zeta=1.01, paper=True).real_poles
    with pytest.raises(InputError, match=r"\(13\)"):
        design(chain(1), zeta=0.707, paper=True)
