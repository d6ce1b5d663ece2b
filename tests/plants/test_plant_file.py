"""The plant file: what is legal loads, what is not is answered by its key."""

import math

import pytest

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.plant_file import parse_plant, presets, read_plant_text
from faultgauge.plants.signals import Detection, Fault, Input, Observation, Output, State

# The example of the documentation.
WHEEL = """
name = "reaction wheel"

[states.h]
unit = "N*m*s"
derivative = "NN1(h, u)"           # d(h)/dt

[inputs.u]
unit = "N*m"
min = -0.82                        # actuator limits, optional
max = 0.82

[outputs.T]
unit = "N*m"
value = "NN2(d(h), h)"             # d(h): that state's derivative

[outputs.hm]
unit = "N*m*s"
value = "h"

[networks.NN1]                     # arguments come from where it is called
hidden = 10

[networks.NN2]
hidden = 10

[faults.friction]                  # hypotheses: what may go wrong, where it enters
enters = "state"
target = "h"
unit = "N*m"
"""

SMALL = """
name = "small"
[states.x]
derivative = "-k*x + u"
[inputs.u]
[outputs.y]
value = "x"
[parameters.k]
"""


def small(old="", new="", *, more=""):
    """The small plant with one piece of text replaced, or with more tables at its end."""
    assert old in SMALL
    return SMALL.replace(old, new, 1) + more if old else SMALL + more


def bounded(bounds):
    """The small plant with a fault of such bounds."""
    return small(more=f'[faults.f]\nenters = "state"\ntarget = "x"\n{bounds}\n')


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse_plant(text, "p.toml")
    message = str(caught.value)
    assert message.startswith("p.toml: ")
    assert message.endswith(".")
    assert "\n" not in message
    assert len(message) < 400
    return message


@pytest.mark.parametrize("name", list(presets()))
def test_presets_load_without_a_warning(name):
    plant = load_plant(name)
    assert plant.spec.warnings == ()
    assert plant.spec.text == presets()[name]
    assert (plant.spec.open_holds, plant.spec.open_sizes) == ((), ()), "nothing to search"


def test_the_presets_are_those_that_ship():
    assert {"dc_motor", "positioning_drive", "positioning_drive_network", "tank"} <= set(presets())


def test_the_documented_example_says_what_it_says():
    spec = parse_plant(WHEEL)
    assert spec.name == "reaction wheel"
    assert spec.warnings == ()
    assert spec.signals.states == (State("h", "N*m*s"),)
    assert spec.signals.inputs == (Input("u", "N*m", -0.82, 0.82),)
    assert spec.signals.outputs == (
        Output("T", "N*m"),
        Output("hm", "N*m*s", measures="h"),
    )
    assert spec.signals.faults == (Fault("friction", "state", "h", "N*m"),)
    assert [(net.name, net.hidden, net.arity) for net in spec.networks] == [
        ("NN1", 10, 2),
        ("NN2", 10, 2),
    ]
    assert hash(spec) == hash(parse_plant(WHEEL))


def test_every_optional_key_is_read():
    spec = parse_plant(
        small("[inputs.u]", '[inputs.u]\nhold = "linear"\nmin = 0')
        .replace("[states.x]", "[states.x]\nmin = -5\nmax = 5\ninitial = 2")
        .replace('value = "x"', 'value = "2*x"\nsigma = 0.5')
        + 'value = 3\nmin = 1\nmax = 4\nfixed = true\nunit = "1/s"\n'
        + '[faults.f]\nenters = "gain"\ntarget = "u"\nmin = 0\nmax = 1\n'
        + '[observer]\noutputs = ["y"]\nbandwidth = 2\n'
    )
    assert spec.signals.states == (State("x", "", -5.0, 5.0, 2.0),)
    assert spec.signals.inputs == (Input("u", "", 0.0, math.inf, "linear"),)
    assert spec.signals.outputs == (Output("y", "", 0.5, None),)
    assert spec.signals.faults == (Fault("f", "gain", "u", "", 0.0, 1.0),)
    assert spec.signals.observation == Observation(("y",), 2.0)
    (k,) = spec.parameters
    assert (k.value, k.min, k.max, k.fixed, k.unit) == (3, 1, 4, True, "1/s")


