"""What follows a change of an input that no healthy log has: what the model lacks looks like a
fault that acts on the plant until that has settled."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.detection.bank.fidelity import largest_changes
from faultgauge.detection.posterior.inexact import acting
from faultgauge.detection.posterior.posterior import Marginal
from faultgauge.detection.posterior.verdicts import Heard, Rules
from faultgauge.telemetry import Run
from scenes import STEP, tank_bank

SHARE, SETTLING, GAIN = 0.5, 4.0, 0.1
SETTLED = SETTLING * np.log(SHARE / GAIN)  # s: when 0.5 exp(-t / 4 s) is 0.1
CHANGE = 0.3
ROWS, JUMP = int(3 * SETTLED / STEP), 14


def bank():
    usual = tank_bank()
    # what is undeclared waits as short as it may, as the model's own error lasts for no time
    times = {"settling": np.array([SETTLING]), "lasting": np.array([STEP])}
    noise = usual.noise._replace(share=np.array([SHARE]), **times)
    return replace(usual, noise=noise, gain=GAIN, changes=np.array([CHANGE]))


def named(size, since=JUMP, held=(), f=1.0, biased=()):
    """Which causes have a name at each row, where the posterior is sure of all, as large as `f`
    +- 10 %, from row `since` on and the input changes by `size` at row JUMP; `held` are rows right
    behind a gap, faults that are `biased` are biases of the input."""
    rules, n = Rules.of(bank()), len(bank().model.plant.signals.faults)
    rules = replace(rules, watched=tuple(0 if k in biased else 1 for k in range(n)))
    t = STEP * jnp.arange(ROWS)
    u = jnp.where(jnp.arange(ROWS) < JUMP, 1.0, 1.0 + size)[:, None]

    def step(state, row):
        t, u, sure, held = row
        p, one = jnp.where(sure, 0.999, 0.0), jnp.ones(n)
        none = jnp.where(sure, 1e-9, 1.0)
        ends = f - 0.1 * abs(f) * one, f + 0.1 * abs(f) * one
        found = Marginal(p * one, f * one, *ends, none, p, none, 0.1 * one)
        yes, no = jnp.asarray(True), jnp.asarray(0)
        heard = Heard(yes, held, no, jnp.ones((n, 2), bool), no, u, yes, p)
        state, verdict = rules.step(state, t, found, heard)
        return state, verdict.named

    rows = t, u, jnp.arange(ROWS) >= since, jnp.isin(jnp.arange(ROWS), jnp.array(held, int))
    return np.asarray(jax.lax.scan(step, rules.init(), rows)[1])


def first(found):
    """When [s] each cause gets its name."""
    assert found[-1].all()
    return STEP * np.argmax(found, axis=0)


def test_how_long_what_the_change_of_an_input_does_besides_is_more_than_sizes_are_off():
    assert bank().settled == pytest.approx(SETTLED)
    assert replace(bank(), gain=SHARE).settled == 0.0
    assert replace(bank(), gain=0.0).settled == 0.0  # nobody knows by how much they are


def test_what_acts_on_the_plant_has_no_name_until_a_strange_change_has_settled():
    acts = np.append(acting(bank().model.plant.signals.faults) > 0, True)  # the undeclared, too
    assert acts.any()
    assert not acts.all()
    usual, strange = first(named(0.9 * CHANGE)), first(named(1.1 * CHANGE))
    assert strange[~acts] == pytest.approx(usual[~acts])
    waits = usual - JUMP * STEP - bank().outlasts  # the alarm begins meanwhile
    ends = JUMP * STEP + SETTLED
    assert np.all(strange[acts] >= ends + waits[acts] - STEP)
    assert np.all(strange[acts] <= ends + waits[acts] + 2 * STEP)


@pytest.mark.parametrize(("f", "waits"), [(-0.6, False), (-0.31, False), (-0.2, True), (0.6, True)])
def test_a_fault_of_the_input_itself_that_is_its_change_has_its_name_at_once(f, waits):
    """The input changes by 0.6, and changes by 0.3 are usual: a fault of -0.3 or more leaves no
    more than that to the plant."""
    acts = np.flatnonzero(np.append(acting(bank().model.plant.signals.faults) > 0, True))
    k = acts[0]
    usual, strange = (first(named(size, f=f, biased=(k,))) for size in (0.0, 2 * CHANGE))
    assert (strange[k] > usual[k] + SETTLED / 2) == waits
    assert np.all(strange[acts[1:]] > usual[acts[1:]] + SETTLED / 2)


def test_what_an_input_did_in_a_gap_is_no_strange_change():
    held = range(JUMP, JUMP + 3)
    assert first(named(2 * CHANGE, held=held)) == pytest.approx(first(named(0.0, held=held)))


def test_a_name_that_is_there_before_the_change_stays():
    found = named(2 * CHANGE, since=0)
    assert found[JUMP - 1].all()
    assert found[JUMP:].all()


def test_the_largest_changes_of_healthy_logs_leave_out_what_was_not_sampled():
    model = bank().model
    (name,) = model.plant.signals.input_names
    runs = [
        Run("a", "a.csv", np.arange(4.0), {name: np.array([0.0, np.nan, 2.0, 1.5])}),
        Run("b", "b.csv", np.arange(2.0), {name: np.array([9.0, 9.5])}),
    ]
    assert largest_changes(model, runs) == {name: 2.0}
