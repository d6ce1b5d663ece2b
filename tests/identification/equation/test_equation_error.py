"""Equation error: which equations belong together, and what each group finds."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.identification.equation.groups import (
    Group,
    assemble,
    fit_group,
    groups,
    scale_networks,
    start_vector,
)
from faultgauge.identification.optimise.levenberg_marquardt import CONVERGED, Options
from faultgauge.identification.optimise.starts import nguyen_widrow
from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant


def plant(states, outputs, parameters=(), networks=()):
    """A plant of two inputs from `name=expression` pairs."""
    text = ['name = "p"', "[inputs.u]", "[inputs.w]"]
    text += [f"[states.{name}]\nderivative = '{value}'" for name, value in states.items()]
    text += [f"[outputs.{name}]\nvalue = '{value}'" for name, value in outputs.items()]
    text += ["[parameters]", *parameters]
    text += [f"[networks.{name}]\nhidden = {hidden}" for name, hidden in dict(networks).items()]
    return GrayBoxPlant.untrained(parse_plant("\n".join(text), "p.toml"))


def found(states, outputs=None, measured=(), **rest):
    outputs = {"y": "x"} if outputs is None else outputs
    return groups(plant(states, outputs, **rest).spec, measured)


def test_equations_with_their_own_unknowns_are_fitted_apart():
    assert found(
        {"x": "A(x, u)", "v": "k*u + B(v)"},
        parameters=["k = {value = 1}"],
        networks={"A": 3, "B": 4},
    ) == [Group((0,), (), ("A",), ()), Group((1,), (), ("B",), ("k",))]


def test_a_shared_network_merges():
    assert found({"x": "A(x)", "v": "u - A(v)"}, networks={"A": 3}) == [
        Group((0, 1), (), ("A",), ())
    ]


def test_a_shared_parameter_merges_states_with_outputs():
    assert found(
        {"x": "k*u"},
        {"y": "x/k", "z": "2*x"},
        ("y", "z"),
        parameters=["k = {value = 1}"],
    ) == [Group((0,), (0,), (), ("k",))]


def test_a_fixed_parameter_does_not_merge():
    assert found(
        {"x": "k*u + A(x)", "v": "k*u + B(v)"},
        parameters=["k = {value = 1, fixed = true}"],
        networks={"A": 3, "B": 3},
    ) == [Group((0,), (), ("A",), ()), Group((1,), (), ("B",), ())]


def test_a_chain_of_shared_unknowns_is_one_group():
    """x and z have nothing in common, but v shares with both."""
    (group,) = found(
        {"x": "a*u", "z": "b*w", "v": "a*u + b*w"},
        parameters=["a = {value = 1}", "b = {value = 1}"],
    )
    assert group == Group((0, 1, 2), (), (), ("a", "b"))


def test_outputs_without_telemetry_fit_nothing():
    states, outputs = {"x": "A(x)"}, {"y": "x", "z": "A(x) + u"}
    assert found(states, outputs, ("y",), networks={"A": 3})[0].outputs == ()
    assert found(states, outputs, ("z",), networks={"A": 3})[0].outputs == (1,)


def test_network_only_in_an_unmeasured_output_is_refused():
    with pytest.raises(InputError, match=r"network 'B' .* without a telemetry column.*--map"):
        found({"x": "A(x)"}, {"y": "x", "z": "B(x)"}, ("y",), networks={"A": 3, "B": 3})


def test_nothing_unknown_nothing_to_fit():
    assert found({"x": "u - x"}) == []


def samples(count=300, seed=0, **columns):
    """Random points of a plant with two inputs; `columns` replaces x, u, dx or y."""
    rng = np.random.default_rng(seed)
    states = columns["dx"].shape[1] if "dx" in columns else 1
    parts = {"x": rng.uniform(-2, 3, (count, states)), "u": rng.uniform(-1, 1, (count, 2))}
    parts |= {"dx": rng.normal(size=(count, states)), "y": np.zeros((count, 1))}
    return Samples(**{**parts, **columns})


def test_scalings_are_mapminmax():
    body = plant({"x": "A(2*x, u)"}, {"y": "x"}, networks={"A": 3})
    data = samples()
    (group,) = groups(body.spec, ())
    network = scale_networks(body, group, data).networks["A"]
    arguments = np.stack([2 * data.x[:, 0], data.u[:, 0]])
    low, high = arguments.min(axis=1), arguments.max(axis=1)
    np.testing.assert_allclose(network.input_center, (low + high) / 2, rtol=1e-15)
    np.testing.assert_allclose(network.input_scale, (high - low) / 2, rtol=1e-15)
    assert float(network.output_scale) == pytest.approx(np.ptp(data.dx) / 2, rel=1e-15)


@pytest.mark.parametrize(
    ("keys", "center", "scale"),
    [
        ("odd = true", 0.0, 3.0),  # [-3, 3]
        ("zero_at_zero = true", 1.5, 1.5),  # [0, 3]
        ("positive = true", 2.0, 1.0),
        ('monotone = "increasing"', 2.0, 1.0),
    ],
)
def test_scalings_and_starts_of_a_shaped_network(keys, center, scale):
    """Arguments in [1, 3]."""
    text = plant({"x": "u + A(x)"}, {"y": "x"}, networks={"A": 3}).spec.text
    body = GrayBoxPlant.untrained(parse_plant(f"{text}\n{keys}", "p.toml"))
    data = samples(x=np.linspace(1.0, 3.0, 300)[:, None])
    (group,) = groups(body.spec, ())
    scaled = scale_networks(body, group, data)
    network = scaled.networks["A"]
    assert float(network.input_center[0]) == pytest.approx(center, abs=1e-15)
    assert float(network.input_scale[0]) == pytest.approx(scale, rel=1e-15)
    assert float(network.output_center) == 0.0
    theta = start_vector(scaled, group, np.zeros(0), np.random.default_rng(0))
    weights = nguyen_widrow(3, 1, np.random.default_rng(0), body.spec.networks[0].shape)
    np.testing.assert_array_equal(theta, np.concatenate([np.ravel(w) for w in weights.values()]))


@pytest.mark.parametrize("order", [1, -1])
def test_a_network_called_twice_holds_both_ranges(order):
    """A(x) over [-2, 3] and A(5 u) over [-5, 5], in two equations of different size."""
    equations, sizes = [("x", "A(x)"), ("v", "u + A(5*u)")][::order], [1, 7][::order]
    narrow, wide = [0, 1][::order]
    body = plant(dict(equations), {"y": "x"}, networks={"A": 3})
    rng = np.random.default_rng(1)
    data = samples(dx=rng.normal(size=(300, 2)) * sizes)
    (group,) = groups(body.spec, ())
    network = scale_networks(body, group, data).networks["A"]
    reached = np.concatenate([data.x[:, narrow], 5 * data.u[:, 0]])
    centre, scale = float(network.input_center[0]), float(network.input_scale[0])
    assert centre - scale == pytest.approx(reached.min(), rel=1e-12)  # rounding of the sums
    assert centre + scale == pytest.approx(reached.max(), rel=1e-12)
    assert float(network.output_scale) == pytest.approx(np.ptp(data.dx[:, wide]) / 2, rel=1e-15)


def test_network_inside_a_network_stays_where_the_outer_one_listens():
    body = plant({"x": "A(B(u))"}, {"y": "x"}, networks={"A": 3, "B": 3})
    (group,) = groups(body.spec, ())
    scaled = scale_networks(
        body, group, samples(dx=1e3 * np.ones((300, 1)) * np.arange(300)[:, None])
    )
    inner, outer = scaled.networks["B"], scaled.networks["A"]
    assert (float(outer.input_center[0]), float(outer.input_scale[0])) == (0.0, 1.0)
    assert float(inner.output_scale) == 1.0
    assert float(outer.output_scale) == pytest.approx(299e3 / 2, rel=1e-15)


def test_argument_that_never_moves_is_named():
    body = plant({"x": "u + A(x, 3*w)"}, {"y": "x"}, networks={"A": 3})
    still = samples()
    still.u[:, 1] = 0.25
    (group,) = groups(body.spec, ())
    with pytest.raises(InputError, match="input 'w' never changes in the logs, so A cannot"):
        scale_networks(body, group, still)
    moving = samples(x=np.full((300, 1), 7.0))
    with pytest.raises(InputError, match="argument 1 of network 'A' never changes"):
        scale_networks(body, group, moving)


def test_argument_that_moves_by_rounding_only_never_moves():
    body = plant({"x": "A(x - u)"}, {"y": "x"}, networks={"A": 3})
    data = samples()
    data.x[:, 0] = data.u[:, 0] + 0.1
    (group,) = groups(body.spec, ())
    with pytest.raises(InputError, match="argument 1 of network 'A'"):
        scale_networks(body, group, data)


def test_unknowns_go_where_they_belong():
    """A vector of 0, 1, 2, ... shows up as weights_out, weights_in, bias, bias_out, parameters."""
    body = plant({"x": "k*A(x, u)"}, {"y": "x"}, ["k = {value = 2}"], {"A": 3})
    (group,) = groups(body.spec, ())
    built = assemble(body, group, jnp.arange(14.0), jnp.array([10.0]))
    network = built.networks["A"]
    np.testing.assert_array_equal(network.weights_out, [0, 1, 2])
    np.testing.assert_array_equal(network.weights_in, [[3, 4], [5, 6], [7, 8]])
    np.testing.assert_array_equal(network.bias, [9, 10, 11])
    assert float(network.bias_out) == 12
    assert float(built.parameters["k"]) == 130
    a = np.tanh(np.array([[3, 4], [5, 6], [7, 8]]) @ [0.01, -0.02] + [9, 10, 11])
    value = float(network(jnp.asarray(0.01), jnp.asarray(-0.02)))
    assert value == pytest.approx(a @ [0, 1, 2] + 12, rel=1e-15)


def fit(body, data, validation=None, starts=2):
    (group,) = groups(body.spec, body.signals.output_names)
    rngs = [np.random.default_rng([9, k]) for k in range(starts)]
    body = scale_networks(body, group, data)
    return fit_group(body, group, data, validation or data, rngs, Options())


def test_linear_parameters_are_numpys_least_squares():
    body = plant(
        {"x": "a*x + b*u + c"},
        {"y": "x"},
        ["a = {value = 1}", "b = {value = -50}", "c = {value = 0}"],
    )
    data = samples()
    noise = np.random.default_rng(2).normal(size=300)
    data = data._replace(dx=(-1.5 * data.x[:, 0] + 80 * data.u[:, 0] + 3 + noise)[:, None])
    design = np.stack([data.x[:, 0], data.u[:, 0], np.ones(300)], axis=1)
    reference, cost, *_ = np.linalg.lstsq(design, data.dx[:, 0])
    plants, solution = fit(body, data)
    for each in plants:
        values = [float(each.parameters[name]) for name in "abc"]
        # the search ends when a step gains less than 1e-10 of the cost: 1e-5 of a standard error
        np.testing.assert_allclose(values, reference, rtol=1e-6)
    np.testing.assert_allclose(solution.cost, cost[0] / np.var(data.dx), rtol=1e-9)
    assert np.all(solution.status == CONVERGED)


def test_a_parameter_in_two_equations_weighs_them_by_their_spread():
    body = plant({"x": "k*u", "v": "k*w"}, {"y": "x"}, ["k = {value = 1}"])
    rng = np.random.default_rng(3)
    u = rng.uniform(-1, 1, (300, 2))
    dx = 2.0 * u + rng.normal(size=(300, 2)) * [0.1, 5]
    plants, _ = fit(body, samples(x=rng.normal(size=(300, 2)), u=u, dx=dx))
    spread = dx.std(axis=0)
    reference, *_ = np.linalg.lstsq((u / spread).reshape(-1, 1), (dx / spread).ravel())
    assert float(plants[0].parameters["k"]) == pytest.approx(reference[0], rel=1e-6)  # as above


def test_first_start_keeps_the_files_parameters():
    """sin(k u) has many minima; the file's guess leads to the one beside it."""
    body = plant({"x": "sin(k*u)"}, {"y": "x"}, ["k = {value = 9}"])
    data = samples()
    data = data._replace(dx=np.sin(9.3 * data.u[:, :1]))
    plants, _ = fit(body, data, starts=1)
    assert float(plants[0].parameters["k"]) == pytest.approx(9.3, rel=1e-9)  # no noise


