"""Sentences, events, table, report and JSON are views of one posterior: held against each other on
random ones, which no filter had a hand in."""

from dataclasses import replace
from datetime import datetime
from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import Judged, events
from faultgauge.detection.posterior.posterior import Mixture, Posterior
from faultgauge.detection.posterior.verdicts import Heard, Rules, words
from faultgauge.detection.rows.prepared import prepared
from faultgauge.observers.branches import BranchInfo
from faultgauge.telemetry import Run
from faultgauge.telemetry.clock import Clock
from scenes import STEP, moving, tank_bank
from views import compare

ROWS = 160  # sixteen memories of the bank: names need a quarter of one, alarms a sample
CLOCK = Clock(datetime(2026, 5, 1, 23, 59, 30))  # midnight comes in the log
T = STEP * np.arange(ROWS)
SETS = 8  # none, three faults, three pairs, something undeclared


@cache
def run_of(clocked):
    """The same with a clock and without: what would not have shown is found once for each."""
    columns = {"u": moving(1)[:ROWS], "x": moving(2)[:ROWS]}
    return Run("a", "tank.csv", T, columns, clock=CLOCK if clocked else None)


def quick_bank():
    """What is undeclared is told at once, as the model's own error lasts for a moment."""
    bank = tank_bank()
    return replace(bank, noise=bank.noise._replace(lasting=np.array([STEP])))


@cache
def judging():
    """What the decisions make of what the branches say, row by row; for good where it latches."""
    bank = quick_bank()
    mixture = Mixture.of(bank)

    def rules(latch):
        usual = Rules.of(bank)
        checkers = (usual.alarm, usual.names, usual.signs)
        return replace(
            usual,
            **dict(zip(("alarm", "names", "signs"),
                       (replace(each, latch=latch) for each in checkers), strict=True)),
        )  # fmt: skip

    def along(rules, said, heard):
        def step(state, row):
            t, said, heard = row
            found = mixture.marginal(said, heard.seen)
            state, verdict = rules.step(state, t, found, heard)
            return state, (found, verdict)

        return jax.lax.scan(step, rules.init(), (jnp.asarray(T), said, heard))[1]

    compiled = eqx.filter_jit(along)
    return {latch: partial(compiled, rules(latch)) for latch in (False, True)}


@st.composite
def stretches(draw, *, calm=False, sets=SETS):
    """Rows that are alike: (how many, weights of the sets, sizes, widths, onset ago and its width,
    what was sampled, held back, not trusted, standing)."""
    leading = 0 if calm else draw(st.integers(0, sets - 1))
    sure = draw(st.sampled_from([0.985, 1 - 1e-9] + [0.3, 0.9, 0.9995] * (not calm)))
    rest = np.array(draw(st.lists(st.floats(1e-9, 1.0), min_size=sets, max_size=sets)))
    rest[leading] = 0.0
    p = (1 - sure) * rest / rest.sum()
    p[leading] = sure
    size = draw(st.sampled_from([-0.3, -0.05, 0.0, 0.02, 0.3]))
    width = draw(st.sampled_from([1e-9, 1e-3, 0.04, 1.0]))
    silence = draw(st.sampled_from(["", "", "", "", "", "gap", "held", "outside", "standing"]))
    began = draw(st.floats(-30.0, ROWS * STEP))  # s, may be before the log and after now
    return (
        *(draw(st.integers(1, 60)), p, size, width, began),
        *(draw(st.sampled_from([0.0, 0.3, 5.0, 80.0])), silence, draw(st.booleans())),
    )


