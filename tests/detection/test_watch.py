"""One walk: whatever pieces a log comes in, gone on with from a kept state, or beside others."""

import io
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.uncertain_constants import constants_of
from faultgauge.detection.rows.delay_line import DelayLine
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.watch import Watch
from faultgauge.errors import InputError
from faultgauge.identification.samples import in_effect
from faultgauge.observers.follow import follow
from faultgauge.telemetry import Run
from models import as_stated

HEATER = """
name = "heater"
[states.x]
derivative = "u - 0.5*x"
[states.z]
derivative = "0.2*x - 0.1*z"
[inputs.u]
hold = "zero"
delay = 0.25
[outputs.x]
value = "x"
[outputs.z]
value = "z"
[faults.loss]
enters = "state"
target = "z"
[faults.push]
enters = "input"
target = "u"
"""
STEP, COUNT, EVERY, SIGMA = 0.1, 400, 5, 0.01
LEVELS = [SIGMA, SIGMA], [1e-3, 1e-3], [], [1e-3] * 2, [50.0] * 2, [1e-3], [5.0]


def model(text=HEATER):
    points = np.random.default_rng(0).uniform([-4, -6, -2], [4, 6, 2], (80, 3))
    plain = as_stated(text, points, [("x", 0), ("z", 0)], ["x", "z"])
    one = np.ones(len(constants_of(plain).names))
    noise = Noise(*(np.array(each) for each in LEVELS), 0.01 * one, 0 * one, 0 * one)
    return for_bank(plain, noise, {"x": 1, "z": 1}, level=3.0, healthy_s=500.0)


