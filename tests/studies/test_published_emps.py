"""The plant file of EMPS: a friction that never falls with speed, whatever a fit makes of it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.simulation.free_run import free_run
from faultgauge_studies.published.benchmark import benchmark, plant_of

STEP = 1e-3  # s, that of the record


def with_values(seed: int) -> GrayBoxPlant:
    """The file's plant, its free parameters drawn within their limits."""
    rng = np.random.default_rng(seed)
    plant = plant_of(benchmark("emps"))
    values = dict(plant.parameters)
    for each in plant.spec.parameters:
        if not each.fixed:
            low, high = max(each.min, -20.0), min(each.max, 300.0)
            values[each.name] = jnp.asarray(rng.uniform(low, high))
    return eqx.tree_at(lambda p: p.parameters, plant, values)


def friction(plant: GrayBoxPlant, v: np.ndarray) -> np.ndarray:
    """Force [N] against speed, written out: the file's equation by hand."""
    p = {name: float(value) for name, value in plant.parameters.items()}
    steps = sum(
        p[f"S{k}"] * (np.tanh((v - p[f"v{k}"]) / p["w"]) + np.tanh((v + p[f"v{k}"]) / p["w"]))
        for k in (1, 2, 3)
    )
    by_direction = np.where(v > 0, p["Fp"], p["Fm"]) * v
    return p["offset"] + p["Fc"] * np.tanh(v / p["width"]) + by_direction + steps


def acceleration(plant: GrayBoxPlant, v: float, u: float) -> float:
    return float(plant.derivative(jnp.array([0.1, v]), jnp.array([u]))[1])


@pytest.mark.parametrize("seed", range(4))
def test_friction_is_that_of_the_equation_and_never_falls_with_speed(seed):
    plant = with_values(seed)
    v = np.linspace(-0.15, 0.15, 301)
    expected = friction(plant, v)
    mass = float(plant.parameters["M"])
    found = [-mass * acceleration(plant, each, 0.0) for each in v]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)  # rounding
    assert np.all(np.diff(expected) >= -1e-9)  # rounding


@pytest.mark.parametrize("seed", range(4))
def test_two_free_runs_under_one_input_only_come_closer_in_speed(seed):
    # under a heavy carriage: steps of friction drawn at their narrowest are stiff beside a sample
    plant = with_values(seed)
    plant = eqx.tree_at(lambda p: p.parameters["M"], plant, jnp.asarray(1000.0))
    rng = np.random.default_rng(seed)
    u = jnp.asarray(np.repeat(rng.uniform(-8, 8, 20), 50)[:, None])
    dt, f = jnp.full(len(u), STEP), jnp.zeros((len(u), 0))
    runs = [np.asarray(free_run(plant, jnp.array([0.1, v]), u, dt, f, 8).x[:, 1]) for v in (0, 0.1)]
    gap = np.abs(runs[1] - runs[0])
    assert np.all(np.diff(gap) <= 1e-12)  # rounding
    assert gap[-1] < gap[0]


def test_a_carriage_at_rest_stays_under_less_than_coulombs_force_and_goes_under_more():
    plant = plant_of(benchmark("emps"))
    p = {name: float(value) for name, value in plant.parameters.items()}
    for share in (0.5, 1.5):
        u = share * p["Fc"] / p["gtau"]
        dt, f = jnp.full(1000, STEP), jnp.zeros((1000, 0))
        found = free_run(plant, jnp.zeros(2), jnp.full((1000, 1), u), dt, f, 8).x[-1]

        def rates(t: float, x: np.ndarray, u: float = u) -> list[float]:
            force = p["gtau"] * u - float(friction(plant, x[1:])[0])
            return [x[1], force / p["M"]]

        exact = solve_ivp(rates, (0, 0.999), [0.0, 0.0], method="LSODA", rtol=1e-9, atol=1e-12)
        # of SciPy's 1e-9 a second of motion makes less than this
        assert np.asarray(found) == pytest.approx(exact.y[:, -1], rel=1e-5, abs=1e-8)
        assert (found[1] < p["width"]) == (share < 1)