@st.composite
def interrupted(draw):
    """A fault that stays through something else, and behind that may change, or may be gone."""
    rows, *one = draw(stretches(calm=True))
    fault = draw(st.integers(1, 3))
    p = np.full(SETS, 1e-9)
    p[fault] = 1 - 1e-9 * (SETS - 1)
    size = draw(st.sampled_from([-0.3, 0.3]))
    there = (p, size, 1e-3, draw(st.floats(-5.0, 15.0)), 0.3, "", True)
    calm = draw(st.sampled_from([p, one[0]]))  # as sure of the fault, or of none
    open_ = (calm, 0.0, 1.0, there[3], 0.3, "", True)
    later = (p, size, 1e-3, draw(st.floats(0.0, 70.0)), 0.3, "", True)
    if draw(st.booleans()):
        p = np.full(SETS, 0.01)  # which of them, or none: nobody knows
        p[[0, fault]] = draw(st.permutations([0.4, 0.54]))
        later = (p, *later[1:])
    counts = draw(st.lists(st.integers(15, 40), min_size=4, max_size=4))
    after = zip(counts, (there, open_, there, later), strict=True)
    return [(min(rows, 20), *one), *((count, *each) for count, each in after)]


def posterior(bank, run, parts, ever, latch):
    """What is decided of stretches on end."""
    sets, faults = len(bank.sets) + 1, len(bank.size)
    which = np.repeat(np.arange(len(parts)), [part[0] for part in parts])[:ROWS]
    which = np.append(which, np.full(ROWS - len(which), which[-1]))
    p, size, width, began, sd, silence, seen = (
        np.array([part[k] for part in parts])[which] for k in range(1, 8)
    )
    member = np.zeros((sets, faults))
    for at, each in enumerate(bank.sets):
        member[at, list(each)] = 1.0
    scale = np.asarray(bank.size) * (1 + np.arange(sets))[:, None] / sets
    onset = np.stack(
        [np.tile(T[:, None] - began[:, None], faults), np.tile(sd[:, None], faults)], 2
    )
    said = BranchInfo(
        p=jnp.asarray(p),
        f=jnp.asarray(member * scale * size[:, None, None]),
        sd=jnp.asarray(member * np.asarray(bank.size) * width[:, None, None]),
        x=jnp.zeros((ROWS, 1)),
        seen=jnp.zeros((ROWS, faults, 2)),
        onset=jnp.asarray(onset),
        ever=jnp.tile(jnp.asarray(ever), (ROWS, 1)),
        most=jnp.zeros((ROWS, faults)),
        sudden=jnp.zeros((ROWS, sets, faults)),
        sharp=jnp.zeros((ROWS, sets, faults)),
        told=jnp.zeros((ROWS, sets, faults)),
        quick=jnp.zeros((ROWS, faults)),
        alien=jnp.zeros((ROWS, 4)),
        nis=jnp.zeros((ROWS, 3)),
        faulty=jnp.zeros(ROWS),
    )
    sampled = silence != "gap"
    nan = jnp.where(jnp.asarray(sampled), 0.0, jnp.nan)
    said = jax.tree.map(lambda a: a + nan.reshape(-1, *[1] * (a.ndim - 1)), said)
    heard = Heard(
        sampled=jnp.asarray(sampled),
        held=jnp.asarray(silence == "held"),
        outside=jnp.asarray((silence == "outside") | ~sampled, int),
        seen=jnp.tile(jnp.asarray(seen)[:, None, None], (1, faults, 2)),
        standing=jnp.asarray(silence == "standing", int),
        u=jnp.ones((ROWS, 1)),
        output=jnp.asarray(silence != "standing") & sampled,
        undeclared=said.p[:, -1],
    )
    found, verdict = jax.tree.map(np.asarray, judging()[latch](said, heard))
    whole = Posterior(
        *found,
        *(np.asarray(each) for each in (heard.seen, heard.outside, said.x, said.onset, said.ever)),
        np.asarray(heard.held),
    )
    sets = np.asarray(said.p).astype(np.float32)
    judged = Judged(run, whole, verdict, sets, sets, np.zeros((ROWS, 1), np.float32))
    status, reason = words(bank.model.plant.signals, (), verdict.status, verdict.reason)
    rows = prepared(bank.model.plant.signals, run)
    return Decision(run, whole, {}, status, reason, events(bank, judged), rows, rows)


DRAWN = given(
    parts=st.one_of(
        *[st.lists(stretches(), min_size=1, max_size=7)] * 3,
        st.lists(stretches(calm=True), min_size=1, max_size=3),
        interrupted(),
    ),
    ever=st.lists(st.sampled_from([0.2, 1.0]), min_size=3, max_size=3),
    clocked=st.booleans(),
    latch=st.booleans(),
)


