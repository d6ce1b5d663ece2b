"""Keys of the plant file that shape a fit: hold, delay, vary, shapes of networks, open choices."""

import pytest

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.settle import settle
from faultgauge.plants.shape import FREE, Shape


def text(u="", k="", net=""):
    return f"""
name = "small"
[states.x]
derivative = "-k*x + u + v - N(x) - M(x, u)"
[inputs.u]
{u}
[inputs.v]
hold = "linear"
[outputs.y]
value = "x"
[parameters.k]
{k}
[networks.N]
{net}
[networks.M]
hidden = 3
"""


def small(**given):
    return parse_plant(text(**given), "small.toml")


def refusal(**given):
    with pytest.raises(InputError) as caught:
        small(**given)
    message = str(caught.value)
    assert message.startswith("small.toml: ")
    assert message.endswith(".")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("hold", ["zero", "linear", "band-limited"])
def test_every_hold_is_read(hold):
    spec = small(u=f'hold = "{hold}"')
    assert spec.signals.inputs[0].hold == hold
    assert spec.open_holds == ()


def test_a_hold_that_is_left_out_is_open_and_zero_until_then():
    spec = small()
    assert spec.signals.inputs[0].hold == "zero"
    assert spec.open_holds == ("u",)


@pytest.mark.parametrize(("line", "delay"), [("", 0.0), ("delay = 0", 0.0), ("delay = 2.5", 2.5)])
def test_delay(line, delay):
    assert small(u=line).signals.inputs[0].delay == delay


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("-1", "greater than or equal to 0"),
        ("nan", "finite"),
        ("inf", "finite"),
        ('"1 s"', "should be a number"),
        ("true", "should be a number"),
    ],
)
def test_a_delay_that_is_none_is_refused(line, part):
    message = refusal(u=f"delay = {line}")
    assert "[inputs.u] delay = " in message
    assert part in message


@pytest.mark.parametrize("vary", ["run", "slow", None])
def test_vary(vary):
    assert small(k=f'vary = "{vary}"' if vary else "").parameters[0].vary == vary


def test_a_parameter_cannot_vary_and_be_fixed():
    message = refusal(k='value = 1\nfixed = true\nvary = "slow"')
    assert "[parameters.k] fixed = true and vary = 'slow' contradict each other" in message
    assert "[parameters.k] vary = 'day': should be 'run' or 'slow'" in refusal(k='vary = "day"')


@pytest.mark.parametrize(
    ("net", "shape"),
    [
        ("", FREE),
        ("odd = true", Shape(odd=True)),
        ("odd = false", FREE),
        ("odd = true\nzero_at_zero = true", Shape(odd=True, zero_at_zero=True)),
        ("monotone = true", Shape(monotone="increasing")),
        ('monotone = "increasing"\npositive = true', Shape(positive=True, monotone="increasing")),
        ('monotone = "decreasing"\nodd = true', Shape(odd=True, monotone="decreasing")),
    ],
)
def test_shapes_of_networks(net, shape):
    spec = small(net=net)
    assert spec.networks[0].shape == shape
    assert spec.networks[1].shape == FREE
    plant = GrayBoxPlant.untrained(spec)
    assert plant.networks["N"].shape == shape
    assert hash(spec) == hash(small(net=net))


@pytest.mark.parametrize("key", ["odd", "zero_at_zero"])
def test_shapes_that_contradict_each_other_are_refused(key):
    message = refusal(net=f"positive = true\n{key} = true")
    assert f"[networks.N] positive and {key} contradict each other" in message
    assert "keep one" in message


@pytest.mark.parametrize("value", ['"up"', "1", "false"])
def test_monotone_is_a_direction(value):
    message = refusal(net=f"monotone = {value}")
    assert "[networks.N] monotone = " in message
    assert "should be 'increasing' or 'decreasing'" in message


def test_flags_are_true_or_false():
    assert "[networks.N] odd = 1: should be a boolean" in refusal(net="odd = 1")


def test_a_size_that_is_left_out_is_open_and_ten_until_then():
    spec = small()
    assert [net.hidden for net in spec.networks] == [10, 3]
    assert spec.open_sizes == ("N",)
    assert small(net="hidden = 10").open_sizes == ()


def test_settled_choices_are_made_and_no_longer_open():
    spec = small(u="min = -1\ndelay = 2")
    chosen = settle(spec, {"u": "band-limited"}, {"N": 4})
    u, v = chosen.signals.inputs
    assert (u.hold, u.min, u.delay) == ("band-limited", -1.0, 2.0)
    assert v == spec.signals.inputs[1]
    assert [net.hidden for net in chosen.networks] == [4, 3]
    assert (chosen.open_holds, chosen.open_sizes) == ((), ())
    assert chosen.text == spec.text
    assert GrayBoxPlant.untrained(chosen).networks["N"].bias.shape == (4,)
    assert settle(chosen) == chosen


def test_what_is_not_chosen_stays_open():
    chosen = settle(small(), holds={"u": "linear"})
    assert (chosen.open_holds, chosen.open_sizes) == ((), ("N",))
    chosen = settle(small(), hidden={"N": 7})
    assert (chosen.open_holds, chosen.open_sizes) == (("u",), ())


@pytest.mark.parametrize(
    ("holds", "hidden"),
    [
        ({"v": "zero"}, {}),
        ({"w": "zero"}, {}),
        ({"u": "cubic"}, {}),
        ({}, {"M": 4}),
        ({}, {"N": 0}),
        ({}, {"N": 201}),
    ],
)
def test_choices_that_are_not_open_or_not_legal(holds, hidden):
    with pytest.raises(ValueError, match=next(iter({**holds, **hidden}))):
        settle(small(), holds, hidden)
