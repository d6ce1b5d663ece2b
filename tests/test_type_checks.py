"""Arrays of a wrong shape or type are refused while tests run; the rest is left alone."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float, Int, TypeCheckError

from faultgauge import products
from faultgauge.products import contract, taken
from faultgauge.telemetry.derivatives import noise_sd
from faultgauge.telemetry.readers.join import Channel
from type_checks import jaxtyped

Signal = Float[np.ndarray, "n"]
checked = jaxtyped(typechecker=None)


def test_a_wrong_shape_is_refused():
    assert noise_sd(np.arange(9.0)) >= 0
    with pytest.raises(TypeCheckError):
        noise_sd(np.zeros((9, 9)))
    with pytest.raises(TypeCheckError):
        Channel("a", t=np.zeros((9, 9)), values=np.zeros(9))


def test_a_wrong_type_is_refused():
    assert taken(jnp.arange(3.0), np.array([0, 2])).shape == (2,)
    with pytest.raises(TypeCheckError):
        taken(jnp.arange(3.0), np.array([0.0, 2.0]))


def test_it_is_refused_while_a_program_is_traced():
    with pytest.raises(TypeCheckError):
        jax.jit(lambda a: contract("i,i->", a, a))(jnp.arange(3))


def test_an_axis_has_one_length_within_a_call_and_in_what_it_returns():
    @checked
    def joined(a: Signal, b: Signal, *, size: int = 9) -> Signal:
        return (a + b)[:size]

    def outer() -> Signal:
        return joined(np.ones(2), np.ones(2))

    assert len(outer()) == 2
    assert len(joined(np.ones(3), np.ones(3))) == 3
    with pytest.raises(TypeCheckError):
        joined(np.ones(1), np.ones(3))
    with pytest.raises(TypeCheckError):
        joined(np.ones(3), np.ones(3), size=2)


def test_a_function_within_another_is_its_own_at_every_call():
    def adding(n):
        @checked
        def added(a: Signal) -> Signal:
            return a + n

        return added

    one, two = adding(1.0), adding(2.0)
    assert (one(np.zeros(1))[0], two(np.zeros(1))[0]) == (1.0, 2.0)
    with pytest.raises(TypeCheckError):
        two(np.zeros((1, 1)))


def test_a_dataclass_is_refused_by_what_it_inherits():
    @checked
    @dataclass
    class Base:
        a: Signal

    @checked
    @dataclass
    class More(Base):
        name: str

    assert More(np.zeros(2), "x").name == "x"
    with pytest.raises(TypeCheckError):
        More(np.zeros((2, 2)), "x")


@pytest.mark.parametrize(
    "types",
    [
        Signal,
        float | Signal,
        list[Signal],
        dict[str, Int[np.ndarray, "n"]],
        jax.Array,
        "Float[np.ndarray, '...'] | None",
    ],
)
def test_whatever_holds_an_array_is_checked(types):
    def function(a):
        return a

    function.__annotations__["a"] = types
    assert checked(function) is not function


@pytest.mark.parametrize("types", [int, str | None, "Run", list[str]])
def test_nothing_else_is(types):
    def function(a):
        return a

    function.__annotations__["a"] = types
    assert checked(function) is function


def test_the_hook_has_them_checked():
    assert hasattr(products.contract, "__wrapped__")