def alike(parts, ever, clocked, latch):
    bank, run = tank_bank(), run_of(clocked)
    said = posterior(bank, run, parts, ever, latch)
    compare(bank, said)


@settings(max_examples=60, deadline=None)
@DRAWN
def test_every_view_says_what_the_posterior_says(parts, ever, clocked, latch):
    alike(parts, ever, clocked, latch)


@pytest.mark.study  # sixty of them, above
@settings(max_examples=400, deadline=None)
@DRAWN
def test_every_view_of_many_says_what_the_posterior_says(parts, ever, clocked, latch):
    alike(parts, ever, clocked, latch)


@pytest.mark.parametrize(("size", "events"), [(0.3, 1), (0.4, 2)])
def test_a_fault_whose_sign_was_open_for_a_while_is_one_event_until_it_jumps(size, events):
    """A leak since 10 s, of which nothing is known from 30 to 40 s, and of which the last rows date
    a change at 60 s: those before it date the fault. Where it has another size there, another
    event begins."""
    bank = tank_bank()
    none, leak = (np.where(np.arange(SETS) == k, 1 - 1e-6, 1e-6 / (SETS - 1)) for k in (0, 1))
    known = (1e-3, 10.0, 0.3, "", True)
    parts = [
        (20, none, 0.0, *known),
        (40, leak, 0.3, *known),
        (20, leak, 0.0, 1.0, *known[1:]),
        (40, leak, 0.3, *known),
        (40, leak, size, 1e-3, 60.0, 0.3, "", True),
    ]
    said = posterior(bank, run_of(False), parts, [1.0] * 3, False)
    assert [each.fault for each in said.events] == ["leak"] * events
    assert said.events[0].onset == pytest.approx(10.0)
    assert said.events[-1].end == T[-1]
    if events == 2:
        first, second = said.events
        assert second.size == pytest.approx(size / 0.3 * first.size)
        assert first.end == T[119]
        assert first.end <= second.onset <= second.onset_hi == T[120]
    compare(bank, said)


def test_a_fault_that_went_did_not_change_its_sign_before():
    """A leak from 10 to 30 s, none until 50 s, and then one of the other sign, which the posterior
    dates to 25 s: the first one was there until its last row, and the other began after it."""
    bank = tank_bank()
    none, leak = (np.where(np.arange(SETS) == k, 1 - 1e-6, 1e-6 / (SETS - 1)) for k in (0, 1))
    known = (1e-3, 10.0, 0.3, "", True)
    parts = [
        (20, none, 0.0, *known),
        (40, leak, 0.3, *known),
        (40, none, 0.0, *known),
        (60, leak, -0.2, 1e-3, 25.0, 0.3, "", True),
    ]
    said = posterior(bank, run_of(False), parts, [1.0] * 3, False)
    first, second = said.events
    assert first.end == T[59]
    assert first.size > 0
    assert second.size == pytest.approx(-0.2 / 0.3 * first.size)
    assert second.onset_lo >= first.end
    compare(bank, said)


def test_what_is_undeclared_lasts_as_long_as_the_alarm_that_nothing_else_explains():
    """Sure from 10 s to 18 s, and again from 38 s to 43 s; in between and from there on some fault
    is there, and nobody knows which. No alarm is told beside it."""
    bank = quick_bank()
    none, other = (
        np.where(np.arange(SETS) == k, 1 - 1e-6, 1e-6 / (SETS - 1)) for k in (0, SETS - 1)
    )
    some = np.where(np.arange(SETS) == 0, 1e-9, 1 / (SETS - 1))
    known = (0.3, 1e-3, 10.0, 0.3, "", True)
    parts = [(20, none, *known), (16, other, *known), (40, some, *known)]
    parts += [(10, other, *known), (40, some, *known)]
    said = posterior(bank, run_of(False), parts, [1.0] * 3, False)
    (event,) = said.events
    assert (event.fault, event.end) == ("unknown", T[-1])
    assert event.start == pytest.approx(10.0, abs=5.0)
    compare(bank, said)
