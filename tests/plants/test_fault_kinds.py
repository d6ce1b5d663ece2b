"""Faults of parameters, networks and output gains, against the equations written by hand."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.plant import Plant, ValueChange, respond
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.shape import Shape
from faultgauge.plants.signals import Fault, Input, Output, Signals, State

TEXT = """name = "drive"
[states.w]
unit = "rad/s"
derivative = "(k*u - c*w - N(w))/J"
[inputs.u]
min = -5
max = 5
[outputs.w]
value = "w"
[outputs.a]
value = "2*d(w) + N(2*w)"
[parameters]
k = { value = 2, unit = "N" }
c = { value = 0.5 }
J = { value = 0.25 }
[networks.N]
hidden = 3
"""
X, U = 1.5, 3.0


def bend(p):
    """The network below, as NumPy has it: one unit, tanh(p/4), times 3, plus 1."""
    return 1 + 3 * np.tanh(np.clip(p / 4, -1, 1))


def network():
    zeros = Network.zeros(3, 1)
    return dataclasses.replace(
        zeros,
        weights_out=jnp.array([1.0, 0.0, 0.0]),
        weights_in=jnp.array([[1.0], [0.0], [0.0]]),
        input_scale=jnp.array([4.0]),
        output_center=jnp.asarray(1.0),
        output_scale=jnp.asarray(3.0),
    )


def plant(*faults):
    """The drive with faults (enters, target, relative)."""
    text = TEXT
    for k, (enters, target, relative) in enumerate(faults):
        text += f'[faults.f{k}]\nenters = "{enters}"\ntarget = "{target}"\n'
        text += "relative = true\n" if relative else ""
    made = GrayBoxPlant.untrained(parse_plant(text))
    return dataclasses.replace(made, networks={"N": network()})


def by_hand(k=2.0, c=0.5, J=0.25, bent=lambda n: n, share=(1.0, 1.0), x=X, u=U):
    dw = (k * u - c * x - bent(bend(x))) / J
    return dw, [share[0] * x, share[1] * (2 * dw + bent(bend(2 * x)))]


CASES = [  # faults, their sizes, what the equations then hold
    ([("parameter", "c", False)], [0.3], {"c": 0.8}),
    ([("parameter", "c", True)], [0.6], {"c": 0.8}),  # friction + 60 %
    ([("parameter", "J", True)], [-0.2], {"J": 0.2}),
    ([("parameter", "k", True), ("parameter", "k", True)], [0.5, -0.5], {"k": 1.5}),
    ([("parameter", "k", False), ("parameter", "k", True)], [1.0, 0.5], {"k": 4.0}),
    ([("parameter", "k", False), ("parameter", "c", False)], [1.0, 0.5], {"k": 3.0, "c": 1.0}),
    ([("network", "N", False)], [0.7], {"bent": lambda n: n + 0.7}),
    ([("network", "N", True)], [-0.4], {"bent": lambda n: 0.6 * n}),
    ([("network", "N", True), ("network", "N", False)], [1.0, -1], {"bent": lambda n: 2 * n - 1}),
    ([("output_gain", "w", False)], [0.25], {"share": (0.75, 1.0)}),
    ([("output_gain", "a", False)] * 2, [0.5, 0.5], {"share": (1.0, 0.25)}),
]


@pytest.mark.parametrize(("faults", "sizes", "changed"), CASES)
def test_a_fault_is_the_equation_with_another_constant(faults, sizes, changed):
    dw, y = by_hand(**changed)
    found = respond(plant(*faults), jnp.array([X]), jnp.array([U]), jnp.array(sizes, float))
    # sums of a few terms of order ten: rounding of float64
    np.testing.assert_allclose(found[0], [dw], rtol=1e-13)
    np.testing.assert_allclose(found[1], y, rtol=1e-13)


def test_an_output_loses_gain_before_its_offset_comes():
    model = plant(("output", "w", False), ("output_gain", "w", False))
    y = respond(model, jnp.array([X]), jnp.array([U]), jnp.array([2.0, 0.5]))[1]
    assert float(y[0]) == 0.5 * X + 2.0


EVERY = [
    ("parameter", "c", True),
    ("parameter", "J", False),
    ("network", "N", False),
    ("network", "N", True),
    ("output_gain", "a", False),
]


@pytest.mark.parametrize("jitted", [False, True])
def test_no_size_is_exactly_no_fault(jitted):
    answer = eqx.filter_jit(respond) if jitted else respond
    x, u = jnp.array([X]), jnp.array([U])
    for healthy, faulty in zip(
        answer(plant(), x, u), answer(plant(*EVERY), x, u, jnp.zeros(5)), strict=True
    ):
        np.testing.assert_array_equal(healthy, faulty)


def test_sizes_may_be_mapped_and_differentiated():
    model, x, u = plant(*EVERY), jnp.array([X]), jnp.array([U])

    def rate(f):
        return respond(model, x, u, f)[0][0]

    slopes = jax.jit(jax.jacfwd(rate))(jnp.zeros(5))
    n, dw = bend(X), by_hand()[0]
    # d(dw)/df by hand: -c w/J, -dw/J, -1/J, -N/J, 0
    np.testing.assert_allclose(slopes, [-3.0, -dw / 0.25, -4.0, -4 * n, 0.0], rtol=1e-13)
    np.testing.assert_allclose(jax.grad(rate)(jnp.zeros(5)), slopes, rtol=1e-13)
    sizes = jnp.linspace(-0.5, 0.5, 7)
    friction = jax.jit(jax.vmap(lambda f: rate(jnp.zeros(5).at[0].set(f))))(sizes)
    expected = [by_hand(c=0.5 * (1 + f))[0] for f in np.linspace(-0.5, 0.5, 7)]
    np.testing.assert_allclose(friction, expected, rtol=1e-13)


@pytest.mark.parametrize(
    "shape",
    [Shape(odd=True), Shape(positive=True), Shape(zero_at_zero=True, monotone="increasing")],
)
def test_a_network_of_any_shape_takes_a_change_of_its_value(shape):
    rng = np.random.default_rng(0)
    free = Network.zeros(4, 2, shape)
    drawn = {n: jnp.asarray(rng.normal(size=getattr(free, n).shape))
             for n in ("weights_out", "weights_in", "bias")}  # fmt: skip
    net = dataclasses.replace(free, **drawn)
    for p in rng.normal(size=(5, 2)):
        p = p.tolist()
        altered = net.altered(ValueChange(1.6, -0.3))(*p)
        # as the sum is ordered otherwise: rounding of terms of order one
        np.testing.assert_allclose(altered, 1.6 * net(*p) - 0.3, rtol=0, atol=1e-14)


def test_values_of_a_network_wherever_it_is_called():
    found = plant().network_values("N", jnp.array([X]), jnp.array([U]))
    np.testing.assert_allclose(found, [bend(X), bend(2 * X)], rtol=1e-14)


class Lag(Plant):
    """x' = (u - x)/T, written by hand."""

    signals: Signals = eqx.field(static=True)
    T: jax.Array

    def derivative(self, x, u):
        return (u - x) / self.T

    def output(self, dx, x, u):
        return x


