"""A plant written in Python: what is seen of its code, and what is refused."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import faultgauge as fg
from faultgauge.errors import InputError
from faultgauge.plants.expression import derivatives_used, names_used
from faultgauge.plants.plant import Plant, respond
from faultgauge.plants.signals import Fault, Input, Output, Signals, State
from faultgauge.plants.spec import Parameter


class Pendulum(Plant):
    """Two states of which one is kinematics; the force on the pivot is measured, too."""

    signals: Signals = eqx.field(
        static=True,
        default=Signals(
            (State("angle"), State("speed")),
            (Input("u", min=-1.0, max=1.0), Input("w")),
            (Output("y"), Output("force"), Output("total")),
            (Fault("wear", "parameter", "drag", relative=True),),
        ),
    )
    drag: jax.Array | float = 0.3
    mass: jax.Array | float = 2.0
    constants = (Parameter("drag", 0.0, "1/s", min=0.0),)

    def derivative(self, x, u):
        kicked = jnp.where(u[1] > 0.5, 1.0, 0.0)  # no slope tells of it
        push = jnp.clip(u[0], -0.01, 0.01)  # nor, nearly everywhere, of this
        return jnp.stack([x[1], push + kicked - jnp.sin(x[0]) - self.drag * x[1]])

    def output(self, dx, x, u):
        return jnp.stack(
            [x[0], self.mass * dx[1], jax.lax.fori_loop(0, 3, lambda k, s: s + x[k % 2], 0.0)]
        )


def test_what_each_equation_reads():
    spec = fg.plant(Pendulum()).spec
    read = [names_used(each) for each in spec.derivatives]
    assert read == [{"speed"}, {"angle", "speed", "u", "w", "drag"}]
    assert [names_used(each) for each in spec.values] == [{"angle"}, set(), {"angle", "speed"}]
    assert [derivatives_used(each) for each in spec.values] == [set(), {"speed"}, set()]
    assert [each.measures for each in spec.signals.outputs] == ["angle", None, None]


def test_its_constants_are_leaves_at_the_values_of_its_fields():
    plant = fg.plant(Pendulum(drag=0.7))
    assert {name: float(value) for name, value in plant.parameters.items()} == {"drag": 0.7}
    x, u = jnp.array([0.2, 1.5]), jnp.array([0.005, 0.0])
    moved = plant.with_constants({"drag": jnp.asarray(0.1)})
    np.testing.assert_array_equal(moved.derivative(x, u), Pendulum(drag=0.1).derivative(x, u))
    worn = respond(plant, x, u, jnp.array([0.5]))[0]
    np.testing.assert_allclose(worn, Pendulum(drag=1.05).derivative(x, u), rtol=1e-15)
    np.testing.assert_allclose(respond(Pendulum(drag=0.7), x, u, jnp.array([0.5]))[0], worn)


class Lacking(Pendulum):
    constants = (Parameter("length", 1.0),)


class Short(Pendulum):
    def output(self, dx, x, u):
        return x


class Doubled(Pendulum):
    speed: float = 1.0
    constants = (Parameter("speed", 1.0),)


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        (Lacking, "Lacking: its constants length are no fields of the class"),
        (Short, r"`output` gives an array of shape \(2,\), not \(3,\)"),
        (Doubled, "the name 'speed' stands for two things"),
    ],
)
def test_what_does_not_fit_together_is_refused(plant, said):
    with pytest.raises(InputError, match=said):
        fg.plant(plant())


def test_a_fault_that_enters_nothing_is_refused():
    signals = Signals(
        (State("angle"), State("speed")),
        (Input("u"), Input("w")),
        (Output("y"), Output("force"), Output("total")),
        (Fault("loss", "gain", "v"),),
    )
    with pytest.raises(InputError, match="fault 'loss' enters 'v', which is none of u, w"):
        fg.plant(Pendulum(signals))


class Oven(Plant):
    """A temperature in K, whose square over 300 K is its own value at 300 K."""

    signals: Signals = eqx.field(
        static=True,
        default=Signals((State("T", min=300.0),), (), (Output("power"), Output("sensor"))),
    )

    def derivative(self, x, u):
        return -(x**2) / 300.0

    def output(self, dx, x, u):
        return jnp.stack([x[0] ** 2 / 300.0, x[0]])


def test_what_is_a_state_by_chance_measures_none():
    outputs = fg.plant(Oven()).signals.outputs
    assert [each.measures for each in outputs] == [None, "T"]