@pytest.mark.parametrize(
    ("table", "value"),
    [("", 1), ("min = 2", 2), ("max = -3", -3), ("min = 2\nmax = 8", 5), ("min = 0", 1)],
)
def test_a_parameter_without_a_value_starts_inside_its_range(table, value):
    assert parse_plant(small(more=table)).parameters[0].value == value


@pytest.mark.parametrize(
    ("limits", "initial"), [("min = 200", 200), ("max = -1", -1), ("min = -1\nmax = 1", 0)]
)
def test_a_state_starts_as_near_to_zero_as_its_limits_allow(limits, initial):
    spec = parse_plant(small("[states.x]", f"[states.x]\n{limits}"))
    assert spec.signals.states[0].initial == initial


@pytest.mark.parametrize(
    "text",
    [
        small('[outputs.y]\nvalue = "x"', '[outputs.x]\nvalue = "x"'),  # shares a state's name
        small("[parameters.k]", "[parameters]\nk = {value = 1}"),
        small('"-k*x + u"', '"-k*x + NN(x, u)"', more="[networks.NN]"),
        small('"-k*x + u"', '"NN(x) + NN(u)*M(k)"', more="[networks.NN]\n[networks.M]"),
        small('"-k*x + u"', '"v - k*u"', more='[states.v]\nderivative = "NN(v)"\n[networks.NN]'),
        small('value = "x"', 'value = "x + 2*u"'),  # an output may read inputs
        small(more='[faults.y]\nenters = "output"\ntarget = "y"\n'),
        SMALL.replace("\n", "\r\n"),
    ],
    ids=["shared", "inline", "network", "several", "fewer", "feedthrough", "fault", "crlf"],
)
def test_legal_variants_load_without_a_warning(text):
    assert parse_plant(text).warnings == ()


def test_an_unused_name_is_a_warning():
    warnings = parse_plant(small(more="[networks.N]\n[inputs.w]\n"), "p.toml").warnings
    assert warnings == (
        "p.toml: [inputs.w] is declared but no expression uses it",
        "p.toml: [networks.N] is declared but no expression uses it",
    )


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (small("derivative", "derivativ"), ["[states.x]", "unknown key 'derivativ'"]),
        (small("[inputs.u]", "[inputs.u]\nunti = 'V'"), ["[inputs.u]", "did you mean 'unit'"]),
        (small("[inputs.u]", "[input.u]"), ["unknown key 'input' (did you mean 'inputs'?)"]),
        (small(more="bandwith = 3"), ["[parameters.k]", "unknown key 'bandwith'", "legal here"]),
        (small(more="[observer]\nbandwith = 3"), ["[observer]", "did you mean 'bandwidth'"]),
        (small('name = "small"', ""), ["key 'name' is missing"]),
        (small('value = "x"', ""), ["[outputs.y]", "key 'value' is missing"]),
        (small('[outputs.y]\nvalue = "x"', ""), ["key 'outputs' is missing"]),
        ("", ["key 'name' is missing"]),
        ('name = "a"\nstates = {}\noutputs = {}', ["[states] is empty"]),
        (small('name = "small"', "name = 3"), ["name = 3", "should be a string"]),
        (small("[inputs.u]", "[inputs.u]\nunit = 3"), ["[inputs.u] unit = 3", "a string"]),
        (small('"x"', "1.0"), ["[outputs.y] value = 1.0", "a string"]),
        (small("[inputs.u]", "[inputs.u]\nmin = '0'"), ["[inputs.u] min = '0'", "a number"]),
        (small("[inputs.u]", "[inputs.u]\nmin = true"), ["[inputs.u] min = True", "a number"]),
        (small(more="fixed = 1"), ["[parameters.k] fixed = 1"]),
        (small("[parameters.k]", "[parameters]\nk = 1"), ["[parameters] k = 1", "a table"]),
        (small("[inputs.u]", "[[inputs]]"), ["inputs = ", "a table of keys"]),
        (small("[inputs.u]", "[inputs.u]\nhold = 'cubic'"), ["hold = 'cubic'", "'zero'"]),
        (small("[inputs.u]", "[inputs.u]\ninstrument = true"), ["instrument = True", "a string"]),
    ],
)
def test_a_key_that_is_unknown_missing_or_of_the_wrong_type(text, parts):
    message = refusal(text)
    for part in parts:
        assert part in message