def lag(base, *faults):
    signals = Signals((State("x"),), (Input("u"),), (Output("y", measures="x"),), faults)
    return base(signals, jnp.asarray(2.0))


class Adjustable(Lag):
    def altered(self, changes):
        return dataclasses.replace(self, T=changes["T"].of(self.T))


def test_a_plant_written_by_hand_needs_the_seam_only_for_such_faults():
    x, u = jnp.array([1.0]), jnp.array([3.0])
    others = lag(Lag, Fault("f", "output_gain", "y"), Fault("g", "state", "x"))
    dx, y = respond(others, x, u, jnp.array([0.5, 4.0]))
    assert (float(dx[0]), float(y[0])) == (5.0, 0.5)
    slow = Fault("slow", "parameter", "T", relative=True)
    assert float(respond(lag(Adjustable, slow), x, u, jnp.array([1.0]))[0][0]) == 0.5  # (3 - 1)/4
    with pytest.raises(NotImplementedError, match="Lag declares faults of T and has no `altered`"):
        respond(lag(Lag, slow), x, u, jnp.array([1.0]))


def written(faults="", states="", inputs="", outputs=""):
    text = TEXT.replace("[states.w]", f"[states.w]\n{states}")
    text = text.replace("[inputs.u]", f"[inputs.u]\n{inputs}")
    text = text.replace("[outputs.a]", f"[outputs.a]\n{outputs}")
    return parse_plant(text + faults, "p.toml")


