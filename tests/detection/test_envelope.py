"""Where the bank trusts its model: a cart on a rail, whose place nothing depends on."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.envelope import Applied
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import decide
from faultgauge.detection.posterior.posterior import Marginal
from faultgauge.detection.posterior.verdicts import Heard, Rules
from faultgauge.plants.plant import respond
from faultgauge.telemetry import Run
from models import as_stated

CART = """
name = "cart"
[states.q]
derivative = "v"
[states.v]
derivative = "u - v"
[inputs.u]
min = -9
max = 9
[outputs.q]
value = "q"
[faults.push]
enters = "input"
target = "u"
[faults.weak]
enters = "gain"
target = "u"
"""
STEP, COUNT, SIGMA = 0.1, 600, 1e-3
NOISE = Noise(
    *(np.array(each) for each in (
        [SIGMA], [1e-6, 1e-4], [],
        *([1e-4], [100.0], [1e-3], [5.0]),  # next to no error of the model
        [], [],
    ))
)  # fmt: skip


def model(text=CART):
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(*each, 60) for each in ((0, 1), (-1, 1), (-1, 1))], axis=1)
    return as_stated(text, points, [("q", 0), ("q", 1)], ["q"])


def log(seed, u, push):
    """Exact under the hold: v' = u + push - v."""
    rng = np.random.default_rng(seed)
    q, v, place = np.zeros(COUNT), 0.0, 0.0
    fade = np.exp(-STEP)
    for k in range(COUNT):
        q[k] = place
        force = u[k] + push[k]
        place += force * STEP + (v - force) * (1 - fade)
        v = force + (v - force) * fade
    columns = {"u": u, "q": q + SIGMA * rng.standard_normal(COUNT)}
    return Run(f"run{seed}", "cart.csv", STEP * np.arange(COUNT), columns)


def build(text):
    return build_fault_bank(model(text), [log(0, np.zeros(COUNT), np.zeros(COUNT))], NOISE)


@pytest.fixture(scope="module")
def bank():
    return build(CART)


def swing(level):
    """A square wave; 4 samples a side, so that a bias does not look like a gain for long."""
    return level * np.sign(np.sin(np.pi * (np.arange(COUNT) + 0.5) / 4))


def test_a_fault_that_the_loop_answers_is_named(bank):
    """The loop commands 3 less where 3 is pushed: u is far outside, what is applied is not."""
    push = np.where(np.arange(COUNT) >= COUNT // 2, 3.0, 0.0)
    decision = decide(bank, log(1, swing(0.5) - push, push))
    assert decision.events[-1].fault == "push"
    assert decision.posterior.p[-1, 0] > 0.98
    assert decision.posterior.p[-1, 1] < 0.5  # weak
    assert set(decision.status[COUNT // 2 + 30 :]) == {"FAULT"}


def test_the_place_of_a_cart_may_be_anywhere(bank):
    decision = decide(bank, log(2, 0.5 + swing(0.4), np.zeros(COUNT)))
    assert decision.run.columns["q"][-1] > 10  # ten times the rail of training
    assert set(decision.status[-100:]) == {"HEALTHY"}


def test_known_physics_extrapolates():
    """Six times the commands of training: there is no network to distrust."""
    decision = decide(build(CART), log(3, swing(3.0), np.zeros(COUNT)))
    assert decision.events == []
    assert "NOT_JUDGED" not in decision.status[100:]


@pytest.mark.study
def test_what_the_file_bounds_is_not_trusted_beyond():
    bounded = CART.replace("max = 9", "max = 9\ntrusted = [-1, 1]")
    decision = decide(build(bounded), log(3, swing(3.0), np.zeros(COUNT)))
    assert set(decision.status[20:]) == {"NOT_JUDGED"}
    assert decision.reason[-1] == "u is outside of its trusted range, -1 to 1"


@pytest.mark.parametrize("monitor", ["active", "passive"])
def test_where_the_model_is_not_trusted_no_fault_raises_an_alarm_or_gets_a_name(bank, monitor):
    """One posterior, sure of a push, judged where the model is trusted and where it is not."""
    push = np.where(np.arange(COUNT) >= COUNT // 2, 0.5, 0.0)
    decision = decide(bank, log(4, swing(0.5), push))
    text = CART.replace('target = "u"', f'target = "u"\nmonitor = "{monitor}"')
    text = text.replace("max = 9", "max = 9\ntrusted = [-1, 1]")
    judging = replace(bank, model=model(text))
    active = monitor == "active"
    found = decision.posterior if active else decision.posterior._replace(calm=np.ones(COUNT))
    assert found.p[-1, 0] > 0.99
    rules = Rules.of(judging)
    for outside, told in ((0, True), (1, False)):
        verdict = judged(rules, decision, found, outside)
        assert verdict.alarm.any() == (told and active)
        assert verdict.named.any() == told


def judged(rules, decision, found, outside):
    def step(state, row):
        t, each, u = row
        marginal = Marginal(*(getattr(each, name) for name in Marginal._fields))
        yes, where = jnp.asarray(True), jnp.asarray(outside)
        heard = Heard(yes, each.held, where, each.seen, jnp.asarray(0), u, yes, jnp.zeros(()))
        return rules.step(state, t, marginal, heard)

    rows = (decision.run.t, found, decision.run.columns["u"][:, None])
    return jax.lax.scan(step, rules.init(), rows)[1]


def test_what_is_applied_is_what_the_plant_is_given():
    """Against the plant's own answer: dv/dt = applied - v, faults as means over the sets."""
    plant = model().plant
    p = jnp.array([0.2, 0.5, 0.3])
    f = jnp.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.5]])
    applied = Applied.of(plant.signals)
    found, driven = applied(jnp.array([1.5]), p, f)
    dx, _ = respond(plant, *(jnp.asarray(a) for a in ([0.0, 0.0], [1.5], [2.2, 0.15])))
    assert found[0] == pytest.approx(float(dx[1]))
    assert not driven.any()  # no fault enters a state
    assert applied(jnp.array([50.0]), p, f)[0][0] == 9.0
