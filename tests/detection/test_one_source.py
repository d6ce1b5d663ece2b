"""Sentences, events, table, report and JSON are views of one posterior: held against each other on
random ones, which no filter had a hand in."""

import json
import re
from dataclasses import replace
from datetime import datetime, timedelta
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultgauge.detection.answer import answers, as_dicts, first_screen, runs_as_dicts, told
from faultgauge.detection.decisions import Decision, table
from faultgauge.detection.events import POSSIBLE, UNKNOWN, Judged, events
from faultgauge.detection.limit_checker import LimitChecker
from faultgauge.detection.posterior import Mixture, Posterior
from faultgauge.detection.probability import probability
from faultgauge.detection.verdicts import Heard, Rules, words
from faultgauge.detection.words import MOST
from faultgauge.observers.branching import BranchInfo
from faultgauge.reporting.decision_chapter import HEADER, _events
from faultgauge.telemetry import Run

from scenes import STEP, moving, tank_bank

ROWS = 160  # sixteen memories of the bank: names need a quarter of one, alarms a sample
CLOCK = datetime(2026, 5, 1, 23, 59, 30)  # midnight comes in the log
T = STEP * np.arange(ROWS)
SETS = 8  # none, three faults, three pairs, something undeclared


@cache
def run_of(clocked):
    """The same with a clock and without: what would not have shown is found once for each."""
    columns = {"u": moving(1)[:ROWS], "x": moving(2)[:ROWS]}
    return Run("a", "tank.csv", T, columns, clock=CLOCK if clocked else None)


@cache
def judging():
    """What the decisions make of what the branches say, row by row; for good where it latches."""
    bank = tank_bank()
    mixture = Mixture.of(bank)

    def rules(latch):
        usual = Rules.of(bank)
        checkers = (usual.alarm, usual.names, usual.signs)
        return replace(
            usual,
            **dict(zip(("alarm", "names", "signs"),
                       (LimitChecker(each.persistence, latch) for each in checkers), strict=True)),
        )  # fmt: skip

    def along(rules, said, heard):
        def step(state, row):
            t, said, heard = row
            found = mixture.marginal(said, heard.seen)
            state, verdict = rules.step(state, t, found, heard)
            return state, (found, verdict)

        return jax.lax.scan(step, rules.init(), (jnp.asarray(T), said, heard))[1]

    compiled = eqx.filter_jit(along)
    return {latch: lambda *a, r=rules(latch): compiled(r, *a) for latch in (False, True)}


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


def posterior(bank, run, parts, ever, latch):
    """(decision, what the events were found in) of stretches on end."""
    sets, faults = len(bank.sets) + 1, len(bank.size)
    which = np.repeat(np.arange(len(parts)), [part[0] for part in parts])[:ROWS]
    which = np.append(which, np.full(ROWS - len(which), which[-1]))
    count, p, size, width, began, sd, silence, seen = (
        np.array([part[k] for part in parts])[which] for k in range(8)
    )
    member = np.zeros((sets, faults))
    for at, each in enumerate(bank.sets):
        member[at, list(each)] = 1.0
    scale = np.asarray(bank.size) * (1 + np.arange(sets))[:, None] / sets
    onset = np.stack([np.tile(T[:, None] - began[:, None], faults), np.tile(sd[:, None], faults)], 2)
    said = BranchInfo(
        p=jnp.asarray(p),
        f=jnp.asarray(member * scale * size[:, None, None]),
        sd=jnp.asarray(member * np.asarray(bank.size) * width[:, None, None]),
        x=jnp.zeros((ROWS, 1)),
        seen=jnp.zeros((ROWS, faults, 2)),
        onset=jnp.asarray(onset),
        ever=jnp.tile(jnp.asarray(ever), (ROWS, 1)),
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
    )
    found, verdict = jax.tree.map(np.asarray, judging()[latch](said, heard))
    whole = Posterior(
        *found,
        *(np.asarray(each) for each in (heard.seen, heard.outside, said.x, said.onset, said.ever)),
        np.asarray(heard.held),
    )
    judged = Judged(run, whole, verdict, np.asarray(said.p).astype(np.float32))
    status, reason = words(bank.model.plant.signals, (), verdict.status, verdict.reason)
    return Decision(run, whole, {}, status, reason, events(bank, judged), run), np.asarray(said.p)


@settings(max_examples=150, deadline=None)
@given(
    parts=st.one_of(
        *[st.lists(stretches(), min_size=1, max_size=7)] * 3,
        st.lists(stretches(calm=True), min_size=1, max_size=3),
    ),
    ever=st.lists(st.sampled_from([0.2, 1.0]), min_size=3, max_size=3),
    clocked=st.booleans(),
    latch=st.booleans(),
)
def test_every_view_says_what_the_posterior_says(parts, ever, clocked, latch):
    bank, run = tank_bank(), run_of(clocked)
    names = bank.model.plant.signals.fault_names
    said, p = posterior(bank, run, parts, ever, latch)
    rows = table([said], names)
    lines = answers(bank, [said])
    told_of = as_dicts(bank, [said])
    of_run = runs_as_dicts(bank, [said], names)["a"]
    check_statuses(said, rows, lines, of_run)
    for event, plain in zip(said.events, told_of, strict=True):
        check_event(bank, event, plain, rows, p)
        assert plain["sentence"] in lines
    check_report(bank, said)
    shown = [*lines, *first_screen(bank, [said]), json.dumps([told_of, of_run], allow_nan=False)]
    assert not any(re.search(r"\b(nan|inf|None)\b", line, re.IGNORECASE) for line in lines)
    assert all(shown)