def test_the_plant_file_reads_the_kinds():
    spec = written(
        '[faults.rough]\nenters = "parameter"\ntarget = "c"\nrelative = true\nmin = -0.5\n'
        '[faults.curve]\nenters = "network"\ntarget = "N"\n'
        '[faults.weak]\nenters = "output_gain"\ntarget = "a"\n'
    )
    assert spec.signals.faults == (
        Fault("rough", "parameter", "c", min=-0.5, relative=True),
        Fault("curve", "network", "N"),
        Fault("weak", "output_gain", "a"),
    )
    assert spec.warnings == ()


def test_exact_and_trusted_are_read_and_absent_by_default():
    spec = written(
        states="exact = true\ntrusted = [-100, 1e3]", inputs="trusted = [0, 5]",
        outputs="trusted = [-2.5, 2.5]",
    )  # fmt: skip
    signals = spec.signals
    assert (signals.states[0].exact, signals.states[0].trusted) == (True, (-100.0, 1000.0))
    assert signals.inputs[0].trusted == (0.0, 5.0)
    assert [output.trusted for output in signals.outputs] == [None, (-2.5, 2.5)]
    plain = written().signals
    assert (plain.states[0].exact, plain.states[0].trusted) == (False, None)
    assert plain.inputs[0].trusted is None
    assert hash(spec) != hash(written())


FAULT = '[faults.f]\nenters = "{}"\ntarget = "{}"\n'
FRICTION = FAULT.format("parameter", "c")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"faults": FRICTION.replace('"c"', '"w"')}, "[faults.f] unknown parameter as target 'w'"),
        ({"faults": FRICTION.replace("parameter", "network")}, "unknown network as target 'c'"),
        ({"faults": FRICTION.replace("parameter", "output_gain")}, "unknown output as target 'c'"),
        ({"faults": FRICTION.replace("parameter", "params")}, "[faults.f] enters = 'params'"),
        ({"faults": FRICTION + "relative = 1\n"}, "[faults.f] relative = 1: should be a boolean"),
        (
            {"faults": '[networks.M]\n[faults.f]\nenters = "network"\ntarget = "M"\n'},
            "[faults.f] target = 'M': no expression calls this network",
        ),
        *(
            (
                {"faults": FAULT.format(enters, target) + f"relative = {to}\n"},
                "[faults.f] relative goes with enters = \"parameter\" or \"network\" alone, "
                f'not with "{enters}"; remove it',
            )
            for enters, target, to in [
                ("state", "w", "true"),
                ("input", "u", "true"),
                ("output", "a", "false"),
                ("gain", "u", "true"),
                ("output_gain", "a", "true"),
            ]
        ),
        ({"states": "exact = 1"}, "[states.w] exact = 1: should be a boolean"),
        ({"inputs": "exact = true"}, "[inputs.u] unknown key 'exact'"),
        *(
            ({table: f"trusted = {bounds}"}, f"[{place}] trusted")
            for table, place in [("states", "states.w"), ("inputs", "inputs.u"),
                                 ("outputs", "outputs.a")]
            for bounds in ("[2, 1]", "[1, 1]", "[]", "[1]", "[1, 2, 3]", "[0, nan]", "[-inf, 1]",
                           '["a", 1]', "5", "[true, 2]")
        ),
        ({"states": "trusted = [2, 1]"}, "should be two numbers, the lower bound and then the"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_in_one_sentence(given, said):
    with pytest.raises(InputError) as caught:
        written(**given)
    message = str(caught.value)
    assert message.startswith("p.toml: ")
    assert said in message
    assert message.endswith(".")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("fault", "unit", "needed"),
    [
        ('enters = "parameter"\ntarget = "k"', "V", "N"),
        ('enters = "parameter"\ntarget = "k"', "N", None),
        ('enters = "parameter"\ntarget = "k"\nrelative = true', "N", "1"),
        ('enters = "parameter"\ntarget = "k"\nrelative = true', "1", None),
        ('enters = "network"\ntarget = "N"', "N", None),  # its unit is nobody's
        ('enters = "network"\ntarget = "N"\nrelative = true', "N", "1"),
        ('enters = "output_gain"\ntarget = "a"', "N", "1"),
    ],
)
def test_units_of_faults(fault, unit, needed):
    found = written(f'[faults.f]\n{fault}\nunit = "{unit}"\n').warnings
    assert len(found) == (needed is not None)
    assert all(f"[faults.f] unit = '{unit}' has the dimension" in each for each in found)
