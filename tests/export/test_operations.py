"""Every operation of the C printer against JAX itself, on the same numbers."""

import math
import re
from collections import OrderedDict

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from scipy.special import erfinv

from faultgauge.errors import InputError
from faultgauge.export.compile import ExportedStep, identifier, print_step
from faultgauge.export.native import FASTER, Native
from faultgauge.observers.rows import where_needed

COUNT = 40
# libm and XLA round exp, log, erf and their like differently: a few units in the last place
CLOSE = {"rtol": 1e-13, "atol": 1e-14}

OPERATIONS = {
    "arithmetic": lambda a, b, k: (a + b) * a - b / (2 + abs(a)) + -a,
    "powers": lambda a, b, k: a**3 + (2 + abs(b)) ** -2 + jnp.sqrt(abs(a)) + lax.rsqrt(1 + a * a),
    "pow": lambda a, b, k: abs(a) ** b,
    "functions": lambda a, b, k: jnp.exp(a) + jnp.log(1 + abs(b)) + jnp.log1p(abs(a)) + jnp.sin(b),
    "more": lambda a, b, k: jnp.cos(a) + lax.erf(b) + lax.erfc(a) + jnp.expm1(b) + jnp.tanh(a),
    "angles": lambda a, b, k: jnp.arctan2(a, b) + jnp.tan(a / 9) + jnp.arctan(b) + jnp.cosh(a),
    "softplus": lambda a, b, k: jax.nn.softplus(a) + jax.nn.sigmoid(b) + jnp.logaddexp(a, b),
    "rounding": lambda a, b, k: jnp.floor(a) + jnp.ceil(b) + jnp.round(3 * a) + a % 0.3,
    "limits": lambda a, b, k: jnp.clip(a, -0.5, 0.5) + jnp.maximum(a, b) + jnp.minimum(a, b[0]),
    "signs": lambda a, b, k: jnp.sign(a) + jnp.abs(b) + (jnp.sign(k) + abs(k - 3))[:, None],
    "logic": lambda a, b, k: jnp.where((a > b) & ~(a < 0) | (b >= 1) ^ (a == b), a, b),
    "compared": lambda a, b, k: (a > b) + 2 * (a <= 0.1) + 4 * (k != 2)[:, None],
    "sums": lambda a, b, k: a.sum() + a.sum(1) + b.prod() + a.mean(0)[1] + a.max() + b.min(1),
    "all": lambda a, b, k: (a > -9).all() + 2 * (b > 1).any() + 4 * (a > 0).all(1),
    "matrices": lambda a, b, k: a @ b.T @ a + jnp.einsum("ij,kj->ik", a, b) @ b,
    "batches": lambda a, b, k: (
        jnp.einsum("ij,ik->ijk", a, b).sum(2) + jax.vmap(jnp.dot)(a, b)[:, None]
    ),
    "views": lambda a, b, k: a.T.reshape(3, 4)[:, ::-1].T[1:, :2] + b[:, 2:],
    "slices": lambda a, b, k: a[::2, 1:].sum() + jnp.squeeze(b[:1, :1]) + a[1:2],
    "joined": lambda a, b, k: jnp.concatenate([a, b[:1], jnp.ones((2, 4))]) + jnp.stack([a[0]] * 6),
    "padded": lambda a, b, k: jnp.pad(a, ((1, 0), (0, 2)), constant_values=7.0),
    "places": lambda a, b, k: (
        a[k[0]] + a[:, k[1]].sum() + a[jnp.array([2, 0]), jnp.array([1, 3])][0]
    ),
    "gathered": lambda a, b, k: (
        a[k][:, jnp.array([0, 2])] + jnp.take(b, k, axis=1, mode="clip")[:, :1]
    ),
    "beyond": lambda a, b, k: jnp.take(a, 5 * k, axis=0, mode="fill"),
    "sliced": lambda a, b, k: lax.dynamic_slice(a, (k[0], k[1]), (2, 2)),
    "updated": lambda a, b, k: lax.dynamic_update_slice(a, b[:2, :2], (k[1], k[2])),
    "set": lambda a, b, k: a.at[k[0]].set(b[1]).at[:, k[1]].add(1.0).at[7 * k[0], 0].set(9.0),
    "scattered": lambda a, b, k: a.at[k, jnp.array([0, 1, 1])].multiply(b[0, :3]),
    "most": lambda a, b, k: jnp.argmax(a) + 10 * jnp.argmin(b, axis=1) + jnp.argmax(k),
    "running": lambda a, b, k: jnp.cumsum(a, axis=1) + lax.cummax(b) + jnp.cumprod(b, axis=0),
    "back": lambda a, b, k: lax.cumsum(a, axis=0, reverse=True) + jnp.diff(b, prepend=0.0),
    "sorted": lambda a, b, k: jnp.sort(a, axis=1) + b[jnp.argsort(a[:, 0])],
    "chosen": lambda a, b, k: lax.cond(a[0, 0] > 0, lambda x: x @ b.T, lambda x: b @ x.T, a),
    "switched": lambda a, b, k: lax.switch(k[0], [jnp.sin, jnp.cos, jnp.tanh], a),
    "nested": lambda a, b, k: lax.cond(
        a[0, 0] > 0, lambda x: lax.cond(b[0, 0] > 0, lambda z: z + 1, lambda z: -z, x), jnp.exp, a
    ),
    "turns": lambda a, b, k: lax.scan(lambda c, x: (0.5 * c + x, c.sum()), a[0], (b, a)[0])[1],
    "shifted": lambda a, b, k: lax.scan(
        lambda c, x: ((c[1], c[0] + x, c[2] + 1), c[0]), (a[0], b[0], 0), b, reverse=True
    )[0][1],
    "counted": lambda a, b, k: lax.fori_loop(0, 5, lambda i, x: x * 0.9 + i + b[i % 3], a),
    "numbers": lambda a, b, k: k * 2 - 7 // 3 + k[1] % 2 + a.astype(int)[0, :3],
    "inverse": lambda a, b, k: lax.erf_inv(a / 4),
}