def log(seed, loss=0.0):
    """A slow z, empty cells, a stuck x, a late row and two gaps; `loss` from the middle on."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, COUNT // 20), 20)
    x = np.zeros((COUNT, 2))
    for k in range(COUNT - 1):
        rate = [u[max(k - 3, 0)] - 0.5 * x[k, 0], 0.2 * x[k, 0] - 0.1 * x[k, 1]]
        x[k + 1] = x[k] + STEP * np.array(rate)
        x[k + 1, 1] += STEP * loss * (k > COUNT // 2)
    first, slow = (x + SIGMA * rng.standard_normal(x.shape)).T
    slow[np.arange(COUNT) % EVERY > 0] = np.nan
    first[[0, 40, 41]] = np.nan
    first[100:110] = first[100]
    u[150] = np.nan
    t = STEP * np.arange(COUNT)
    t[200:] += 0.07
    t[260:] += 20.0
    t[262:] += 20.0
    return Run(f"run{seed}", "a.csv", t, {"u": u, "x": first, "z": slow}, STEP)


@pytest.fixture(scope="module")
def watch():
    return Watch(model(), ("u", "x", "z"), STEP)


@pytest.fixture(scope="module")
def walked(watch):
    rows = prepared(watch.signals, log(1, loss=-0.3))
    return rows, watch.along(watch.init(), rows)


def equal(found, wanted):
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_array_equal(one, other)


def operations(jaxpr):
    """All operations of a program, those of its branches and loops among them: the name and, of one
    that puts values into an array, into how many places."""
    for each in jaxpr.eqns:
        name = each.primitive.name
        yield name, np.prod(each.invars[1].aval.shape[:-1]) if "scatter" in name else 0
        for inner in jax.tree.leaves(each.params, is_leaf=lambda a: hasattr(a, "eqns")):
            if hasattr(inner, "eqns") or hasattr(inner, "jaxpr"):
                yield from operations(getattr(inner, "jaxpr", inner))


@pytest.mark.parametrize("rate", ["0.5*x", "NN(x)"])
def test_a_step_holds_nothing_that_breaks_its_loop_up(rate):
    """XLA makes one kernel of a loop without these, and hundreds of one with them."""
    text = HEATER.replace("0.5*x", rate) + "[networks.NN]\nhidden = 3\n" * (rate == "NN(x)")
    watch = Watch(model(text), ("u", "x", "z"), STEP)
    step = jax.make_jaxpr(watch.step)(watch.init(), 0.0, np.zeros(1), np.zeros(2))
    found = set(operations(step.jaxpr))
    names = {name for name, _ in found}
    assert {"cond", "scan", "reduce_sum"} <= names
    assert not names & {"dot_general", "sort"}
    assert max(places for _, places in found) == 1


def test_the_log_has_what_is_to_be_gone_through(watch, walked):
    status, reason = watch.words(walked[1][1].verdict)
    assert {"HEALTHY", "FAULT", "NOT_JUDGED"} <= set(status)
    still, held = "x stands on one value: stuck or saturated", "too soon after a start or a gap"
    assert {"not sampled", held, still} <= set(reason)


def kept(watch, state):
    """`state` as it comes back from the bytes that it was kept in."""
    file = io.BytesIO()
    eqx.tree_serialise_leaves(file, state)
    file.seek(0)
    return eqx.tree_deserialise_leaves(file, watch.init())


def test_every_row_goes_on_from_kept_bytes_to_the_same_bits(watch, walked):
    run, (last, rows) = walked
    state, said = watch.init(), []
    for at in range(COUNT):
        state, row = watch.along(kept(watch, state), run.cut(slice(at, at + 1)))
        said.append(row)
    equal(state, last)
    equal(jax.tree.map(lambda *a: np.concatenate(a), *said), rows)


@pytest.mark.parametrize("at", [1, 41, 105, 151, 201, 261, 330])
def test_a_walk_goes_on_from_kept_bytes_to_the_same_bits(watch, walked, at):
    """The rest of the log at once, so that the compiled walk takes it in other parts."""
    run, (last, rows) = walked
    state, before = watch.along(watch.init(), run.cut(slice(0, at)))
    state, after = watch.along(kept(watch, state), run.cut(slice(at, None)))
    equal(state, last)
    equal(jax.tree.map(lambda *a: np.concatenate(a), before, after), rows)


def test_the_state_is_arrays_of_fixed_shapes(watch, walked):
    state = watch.init()
    for one, other in zip(jax.tree.leaves(state), jax.tree.leaves(walked[1][0]), strict=True):
        assert isinstance(one, jax.Array)
        assert (one.shape, one.dtype) == (other.shape, other.dtype)


def test_the_step_is_arithmetic_alone(watch):
    """Nothing that calls back, so that it can be printed as a program in another language."""
    row = jnp.asarray(0.0), jnp.zeros(1), jnp.zeros(2)
    names = set(primitives(jax.make_jaxpr(watch.step)(watch.init(), *row).jaxpr))
    assert {"add", "mul", "select_n"} <= names
    assert not {name for name in names if "callback" in name or "infeed" in name}


def primitives(jaxpr):
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for each in jax.tree.leaves(
            tuple(equation.params.values()), is_leaf=lambda a: hasattr(a, "jaxpr")
        ):
            if hasattr(each, "jaxpr"):
                yield from primitives(each.jaxpr)


@pytest.mark.study  # another program to compile
def test_units_beside_each_other_are_judged_as_each_alone(watch):
    """Another program, which may round otherwise: 1e-9 of what is of the order of 1."""
    runs = [log(1, loss=-0.3), log(2)]

    def arrays(run):
        return run.t, run.columns["u"][:, None], np.stack([run.columns["x"], run.columns["z"]], 1)

    @jax.jit
    def walk(t, u, y):
        step = jax.vmap(watch.step)
        state = jax.tree.map(lambda a: jnp.stack([a, a]), watch.init())
        return jax.lax.scan(lambda carried, row: step(carried, *row), state, (t, u, y))[1]

    both = walk(*(np.stack(each, axis=1) for each in zip(*map(arrays, runs), strict=True)))
    for k, run in enumerate(runs):
        _, alone = watch.along(watch.init(), prepared(watch.signals, run))
        np.testing.assert_array_equal(both.verdict.status[:, k], alone.verdict.status)
        for name in ("p", "f", "lo", "hi"):
            found, wanted = (
                np.asarray(getattr(e, name)) for e in (both.posterior, alone.posterior)
            )
            np.testing.assert_allclose(found[:, k], wanted, rtol=1e-6, atol=1e-9)


def test_the_ring_of_a_dead_time_says_what_the_whole_log_says():
    """Against `in_effect`, which has all rows at once; held and straight between samples."""
    run = log(1)
    for hold in ("zero", "linear"):
        signals = model(HEATER.replace('"zero"', f'"{hold}"')).plant.signals
        line = DelayLine.of(signals, STEP)

        class Alone(eqx.Module):
            line: DelayLine

            def step(self, state, t, u):
                return self.line.step(state, t, u, jnp.asarray(STEP), jnp.asarray(False))

        found = follow(Alone(line), line.init(), (run.t, run.columns["u"][:, None]))[1][:, 0]
        wanted = in_effect(signals, run).columns["u"]
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
        assert np.isnan(wanted).sum() > 4


def test_a_slow_column_of_a_file_is_its_samples_alone(watch, walked):
    """What is filled in between samples changes nothing."""
    given, (_, rows) = walked
    run, z = given.run, given.run.columns["z"]
    filled = replace(
        run,
        columns=run.columns | {"z": np.where(np.isfinite(z), z, 77.0)},
        sampled={"z": np.isfinite(z)},
    )
    equal(watch.along(watch.init(), prepared(watch.signals, filled))[1], rows)


def test_a_model_without_calibration_is_refused():
    plain = model().with_calibration(None)
    with pytest.raises(InputError, match="faultgauge calibrate"):
        Watch(plain, ("u", "x", "z"), STEP)
