"""The forward sensitivities of a simulated window against JAX and against finite differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from faultgauge.identification.simulation_error.drift import SlowWalk
from faultgauge.identification.simulation_error.window_fit import SimulationResidual, WindowBatch
from faultgauge.identification.unknowns import WEIGHTS, unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

PLAIN = """
name = "drive"
[states.v]
derivative = "k*u - friction(v) - c*v"
[states.q]
derivative = "v"
[inputs.u]
hold = "linear"
[outputs.q]
value = "q"
[outputs.torque]
value = "d(v) + bend(q, u)"
[parameters]
k = { value = 2.0, min = 0, vary = "run" }
c = { value = 0.4 }
[networks.friction]
hidden = 3
odd = true
[networks.bend]
hidden = 2
"""
LIMITED = PLAIN.replace("[states.q]", "[states.q]\nmin = -0.2\nmax = 0.35")
PHYSICS = """
name = "tank"
[states.level]
derivative = "inflow - a*sqrt(max(level, 0.01))"
min = 0
max = 1.2
[states.inflow]
derivative = "b*(u - inflow)"
[inputs.u]
[outputs.level]
value = "level"
[parameters]
a = { value = 0.5, min = 0 }
b = { value = 2.0, min = 0, vary = "slow" }
"""
SAMPLES, STEP = 40, 0.1


def plant(text, seed=0):
    """Networks with weights that do something."""
    untrained = GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))
    rng = np.random.default_rng(seed)
    networks = {}
    for name, net in untrained.networks.items():
        for field in WEIGHTS:
            old = getattr(net, field)
            net = replaced(net, field, jnp.asarray(0.7 * rng.standard_normal(old.shape)))
        networks[name] = replaced(net, "input_scale", 3.0 * net.input_scale)
    return GrayBoxPlant(untrained.signals, untrained.spec, networks, untrained.parameters)


def replaced(net, field, value):
    values = {**vars(net), field: value}
    return type(net)(**values)


def window(outputs, substeps, slow, seed=1):
    """A window with samples that weigh nothing, and a padded tail."""
    rng = np.random.default_rng(seed)
    u = 1.5 * np.sin(np.linspace(0, 7, SAMPLES))
    stages = np.linspace(u, np.append(u[1:], u[-1]), 2 * substeps + 1, axis=1)[..., None]
    dt = np.full(SAMPLES, STEP)
    dt[-4:] = 0.0
    weight = rng.uniform(0.5, 2.0, (SAMPLES, outputs))
    weight[rng.uniform(size=weight.shape) < 0.2] = 0.0
    weight[-3:] = 0.0
    return WindowBatch(
        center=jnp.array([0.1, 0.2]),
        sd=jnp.array([0.5, 0.05]),
        stages=jnp.asarray(stages),
        dt=jnp.asarray(dt),
        y=jnp.asarray(rng.normal(size=(SAMPLES, outputs))),
        weight=jnp.asarray(weight),
        walk=jnp.asarray(SlowWalk.over(slow, SAMPLES, 1).walk(SAMPLES)),
    )


@eqx.filter_jit
def errors(residual, own, at):
    return residual(own, at)


@eqx.filter_jit
def jacobians(residual, own, at):
    return residual.linearised(own, at), jax.jacfwd(residual)(own, at)


CASES = {
    "networks, two substeps": (PLAIN, 2, False),
    "networks, limits, robust": (LIMITED, 1, True),
    "physics, limits, two substeps, robust": (PHYSICS, 2, True),
}


# networks and two substeps are in one of the others each
STUDY = pytest.param("networks, two substeps", marks=pytest.mark.study)


@pytest.mark.parametrize("name", [STUDY, *list(CASES)[1:]])
def test_jacobian(name):
    text, substeps, robust = CASES[name]
    model = plant(text)
    unknowns = unknowns_of(model)
    assert len(unknowns.varying) == 1
    residual = SimulationResidual(model, jnp.asarray(0.3), unknowns, substeps, robust)
    at = window(len(model.signals.outputs), substeps, len(unknowns.slow))
    # of the states, the window's own parameter, and how it drifts over 3 stretches of 16 samples
    start = np.array([0.2, -0.3, 0.15, *(3.0, -2.0, 4.0)[: 3 * len(unknowns.slow)]])
    own = jnp.asarray(np.concatenate([unknowns.vector(model), start]))
    (r, J), forward = jax.tree.map(np.asarray, jacobians(residual, own, at))
    # three programs of the same sums over 40 steps: rounding
    np.testing.assert_allclose(r, errors(residual, own, at), rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(J, forward, rtol=1e-9, atol=1e-11 * np.abs(J).max())
    differences = least_squares(  # with one evaluation: central differences where it starts
        lambda p: np.asarray(errors(residual, jnp.asarray(p), at)),
        np.asarray(own),
        jac="3-point",
        max_nfev=1,
    ).jac
    # steps of eps^(1/3) leave about eps^(2/3) = 4e-11, times curvatures of up to 1e3
    np.testing.assert_allclose(J, differences, rtol=0, atol=1e-7 * np.abs(J).max())
    if "limits" in name:  # the limit is reached, or nothing was tested
        x = np.asarray(residual.run(own, at)[0])
        low = np.array([state.min for state in model.signals.states])
        high = np.array([state.max for state in model.signals.states])
        assert np.any((x == low) | (x == high))


def test_the_prior_of_a_start_stands_below_the_errors():
    """Residuals end with sigma times the window's own unknowns, and padding weighs nothing."""
    model = plant(PLAIN)
    unknowns = unknowns_of(model)
    residual = SimulationResidual(model, jnp.asarray(0.3), unknowns, 1)
    at = window(2, 1, 0)
    own = jnp.asarray(np.concatenate([unknowns.vector(model), [0.2, -0.3, 0.15]]))
    r = np.asarray(errors(residual, own, at))
    np.testing.assert_allclose(r[-3:], 0.3 * np.array([0.2, -0.3, 0.15]), rtol=1e-14)
    error = r[:-3].reshape(SAMPLES, 2)
    assert np.all(error[np.asarray(at.weight) == 0] == 0)
    assert np.all(error[np.asarray(at.weight) > 0] != 0)


@pytest.mark.parametrize("size", [0.01, 1.0, 50.0])
def test_bounded_errors_by_hand(size):
    """Half the squared robust residual is b^2 (sqrt(1 + (r/b)^2) - 1), b = 1.345 sigma."""
    model = plant(PHYSICS)
    sigma = 0.2
    plain = SimulationResidual(model, jnp.asarray(sigma), unknowns_of(model), 1)
    robust = SimulationResidual(model, jnp.asarray(sigma), unknowns_of(model), 1, True)
    at = window(1, 1, 1)
    at = WindowBatch(at.center, at.sd, at.stages, at.dt, at.y, size * at.weight, at.walk)
    own = jnp.asarray(np.concatenate([unknowns_of(model).vector(model), np.zeros(6)]))
    r, bounded = (np.asarray(errors(each, own, at))[:SAMPLES] for each in (plain, robust))
    b = 1.345 * sigma
    np.testing.assert_allclose(
        0.5 * bounded**2, b**2 * (np.sqrt(1 + (r / b) ** 2) - 1), rtol=1e-9, atol=1e-15
    )  # the right side loses (r / b)^2 digits where r is small
    np.testing.assert_array_equal(np.sign(bounded), np.sign(r))
