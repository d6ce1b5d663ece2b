"""Scaling, free run and one step ahead, against plain loops in NumPy."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from faultgauge_studies.baselines.baseline import Record, Scaling, free_run, one_step
from faultgauge_studies.baselines.elman import SETTLE, elman
from faultgauge_studies.baselines.narx import narx
from faultgauge_studies.baselines.static_network import static_network

# Two codes of the same formulas: 40 samples of contracting networks gather a few roundings each.
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}


def record_of(inputs, seed=0, samples=40):
    rng = np.random.default_rng(seed)
    u = rng.uniform(-3, 5, (samples, inputs)) * np.arange(1, inputs + 1)
    return Record(u, 2 + 0.7 * rng.normal(size=(samples, 1)))


def mapminmax(x):
    """To [-1, 1], as the toolbox's function of this name has it."""
    low, high = x.min(axis=0), x.max(axis=0)
    return 2 * (x - low) / (high - low) - 1


def unscaled(y, record):
    low, high = record.y.min(), record.y.max()
    return (np.array(y) + 1) / 2 * (high - low) + low


def numbers(model):
    return {name: np.asarray(value) for name, value in model.weights.items()}


def test_scaling_is_mapminmax():
    record = record_of(3)
    scaling = Scaling.of(record)
    # three operations on numbers of size 1
    np.testing.assert_allclose(scaling.u(jnp.asarray(record.u)), mapminmax(record.u), atol=1e-14)
    np.testing.assert_allclose(scaling.y(jnp.asarray(record.y)), mapminmax(record.y), atol=1e-14)


def test_scaling_by_hand():
    scaling = Scaling.of(Record(np.array([[0.0], [4.0], [1.0]]), np.array([[-1.0], [0.0], [5.0]])))
    assert np.asarray(scaling.u(jnp.array([[0.0], [4.0], [3.0]])))[:, 0].tolist() == [-1, 1, 0.5]
    assert np.asarray(scaling.y(jnp.array([[2.0], [5.0]])))[:, 0].tolist() == [0, 1]
    assert np.asarray(scaling.back(jnp.array([[-1.0], [0.5]])))[:, 0].tolist() == [-1, 3.5]


def test_scaling_returns_what_it_was_given():
    record = record_of(2)
    scaling = Scaling.of(record)
    y = jnp.asarray(record.y)
    np.testing.assert_allclose(scaling.back(scaling.y(y)), y, rtol=1e-14)  # three roundings


def test_scaling_reads_all_runs():
    runs = [record_of(2, seed) for seed in range(3)]
    together = Scaling.of(Record(np.stack([r.u for r in runs]), np.stack([r.y for r in runs])))
    joined = Scaling.of(
        Record(np.concatenate([r.u for r in runs]), np.concatenate([r.y for r in runs]))
    )
    for name in ("u_center", "u_scale", "y_center", "y_scale"):
        np.testing.assert_array_equal(getattr(together, name), getattr(joined, name))


def test_signal_that_stands_is_only_shifted():
    record = Record(np.full((5, 1), 3.0), np.arange(5.0)[:, None])
    scaled = Scaling.of(record).u(jnp.array([[3.0], [4.0]]))
    assert np.asarray(scaled)[:, 0].tolist() == [0, 1]


def narx_loop(model, record, measured):
    """Before the first sample input and output have stood at their first values."""
    w, u, y = numbers(model), mapminmax(record.u), mapminmax(record.y)[:, 0]
    found = []
    for k in range(len(u)):
        fed = y if measured else found
        past_u = [u[max(k - i, 0)] for i in range(model.input_delays + 1)]
        past_y = [fed[k - i] if k >= i else y[0] for i in range(1, model.output_delays + 1)]
        p = np.concatenate([*past_u, past_y])
        found.append(w["weights_out"] @ np.tanh(w["weights_in"] @ p + w["bias"]) + w["bias_out"])
    return unscaled(found, record)


@pytest.mark.parametrize(("inputs", "delays"), [(1, (1, 2)), (2, (2, 3)), (1, (0, 1))])
@pytest.mark.parametrize("measured", [False, True])
def test_narx_is_a_plain_loop(inputs, delays, measured):
    record = record_of(inputs)
    model = narx(Scaling.of(record), 5, np.random.default_rng(1), *delays)
    found = (one_step if measured else free_run)(model, record)
    assert found.shape == record.y.shape
    np.testing.assert_allclose(found[:, 0], narx_loop(model, record, measured), **ROUNDING)