@pytest.mark.parametrize("column", ["x", "u", "y", "d_x", "t", "run", ""])
def test_an_instrument_from_inside_the_loop_is_refused(column):
    message = refusal(small("[inputs.u]", f"[inputs.u]\ninstrument = '{column}'"))
    assert f"[inputs.u] instrument = {column!r} is no signal from outside the loop" in message


def test_an_instrument_is_a_column_that_fits_read():
    signals = parse_plant(small("[inputs.u]", "[inputs.u]\ninstrument = 'reference'")).signals
    assert signals.instruments == ("reference",)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (small(more="[inputs.x]"), ["[inputs] 'x' is already declared in [states]"]),
        (small(more="[inputs.k]"), ["[parameters] 'k' is already declared in [inputs]"]),
        (small(more="[networks.u]"), ["[networks] 'u' is already declared in [inputs]"]),
        (small(more='[outputs.u]\nvalue="x"'), ["[outputs] 'u' is already declared in [inputs]"]),
        (small(more='[outputs.k]\nvalue="x"'), ["'k' is already declared in [parameters]"]),
        (
            small(more="[inputs.sin]"),
            ["[inputs] 'sin' stands for the function sin(); choose another name"],
        ),
        (small(more="[inputs.d]"), ["'d' stands for a derivative, d(STATE)"]),
        (small(more="[inputs.t]"), ["'t' stands for a log's time"]),
        (small(more='[outputs.run]\nvalue="x"'), ["'run' stands for the run of a log's row"]),
        (small(more="[parameters.d]"), ["[parameters] 'd' stands for a derivative, d(STATE)"]),
        (small(more="[inputs.d_x]"), ["'d_x' stands for a derivative"]),
        (small(more='[inputs."a b"]'), ["'a b' is not a name"]),
        (small(more="[inputs.2]"), ["'2' is not a name"]),
        (small(more="[inputs.lambda]"), ["'lambda' is not a name"]),
        (small(more='[inputs."µ"]'), ["'µ' is not a name"]),  # formulas would read another mu
        (small(more="[inputs.u]"), ["not valid TOML"]),
    ],
)
def test_a_name_that_is_taken_or_reserved(text, parts):
    message = refusal(text)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (small("[inputs.u]", "[inputs.u]\nmin = 1\nmax = 1"), ["[inputs.u] min = 1", "max = 1"]),
        (small(more="min = 2\nmax = 1"), ["[parameters.k] min = 2 must be less than max = 1"]),
        (small(more="value = 3\nmax = 1"), ["[parameters.k] value = 3 lies outside [-inf, 1]"]),
        (
            small("[states.x]", "[states.x]\ninitial = 2\nmax = 1"),
            ["[states.x] initial = 2 lies outside"],
        ),
        (small(more="fixed = true"), ["[parameters.k] fixed = true needs a value"]),
        (small(more="value = inf"), ["[parameters.k] value = inf", "finite"]),
        (small(more="value = nan"), ["[parameters.k] value = nan", "finite"]),
        (small("[inputs.u]", "[inputs.u]\nmin = -inf"), ["[inputs.u] min = -inf", "finite"]),
        (small("[states.x]", "[states.x]\ninitial = nan"), ["initial = nan", "finite"]),
        (small(more="value = 1" + "0" * 400), ["[parameters.k] value = 1000"]),
        (small(more="value = 1" + "0" * 5000), ["not valid TOML"]),
        (small('value = "x"', 'value = "x"\nsigma = 0'), ["[outputs.y] sigma = 0"]),
        (small('value = "x"', 'value = "x"\nsigma = 1e-300'), ["sigma = 1e-300", "1e-50"]),
        (small(more="value = 1e300"), ["[parameters.k] value = 1e+300", "1e+50"]),
        (small(more="value = 0x" + "f" * 3600), ["[parameters.k] value = 0xff", "63 bits"]),
        (bounded("max = 1e300"), ["[faults.f] max = 1e+300", "1e+50"]),
        (bounded("min = -1e-300"), ["[faults.f] min = -1e-300", "1e-50"]),
        (small(more="[observer]\nbandwidth = -1"), ["[observer] bandwidth = -1", "greater than 0"]),
        (small(more="[observer]\nbandwidth = inf"), ["[observer] bandwidth = inf"]),
        (small(more="[networks.N]\nhidden = 0"), ["[networks.N] hidden = 0"]),
        (small(more="[networks.N]\nhidden = 1e6"), ["[networks.N] hidden = 1000000.0"]),
        (small(more="[networks.N]\nhidden = 1_000_000"), ["hidden = 1000000", "equal to 200"]),
        (small(more="[networks.N]\nhidden = 2.5"), ["hidden = 2.5", "a whole number"]),
        (small(more="[networks.N]\nhidden = true"), ["hidden = True", "a whole number"]),
    ],
)
def test_a_number_outside_its_range(text, parts):
    message = refusal(text)
    for part in parts:
        assert part in message