def three():
    return OrderedDict(a=jnp.zeros((3, 4)), b=jnp.zeros((3, 4)), k=jnp.zeros(3, int))


def step(state, given):
    said = {name: function(*given.values()) for name, function in OPERATIONS.items()}
    return state, OrderedDict(said)


@pytest.fixture(scope="module")
def samples():
    rng = np.random.default_rng(0)
    a, b = 1.3 * rng.standard_normal((2, COUNT, 3, 4))
    return {"a": a, "b": b, "k": rng.integers(0, 3, (COUNT, 3))}


@pytest.fixture(scope="module")
def both(samples):
    """(what C says, what JAX says), by operation."""
    printed = print_step(ExportedStep(step, (), three(), {}), "all")
    given = OrderedDict((k, jnp.asarray(v)) for k, v in samples.items())
    said = jax.jit(lambda: lax.scan(step, (), given)[1])()
    with Native(printed) as native:
        return native.run(samples), said


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_that_of_jax(name, cc, both):
    found, wanted = both[0][identifier(name)], np.asarray(both[1][name])
    np.testing.assert_allclose(found.reshape(wanted.shape), wanted, **CLOSE)


def test_inline_functions_are_those_of_libm(cc):
    """To three units in the last place, and at the ends of their ranges; what would be subnormal is
    0, as XLA has it."""
    inline = {"exp": jnp.exp, "log": jnp.log, "log1p": jnp.log1p, "erf": lax.erf, "erfc": lax.erfc}

    def one(state, given):
        return state, OrderedDict((name, f(given["x"])) for name, f in inline.items())

    ends = [0.0, -0.0, 1.0, -1.0, -2.0, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e308, 710.0]
    wide = np.concatenate(
        [2.0 ** np.linspace(-60, 1000, 4000), -(2.0 ** np.linspace(-60, 9, 3000))]
    )
    x = np.concatenate([ends, np.linspace(-30, 30, 20_001), wide])
    printed = print_step(ExportedStep(one, (), {"x": jnp.zeros(())}, {}), "inline", inline=True)
    assert not re.search(r"[^_](exp|log|log1p|erfc?)\(", printed.step)
    with Native(printed, FASTER) as native, np.errstate(all="ignore"):
        found = native.run({"x": x})
        for name in inline:
            wanted = np.vectorize(getattr(np if hasattr(np, name) else math, name))(x)
            wanted = np.where(np.abs(wanted) < 2.3e-308, 0.0, wanted)
            got = np.where(np.abs(found[name]) < 2.3e-308, 0.0, found[name])
            np.testing.assert_allclose(got, wanted, rtol=7e-16, atol=3e-308, err_msg=name)


def test_the_inverse_of_erf_is_that_of_scipy(cc, both, samples):
    wanted = erfinv(samples["a"] / 4)
    np.testing.assert_allclose(both[0]["inverse"].reshape(wanted.shape), wanted, **CLOSE)


