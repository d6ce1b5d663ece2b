"""Condition (13): the sampled error against eigenvalues, the closed form and the real observer."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.observers.eso import design_eso
from faultgauge.observers.observer import OperatingPoints, observe
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge_studies.paper.claims import condition_13
from faultgauge_studies.paper.claims.condition_13_error import FORMS, injection, responses
from faultgauge_studies.paper.claims.condition_13_error import condition_13 as holds
from faultgauge_studies.paper.reproduce import over_seeds

T = 0.25  # s
PLANT = """
name = "integrator"
states.h.derivative = "u"
inputs.u.unit = "N*m"
outputs.hm = { value = "h", unit = "N*m*s" }
faults.friction = { enters = "state", target = "h" }
"""


def run(form, omega, zeta, kappa, delta, jump):
    """Of single cells or lists of them, all of one length."""
    cells = np.broadcast_arrays(*(np.asarray(x, float) for x in (omega, zeta, delta, jump)))
    omega, zeta, delta, jump = (np.atleast_1d(x).copy() for x in cells)
    return responses(form, omega, zeta, kappa, delta, jump)


def test_condition_13_is_zeta_over_1_whatever_the_rest():
    rng = np.random.default_rng(0)
    omega, delta = rng.uniform(0.1, 5.0, 200), rng.uniform(0.01, 2.0, 200)
    zeta = np.where(rng.random(200) < 0.5, 0.999, 1.001)  # far beyond rounding, either side
    for kappa in (0.25, 0.5, 0.75):
        np.testing.assert_array_equal(holds(omega, zeta, kappa, delta), zeta > 1)


@pytest.mark.parametrize("form", FORMS)
def test_the_linear_error_converges_exactly_where_its_eigenvalues_say(form):
    steps, zetas = np.meshgrid([0.1, 0.3, 0.6, 0.9, 1.2, 1.7, 2.3], [0.4, 0.7, 1.05, 1.5, 2.5])
    omega, zeta = steps.ravel() / T, zetas.ravel()
    radius = []
    for w, z in zip(omega, zeta, strict=True):
        # exact flow of (e, f) over T with the innovation held, by the matrix of the paper's (14)
        if form == "held":
            A = np.eye(2) + np.array([[0, T], [0, 0]])
            B = np.array([T * -2 * z * w - T**2 / 2 * w**2, -T * w**2])
        elif form == "euler":
            A, B = np.eye(2) + np.array([[0, T], [0, 0]]), np.array([-2 * z * w * T, -(w**2) * T])
        else:
            poles = np.exp(np.roots([1, 2 * z * w, w**2]) * T)
            radius.append(np.abs(poles).max())
            continue
        radius.append(np.abs(np.linalg.eigvals(A + np.outer(B, [1, 0]))).max())
    radius = np.array(radius)
    assert np.abs(radius - 1).min() > 5e-3  # 1500 s decide every cell: 0.995^6000 < 1e-13
    found = run(form, omega, zeta, 1.0, 1.0, 0.1)  # kappa = 1 is linear
    np.testing.assert_array_equal(found.converges, radius < 1)


def test_a_nonlinear_gain_moves_the_limit_of_forward_euler_to_1_over_zeta():
    """Between 1/zeta and 2 (zeta - sqrt(zeta^2 - 1)) a small error converges, a large one does not:
    far out g vanishes beside eps, which is multiplied by 1 - 2 zeta omega_o T_s < -1."""
    zeta, step = 1.05, 1.2
    assert 1 / zeta < step < 2 * (zeta - np.sqrt(zeta**2 - 1))
    found = run("euler", step / T, zeta, 0.5, [1.0, 1e-4], 0.2)
    np.testing.assert_array_equal(found.converges, [True, False])


def test_settling_and_overshoot_of_the_placed_form_are_those_of_the_closed_form():
    """At small omega_o T_s: fhat/d = 1 - exp(-a t)(cos b t + a/b sin b t), overshoot
    exp(-pi zeta/sqrt(1 - zeta^2))."""
    w, zeta = 0.2, 0.6
    a, b = zeta * w, w * np.sqrt(1 - zeta**2)
    t = np.arange(0, 200, 0.001)
    off = np.exp(-a * t) * (np.cos(b * t) + a / b * np.sin(b * t))
    settled = t[np.flatnonzero(np.abs(off) > 0.05)[-1]]
    found = run("placed", w, zeta, 1.0, 1.0, 0.1)
    # sampling moves the zero by omega_o T_s/2 = 2.5 % of the damping; a sample is 0.25 s
    assert found.settling[0] == pytest.approx(settled, abs=0.75)
    expected = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    assert found.overshoot[0] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("kappa", "delta"), [(1.0, 1.0), (0.5, 0.05)])
def test_the_placed_form_is_the_product_s_own_observer(kappa, delta):
    plant = GrayBoxPlant.untrained(parse_plant(PLANT, "integrator"))
    points = OperatingPoints(np.zeros((3, 1)), np.zeros((3, 1)))
    design = design_eso(
        plant, "friction", points, T, 0.4, ("hm",), T, zeta=0.7, kappa=kappa, delta=delta
    )
    t = T * np.arange(800)
    h = 0.1 * t  # a fault of 0.1 from t = 0
    found = observe(
        design.observer,
        jnp.zeros(1),
        jnp.zeros((800, 1)),
        jnp.asarray(h[:, None]),
        jnp.asarray(np.diff(t, prepend=0.0)),
    )
    off = np.asarray(found.f) / 0.1 - 1
    ours = run("placed", 0.4, 0.7, kappa, delta, 0.1)
    settled = t[np.flatnonzero(np.abs(off) > 0.05)[-1] + 1]
    assert ours.settling[0] == pytest.approx(settled, abs=1e-9)  # the same samples
    assert ours.overshoot[0] == pytest.approx(max(off.max(), 0.0), abs=1e-9)  # rounding


def test_at_equal_noise_the_bandwidth_goes_with_the_cube_root_of_zeta():
    # continuous: white noise through omega_o^2 s/(s^2 + 2 zeta omega_o s + omega_o^2) has the
    # variance omega_o^3/(4 zeta); sampling changes it by about omega_o T_s = 5 %
    for zeta in (0.5, 0.8, 1.6):
        expected = 0.2 * (zeta / 1.01) ** (1 / 3)
        assert condition_13.at_equal_noise(zeta) == pytest.approx(expected, rel=0.05)


def told(lost, kept):
    """Results with the same shares for every form."""
    form = {
        "diverges_where_it_holds": lost,
        "converges_where_it_fails": kept,
        "least_step_where_it_holds": 0.5 if lost else np.inf,
    }
    return condition_13.verdict({"condition_13": over_seeds([dict.fromkeys(FORMS, form)])})


def test_the_verdict_follows_the_numbers():
    assert told(0.0, 0.0).holds
    assert "(13) is sufficient" in told(0.0, 0.0).found
    assert "It is necessary" in told(0.0, 0.0).found
    failed = told(0.25, 0.75)
    assert not failed.holds
    assert "not sufficient" in failed.found
    assert "25% (forward Euler)" in failed.found
    assert "from ω_o T_s = 0.5 on" in failed.found
    assert "not necessary" in failed.found


def test_injection_of_the_placed_form_is_a_pole_placement():
    L1, _, L2 = injection("placed", 0.2, 1.01)
    closed = np.array([[1 - L1, (1 - L1) * T], [-L2, 1 - L2 * T]])  # (I - L C) A
    poles = np.exp(np.roots([1, 2 * 1.01 * 0.2, 0.04]) * T)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(closed)), np.sort(poles), rtol=1e-9)