def test_fixed_parameters_and_other_groups_do_not_move():
    body = plant(
        {"x": "g*u + a*x", "v": "b*w"},
        {"y": "x"},
        ["g = {value = 2, fixed = true}", "a = {value = 1}", "b = {value = 4}"],
    )
    data = samples(dx=np.random.default_rng(4).normal(size=(300, 2)))
    first, _ = groups(body.spec, ())
    plants, _ = fit_group(body, first, data, data, [np.random.default_rng(0)], Options())
    assert float(plants[0].parameters["g"]) == 2
    assert float(plants[0].parameters["b"]) == 4
    assert float(plants[0].parameters["a"]) != 1


def test_network_equation_reads_measured_derivatives_and_outputs():
    """y = A(d(x)) is fitted against the samples' own dx: a tanh of dx, to a thousandth."""
    body = plant({"x": "u"}, {"y": "A(d(x))"}, networks={"A": 4})
    data = samples(dx=np.random.default_rng(5).uniform(-2, 2, (300, 1)))
    data = data._replace(y=np.tanh(data.dx) + 0.3)
    plants, solution = fit(body, data)
    best = plants[int(np.argmin(solution.cost))]
    points = np.linspace(-1.9, 1.9, 9)
    values = [float(best.networks["A"](jnp.asarray(p))) for p in points]
    # one of its units can be this tanh exactly, and there is no noise; LM stops at 1e-10 of cost
    np.testing.assert_allclose(values, np.tanh(points) + 0.3, rtol=0, atol=1e-3)