def fault(enters, target):
    return small(more=f"[faults.f]\nenters = {enters!r}\ntarget = {target!r}")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (fault("actuator", "u"), ["[faults.f] enters = 'actuator'", "'state', 'input'", "'gain'"]),
        (fault("state", "u"), ["[faults.f] unknown state as target 'u'", "legal here: x"]),
        (fault("input", "x"), ["unknown input as target 'x'", "legal here: u"]),
        (fault("gain", "uu"), ["unknown input as target 'uu' (did you mean 'u'?)"]),
        (fault("output", "x"), ["unknown output as target 'x'", "legal here: y"]),
        (small(more='[observer]\noutputs = ["z"]'), ["[observer] outputs: unknown output 'z'"]),
        (small(more="[observer]\noutputs = []"), ["[observer] outputs is empty"]),
        (small(more='[observer]\noutputs = ["y", "y"]'), ["names an output twice"]),
        (small(more='[observer]\noutputs = "y"'), ["[observer] outputs = 'y'", "a list"]),
    ],
)
def test_a_target_that_does_not_exist(text, parts):
    message = refusal(text)
    for part in parts:
        assert part in message


TWO = 'name = "two"\n[states.a]\nderivative = "{a}"\n[states.b]\nderivative = "{b}"\n' + (
    '[outputs.y]\nvalue = "{y}"\n[networks.N]\n'
)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (TWO.format(a="d(b)", b="d(a)", y="a"), ["[states.a]", "circle through a, b"]),
        (TWO.format(a="a", b="d(b)", y="a"), ["[states.b]", "circle through b;"]),
        (
            TWO.format(a="N(a)", b="b", y="N(a, b)"),
            ["[networks.N]", "with 1 and with 2 arguments"],
        ),
        (TWO.format(a="a", b="-y", y="a"), ["[states.b] derivative: column 2", "name 'y'"]),
        (TWO.format(a="a", b="b", y="y"), ["[outputs.y] value: column 1", "name 'y'"]),
        (TWO.format(a="a +", b="b", y="a"), ["[states.a] derivative: column", "not a formula"]),
        (TWO.format(a="", b="b", y="a"), ["[states.a] derivative", "is empty"]),
        (TWO.format(a="a" * 2101, b="b", y="a"), ["[states.a] derivative", "2000"]),
    ],
)
def test_expressions_that_make_no_sense_together(text, parts):
    message = refusal(text)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    "text",
    ["not toml", "a = ", '{"name": "json"}', "name = 'a'\x00", "a=" + "[" * 5000, "x" * 9999],
)
def test_text_that_is_not_toml(text):
    assert "not valid TOML" in refusal(text)


