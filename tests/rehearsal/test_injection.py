"""Faults in a recorded log, against arithmetic by hand and against the plant's own equations."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.identification.samples import in_effect
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant import respond
from faultgauge.plants.plant_file import parse_plant
from faultgauge.rehearsal.injection import Injected, NotInjectable, inject, profile
from faultgauge.rehearsal.ways import Way, way_of
from faultgauge.telemetry import Run
from models import record_of

BIAS = Way("u", is_input=True, is_loss=False)
LOSS = Way("u", is_input=True, is_loss=True)
DRIFT = Way("y", is_input=False, is_loss=False)
FADING = Way("y", is_input=False, is_loss=True)


def model(derivative="b*u - a*x", value="x", more="", limits="min = -10\nmax = 10"):
    text = f"""name = "p"
[states.x]
derivative = "{derivative}"
[inputs.u]
{limits}
[outputs.y]
value = "{value}"
[parameters]
a = {{ value = 0.8 }}
b = {{ value = 2.5 }}
[faults.leak]
enters = "state"
target = "x"
[faults.bias]
enters = "input"
target = "u"
[faults.loss]
enters = "gain"
target = "u"
[faults.drift]
enters = "output"
target = "y"
{more}
"""
    plant = GrayBoxPlant.untrained(parse_plant(text, "p.toml"))
    points = [[x, u] for x in (-2.0, 0.5, 3.0) for u in (-1.0, 0.2, 4.0)]
    return Model(plant, record_of(envelope_points=points))


def log(u=(1.0, 2.0, 3.0, 4.0), y=(5.0, 6.0, 7.0, 8.0)):
    return Run("a", "a", np.arange(float(len(u))), {"u": np.array(u), "y": np.array(y)})


def columns(run, *injected, of=None):
    found = inject(run, (of or model()).plant.signals, injected)
    return found.columns["u"].tolist(), found.columns["y"].tolist()


def test_each_kind_by_hand():
    u, y = [1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]
    assert columns(log(), Injected(BIAS, 0.5, 2.0)) == ([1.0, 2.0, 2.5, 3.5], y)
    assert columns(log(), Injected(LOSS, 0.5, 2.0)) == ([1.0, 2.0, 6.0, 8.0], y)
    assert columns(log(), Injected(DRIFT, -0.5, 1.0)) == (u, [5.0, 5.5, 6.5, 7.5])
    assert columns(log(), Injected(FADING, 0.25, 3.0)) == (u, [5.0, 6.0, 7.0, 6.0])


def test_two_in_one_column_by_hand():
    """(1 - 0.5) u_told + 1 = 4 for u_told = 6."""
    u, _ = columns(log(), Injected(LOSS, 0.5, 3.0), Injected(BIAS, 1.0, 2.0))
    assert u == [1.0, 2.0, 2.0, 6.0]


def test_a_ramp_grows_at_its_rate_to_its_size():
    t = np.arange(6.0)
    assert profile(Injected(BIAS, -1.0, 1.0, rate=0.4), t) == pytest.approx(
        [0.0, 0.0, -0.4, -0.8, -1.0, -1.0]
    )


def test_a_ramp_that_does_not_end_is_refused():
    with pytest.raises(NotInjectable, match="still be growing"):
        columns(log(), Injected(BIAS, 1.0, 1.0, rate=0.4))


def test_a_command_that_acts_later_changes_earlier():
    """As it acts, the command has the bias from the onset on, and not before."""
    of = model(limits="delay = 1.0")
    run = log()
    changed = inject(run, of.plant.signals, [Injected(BIAS, 0.5, 2.0)])
    assert changed.columns["u"].tolist() == [1.0, 1.5, 2.5, 3.5]
    acts = in_effect(of.plant.signals, changed).columns["u"]
    before = in_effect(of.plant.signals, run).columns["u"]
    assert (before - acts)[1:].tolist() == [0.0, 0.5, 0.5]


def test_commands_beyond_the_limits():
    """Of 100 samples from the onset on, 5 are at the limit, and 6 are too many."""
    for count in (5, 6):
        u = np.zeros(110)
        u[20 : 20 + count] = -10.0
        run = log(u, u)
        if count == 6:
            with pytest.raises(NotInjectable, match="leave its limits"):
                columns(run, Injected(BIAS, 1.0, 10.0))
            continue
        told, _ = columns(run, Injected(BIAS, 1.0, 10.0))
        assert told == [0.0] * 10 + [-1.0] * 10 + [-10.0] * 5 + [-1.0] * 85


def test_what_was_commanded_beyond_the_limit_did_not_act():
    u, _ = columns(log(u=(12.0, 12.0)), Injected(BIAS, 2.0, 0.0))
    assert u == [8.0, 8.0]


def test_a_loss_of_everything_and_a_missing_column_are_refused():
    with pytest.raises(NotInjectable, match="loss of 1"):
        columns(log(), Injected(LOSS, 1.0, 0.0))
    with pytest.raises(NotInjectable, match="no column 'z'"):
        columns(log(), Injected(Way("z", is_input=False, is_loss=False), 1.0, 0.0))


@pytest.mark.parametrize("name", ["leak", "bias", "loss", "drift"])
def test_the_plant_with_the_fault_does_what_the_log_says(name):
    """dx and y of the faulty plant under the told command are those of the healthy log."""
    of = model()
    signals = of.plant.signals
    fault = signals.faults[signals.fault_names.index(name)]
    way = way_of(of, fault)
    assert way is not None
    x, u, f = 1.7, 2.2, 0.3
    dx, y = respond(of.plant, jnp.array([x]), jnp.array([u]))
    run = log(u=(u, u), y=(float(y[0]), float(y[0])))
    changed = inject(run, signals, [Injected(way, f, 0.0)])
    told = jnp.asarray(changed.columns["u"][:1])
    sizes = jnp.asarray([f if each == name else 0.0 for each in signals.fault_names])
    dx_faulty, y_faulty = respond(of.plant, jnp.array([x]), told, sizes)
    assert float(dx_faulty[0]) == pytest.approx(float(dx[0]), rel=1e-14)  # rounding
    assert float(y_faulty[0]) == pytest.approx(changed.columns["y"][0], rel=1e-14)


@pytest.mark.parametrize(
    ("derivative", "value"),
    [
        ("b*u*x - a*x", "x"),  # the gain is the state
        ("b*u**3 - a*x", "x"),  # or the input itself
        ("-a*x", "x + u"),  # no gain
        ("b*u - a*x", "x + u"),  # the output reads the input, too
    ],
)
def test_a_state_fault_that_no_input_can_stand_for(derivative, value):
    of = model(derivative, value)
    assert way_of(of, of.plant.signals.faults[0]) is None


def test_a_state_fault_through_an_input_that_moves_another_state():
    more = '[states.z]\nderivative = "u - z"\n'
    of = model(more=more)
    points = [[x, 0.0, u] for x in (-2.0, 3.0) for u in (-1.0, 4.0)]
    assert (
        way_of(Model(of.plant, record_of(envelope_points=points)), of.plant.signals.faults[0])
        is None
    )