def check_statuses(said, rows, lines, of_run):
    """What could be judged, in every view; and every row under alarm is told of."""
    status = np.array(rows["status"])
    judged = np.mean(np.isin(status, ["HEALTHY", "FAULT"]))
    assert of_run["judged_share"] == pytest.approx(judged)
    assert judged + sum(each["share"] for each in of_run["silent"]) == pytest.approx(1.0)
    if any(line.startswith("No fault") for line in lines):
        assert "FAULT" not in status
        assert len(lines) == 1
        share = re.match(r"No fault in the (\d+)% of the log that could be judged", lines[0])
        assert f"{judged:.0%}" == (f"{share[1]}%" if share else f"{judged:.0%}")
        assert share or judged >= 0.95
    if any(line.startswith("Nothing could be judged") for line in lines):
        assert judged == 0
    covered = [(each.onset_lo, each.end) for each in said.events]
    covered += [(each["from"], each["to"]) for each in of_run["unnamed"]]
    alone = status == "FAULT"
    for low, high in covered:
        alone &= (low > T) | (high < T)
    edges = np.flatnonzero(np.diff(alone, prepend=False, append=False)).reshape(-1, 2)
    # a memory of the bank (10 s) is the longest that an alarm goes before or on behind its event
    assert all(T[b - 1] - T[a] <= 10.0 for a, b in edges)


def check_event(bank, event, plain, rows, p):
    """One event against the table and the sets."""
    names = bank.model.plant.signals.fault_names
    begin, end = (int(np.flatnonzero(event_t == T)[0]) for event_t in (event.start, event.end))
    assert rows["status"][begin] == rows["status"][end] == "FAULT"
    assert event.onset_lo <= event.onset <= event.onset_hi <= event.start <= event.end
    column = rows["p_unknown" if event.fault == UNKNOWN else f"p_{event.fault}"]
    at = [k for k in range(begin, end + 1) if column[k] == event.p]
    assert at, "its p is that of one of its rows"
    sentence = plain["sentence"]
    assert f"p {probability(event.p)}, run a)" in sentence
    if event.fault != UNKNOWN:
        k = next(
            k for k in at if rows[f"f_{event.fault}"][k] == pytest.approx(event.size * event.p)
        )
        assert rows[f"f_{event.fault}_lo"][k] >= event.lo
        assert rows[f"f_{event.fault}_hi"][k] <= event.hi
        assert event.lo <= event.size <= event.hi
        check_size(event, sentence)
    else:
        k = at[-1]
    check_times(event, plain, rows, begin, end)
    marginal = {
        name: sum(p[k][s] for s, each in enumerate(bank.sets) if n in each)
        for n, name in enumerate(names)
    }
    marginal[UNKNOWN] = p[k][-1]
    beside = dict(event.beside)
    for name, odds in event.instead:
        assert 0 < odds <= MOST
        # 1e-6: the sets are kept in single precision
        assert marginal[name] <= event.p / odds + event.p * beside.get(name, 0.0) + 1e-6
        if f"{name} instead is more than" in sentence:
            assert name not in beside
            assert marginal[name] <= event.p / MOST + 1e-6
    assert all(each > POSSIBLE for each in beside.values())


def check_size(event, sentence):
    """Printed as lo to hi, each to within half of its last figure."""
    number = r"[-+][\d.]+(?:e[-+]\d+)?"
    found = re.search(rf"{event.fault} ({number})[^(]*\(({number}) to ({number})\)", sentence)
    assert found, sentence
    for text, value in zip(found.groups(), (event.size, event.lo, event.hi), strict=True):
        digits, _, power = text.partition("e")
        last = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
        assert abs(float(text) - value) <= last / 2 * (1 + 1e-6)


def check_times(event, plain, rows, begin, end):
    """Told and seen last in the time of the table; the onset never later than told."""
    sentence = plain["sentence"]
    clocked = "time" in rows
    for word, row in (("told at", begin), ("seen until", end)):
        if not clocked:
            assert f"{word} {rows['t'][row]:.12g} s" in sentence
            continue
        stamp = datetime.fromisoformat(rows["time"][row])
        shown = re.search(rf"{word} (?:(\S+) )?(\d+:\d+:[\d.]+)", sentence)
        day = shown[1] or CLOCK.date().isoformat()
        assert datetime.fromisoformat(f"{day}T{shown[2]}") == stamp
    began = re.search(r"since (?:(\S+) )?([\d.:-]+) ?", sentence)
    if event.older != "no":
        assert "already there when the log begins" in sentence
        assert event.onset_lo <= 5.0 + STEP  # no later than what is held off: ten samples
    elif not clocked:
        assert float(began[2]) <= event.start
    else:
        day = began[1] or CLOCK.date().isoformat()
        assert datetime.fromisoformat(f"{day}T{began[2]}") <= CLOCK + timedelta(seconds=event.start)
        assert plain["onset_clock"] is not None


def check_report(bank, said):
    """The report's table has the sentence's size, p and times."""
    sections = _events(bank, [said])
    assert bool(sections) == bool(said.events)
    if not sections:
        return
    (found,) = sections[0].tables
    place = {name: k for k, name in enumerate(found.header)}
    assert set(place) <= set(HEADER)
    for row, event, answer in zip(
        found.rows,
        said.events,
        (next(a for a in told(bank, [said]) if a.start == e.start and a.end == e.end)
         for e in said.events),
        strict=True,
    ):  # fmt: skip
        assert row[place["fault"]] == event.fault
        assert f"told at {row[place['told']]}, seen until {row[place['seen until']]}" in answer.text
        if event.size is not None:
            assert row[place["p"]] == probability(event.p)