def output(w, hidden, kind):
    y = w["weights_out"] @ hidden + w["bias_out"]
    return np.tanh(y) if kind == "tansig" else y


@pytest.mark.parametrize("kind", ["tansig", "purelin"])
def test_elman_is_a_plain_loop(kind):
    record = record_of(2)
    model = elman(Scaling.of(record), 4, np.random.default_rng(2), kind)
    w, u, found = numbers(model), mapminmax(record.u), []
    z = np.zeros(4)
    for now in [*[u[0]] * SETTLE, *u]:
        z = np.tanh(w["weights_in"] @ now + w["recurrent"] @ z + w["bias"])
        found.append(output(w, z, kind))
    expected = unscaled(found[SETTLE:], record)
    np.testing.assert_allclose(free_run(model, record)[:, 0], expected, **ROUNDING)
    np.testing.assert_allclose(one_step(model, record)[:, 0], expected, **ROUNDING)


def test_elman_starts_at_rest():
    """Small context weights contract: after 50 steps on one input nothing moves any more."""
    record = record_of(1)
    model = elman(Scaling.of(record), 4, np.random.default_rng(3), "purelin")
    still = Record(np.full((20, 1), 1.5), np.zeros((20, 1)))
    found = np.asarray(free_run(model, still))
    # spectral radius of the context below 0.8 here: 0.8^50 = 1e-5 of a signal of size 1
    assert np.abs(np.linalg.eigvals(model.weights["recurrent"])).max() < 0.8
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), atol=1e-5)


@pytest.mark.parametrize("kind", ["tansig", "purelin"])
def test_static_network_is_a_plain_loop(kind):
    record = record_of(3)
    model = static_network(Scaling.of(record), 6, np.random.default_rng(4), kind)
    w, found = numbers(model), []
    for now in mapminmax(record.u):
        hidden = 1 / (1 + np.exp(-(w["weights_in"] @ now + w["bias"])))
        found.append(output(w, hidden, kind))
    expected = unscaled(found, record)
    np.testing.assert_allclose(free_run(model, record)[:, 0], expected, **ROUNDING)
    np.testing.assert_allclose(one_step(model, record)[:, 0], expected, **ROUNDING)


def test_free_run_reads_the_first_output_alone():
    record = record_of(1)
    model = narx(Scaling.of(record), 5, np.random.default_rng(1))
    other = record.y + 1.0
    other[0] = record.y[0]
    changed = record._replace(y=other)
    np.testing.assert_array_equal(free_run(model, record), free_run(model, changed))
    assert not np.array_equal(one_step(model, record), one_step(model, changed))


def test_one_step_never_reads_the_output_it_predicts():
    record = record_of(1)
    model = narx(Scaling.of(record), 5, np.random.default_rng(1))
    other = record.y.copy()
    other[20] += 1.0
    before, after = one_step(model, record), one_step(model, record._replace(y=other))
    np.testing.assert_array_equal(before[:21], after[:21])
    assert np.all(np.asarray(before[21:23] != after[21:23]))  # the two output delays
    np.testing.assert_array_equal(before[23:], after[23:])


def test_other_signals_than_the_models_are_refused():
    record = record_of(1)
    model = narx(Scaling.of(record), 5, np.random.default_rng(1))
    with pytest.raises(TypeCheckError):
        free_run(model, Record(record.u, np.ones((40, 2))))  # two outputs
    with pytest.raises(TypeCheckError):
        free_run(model, Record(record.u[None], record.y[None]))  # several runs
    with pytest.raises(ValueError, match="30, 40"):
        free_run(model, Record(record.u[:30], record.y))  # lengths differ


def test_generators_decide_the_weights():
    scaling = Scaling.of(record_of(2))
    builds = (
        lambda rng: narx(scaling, 3, rng),
        lambda rng: elman(scaling, 3, rng, "purelin"),
        lambda rng: static_network(scaling, 3, rng, "purelin"),
    )
    for build in builds:
        first, same, other = (build(np.random.default_rng(s)) for s in (5, 5, 6))
        for name, value in first.weights.items():
            np.testing.assert_array_equal(value, same.weights[name])
        assert not np.array_equal(first.weights["weights_in"], other.weights["weights_in"])