def test_a_line_that_is_no_toml_is_shown():
    """TOML's own booleans are true and false: a yes is named with the line that it is in."""
    said = refusal(small(more="relative = yes"))
    assert "not valid TOML" in said
    assert "in 'relative = yes'" in said


def test_a_file_is_read_with_or_without_a_byte_order_mark(tmp_path):
    for encoding in ("utf-8", "utf-8-sig"):
        path = tmp_path / encoding
        path.write_text(SMALL, encoding)
        assert load_plant(path).spec.name == "small"


def test_a_file_comes_before_a_preset_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert read_plant_text("tank") == presets()["tank"]
    (tmp_path / "tank").write_text(SMALL)
    assert read_plant_text("tank") == SMALL


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    binary, folder, big = tmp_path / "a.fgm", tmp_path / "folder", tmp_path / "big.toml"
    binary.write_bytes(b"\x80\xff\x00\x01" * 10)
    folder.mkdir()
    big.write_text("#" * 1_000_001)
    empty = tmp_path / "empty.toml"
    empty.touch()
    for path, part in [
        (binary, "not a text file"),
        (folder, "cannot be read (Is a directory)"),
        (big, "more than 1 MB"),
        (empty, "key 'name' is missing"),
        (tmp_path / "absent.toml", "cannot be read (No such file or directory)"),
    ]:
        with pytest.raises(InputError) as caught:
            load_plant(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert part in str(caught.value)
    assert "presets dc_motor" in str(caught.value)


def test_keys_of_the_bank():
    more = "[faults.f]\nenters='input'\ntarget='u'\nrate = 0.1\nprior_per_hour = 2\n"
    signals = parse_plant(small(more=more + "[detection]\nmax_simultaneous = 1")).signals
    assert (signals.faults[0].rate, signals.faults[0].prior_per_hour) == (0.1, 2.0)
    assert signals.max_simultaneous == 1
    assert parse_plant(small()).signals.max_simultaneous == 2
    assert "max_simultaneous" in refusal(small(more="[detection]\nmax_simultaneous = 4"))
    assert "rate" in refusal(small(more=more.replace("0.1", "-1")))


def test_when_an_alarm_is_told_and_which_faults_raise_one():
    more = "[faults.f]\nenters='input'\ntarget='u'\nmonitor = 'passive'\n"
    rules = "[detection]\npersistence = 2\nrelease = 0.2\nlatch = true\nhold_off = 30.5"
    signals = parse_plant(small(more=more + rules)).signals
    assert signals.faults[0].monitor == "passive"
    assert signals.detection == Detection(2.0, 0.2, True, 30.5)
    assert parse_plant(small()).signals.detection == Detection()
    for wrong, parts in [
        ("[detection]\npersistence = -1", ["[detection] persistence = -1", "greater than"]),
        ("[detection]\nhold_off = inf", ["[detection] hold_off = inf", "finite"]),
        ("[detection]\nrelease = 0.99", ["[detection] release = 0.99", "0.95"]),
        ("[detection]\nlatch = 1", ["[detection] latch = 1", "boolean"]),
        (more.replace("passive", "off"), ["[faults.f] monitor = 'off'", "'disabled'"]),
    ]:
        said = refusal(small(more=wrong))
        assert all(part in said for part in parts), said


def chain(count):
    """Each state reads the derivative of the next: the order is from the last to the first."""
    states = [
        f'[states.s{k}]\nderivative = "' + (f'd(s{k + 1})"' if k < count - 1 else f'-s{k}"')
        for k in range(count)
    ]
    return "\n".join(['name = "chain"', *states, '[outputs.y]\nvalue = "s0"'])


def test_a_long_chain_of_derivatives_is_put_in_order():
    assert parse_plant(chain(1500)).order == tuple(reversed(range(1500)))


def test_too_many_names_and_too_long_keys_are_refused():
    with pytest.raises(InputError, match=r"\[states\] has more than 2000 tables"):
        parse_plant(chain(2001))
    with pytest.raises(InputError, match="more than 20 parts"):
        parse_plant('name = "x"\n' + "a." * 100_000 + "b = 1")