def test_what_is_no_number_goes_where_jax_has_it_go(cc):
    """NaN wins a maximum and an argmax, comes last in a sort, and is 0 as an integer."""

    def odd(state, given):
        a, b = given["a"], given["b"]
        return state, OrderedDict(
            most=jnp.maximum(a, b), least=jnp.minimum(a, b), sign=jnp.sign(a),
            place=jnp.argmax(a), low=jnp.argmin(a), sorted=jnp.sort(a), clip=jnp.clip(a, -1, 1),
            whole=a.astype(int), there=jnp.isfinite(a), sum=jnp.where(jnp.isnan(a), 0, a),
        )  # fmt: skip

    # no subnormal: XLA takes it for 0, and C does not
    values = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-300, 1e308, -1.5])
    a = np.array([np.roll(values, k) for k in range(8)])
    b = np.array([np.roll(values[::-1], 3 * k) for k in range(8)])
    example = OrderedDict(a=jnp.zeros(8), b=jnp.zeros(8))
    given = OrderedDict(a=jnp.asarray(a), b=jnp.asarray(b))
    said = lax.scan(odd, (), given)[1]
    with Native(print_step(ExportedStep(odd, (), example, {}), "odd")) as native:
        found = native.run({"a": a, "b": b})
    for name, wanted in said.items():
        got = found[name].reshape(wanted.shape)
        np.testing.assert_array_equal(got, np.asarray(wanted), err_msg=name)


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda a: jnp.linalg.qr(a)[0], "which the C printer has no form of"),
        (lambda a: lax.while_loop(lambda x: x.sum() > 1, lambda x: x / 2, a), "longest time"),
        (lambda a: (jax.debug.print("{}", a[0, 0]), a)[1], "side effect"),
        (lambda a: a + 1j, "numbers of type complex"),
    ],
)
def test_what_c_cannot_carry_is_refused_with_the_reason(function, said):
    given = ExportedStep(lambda s, g: (s, {"x": function(g["a"])}), (), {"a": jnp.ones((2, 2))}, {})
    with pytest.raises(InputError, match=said):
        print_step(given, "none")


def test_only_one_side_of_a_condition_is_computed_and_constants_are_not():
    """The dearer branch counts, and what depends on no argument is not in the program."""

    def one(state, given):
        table = jnp.exp(jnp.arange(5.0))
        x = given["x"]
        said = lax.cond(x > 0, lambda x: jnp.exp(jnp.sin(x)), lambda x: jnp.exp(x), x)
        return state, {"y": said + table[2]}

    printed = print_step(ExportedStep(one, (), {"x": jnp.zeros(())}, {}), "one")
    assert printed.operations["functions"] == 2
    assert printed.step.count("exp(") == 2
    assert not printed.tables.strip()
    assert [each.kind for each in printed.work] == ["int32_t"]  # the choice


def test_what_no_turn_of_a_loop_changes_is_computed_once():
    def one(state, given):
        def turn(total, k):
            return total + k * jnp.exp(given["x"]), None

        return state, {"y": lax.scan(turn, 0.0, jnp.arange(5.0))[0]}

    printed = print_step(ExportedStep(one, (), {"x": jnp.zeros(())}, {}), "one")
    assert printed.operations["functions"] == 1


def test_rows_that_need_no_answer_are_neither_computed_nor_copied(cc):
    """Two of three rows go on where they lie; NaN in the one that does not would be seen."""
    rows, more = jnp.array([[1.0, 2.0], [np.nan, 0.0], [3.0, 4.0]]), jnp.arange(3.0)

    def one(state, given):
        state, said = where_needed(
            lambda a, b: (2 * a + b[:, None], jnp.sum(a, axis=1)), given["needed"] > 0, state, more
        )
        return state, {"y": said}

    printed = print_step(ExportedStep(one, rows, {"needed": jnp.zeros(3)}, {}), "one")
    with Native(printed) as native:
        said = native.run({"needed": np.array([[1.0, 0.0, 1.0]] * 2)})
        np.testing.assert_array_equal(said["y"], [[3, 0, 7], [6, 0, 18]])
        np.testing.assert_array_equal(native.state["value"][0], [4, 8, np.nan, 0, 18, 22])
    assert [each.kind for each in printed.work] == ["int32_t"]  # the choice


def test_a_choice_within_a_choice_by_the_same_test_has_one_way(cc):
    """As `where` is written where a quotient must not be by 0."""

    def one(state, given):
        x, y = given["x"], given["y"]
        there = x > 0
        return state, {
            "z": jnp.where(there, y / jnp.where(there, x, 1.0), 7.0),
            "kept": jnp.where(jnp.isnan(x), y, x),
            "both": jnp.where(there, jnp.where(there, x, y), jnp.where(there, y, x - 1)),
        }

    given = {"x": jnp.zeros(()), "y": jnp.zeros(())}
    printed = print_step(ExportedStep(one, (), given, {}), "one")
    assert printed.step.count("?") == 2
    with Native(printed) as native:
        said = native.run({"x": np.array([2.0, 0.0, -1.0, np.nan]), "y": np.full(4, 3.0)})
    np.testing.assert_array_equal(said["z"], [1.5, 7, 7, 7])
    np.testing.assert_array_equal(said["kept"], [2, 0, -1, 3])
    np.testing.assert_array_equal(said["both"], [2, -1, -2, np.nan])


def test_divisors_that_are_known_are_inverted_in_the_engine_alone():
    def one(state, given):
        return state, {"y": given["x"] / jnp.array([3.0, 0.0, 1e-320, 7.0])[0] + given["x"] / 0.0}

    step = ExportedStep(one, (), {"x": jnp.zeros(())}, {})
    assert " / 3.0" in print_step(step, "one").step
    inverted = print_step(step, "one", inline=True).step
    assert repr(1 / 3.0) in inverted
    assert " / 0.0" in inverted
