"""The answer as a sentence, and the evidence that gives it again."""

import csv
from dataclasses import replace
from datetime import datetime, timedelta

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.cli.evidence import write_evidence
from faultgauge.detection.answer.evidence import MOST_SHOWN, Evidence, evidence, same
from faultgauge.detection.answer.least import least_told
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import Watching, decide
from faultgauge.detection.posterior.posterior import Marginal
from faultgauge.detection.posterior.verdicts import FAULT, STATUS, Heard, Rules, words
from faultgauge.detection.rows.intake import Intake
from faultgauge.reporting.decision_chapter import decision_report
from faultgauge.reporting.report import render
from faultgauge.reporting.run_overview import run_overview
from faultgauge.reporting.words import silence, telling
from faultgauge.reporting.words.answer import (
    answers,
    as_dicts,
    first_screen,
    runs_as_dicts,
    shown_first,
)
from faultgauge.reporting.words.event_sentence import _in_its_place, finding
from faultgauge.reporting.words.glitches import sentences
from faultgauge.telemetry import Run, read_telemetry
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.runs import cut
from faultgauge.telemetry.writing import as_table, write_table
from models import as_stated

TANK = """
name = "tank"
[states.x]
unit = "m"
derivative = "u - 0.2*x"
[inputs.u]
min = 0
max = 2
[outputs.x]
value = "x"
[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
[faults.gauge]
enters = "output"
target = "x"
unit = "m"
"""
STEP, COUNT, SIGMA, PROCESS = 0.5, 1200, 0.02, 1e-3
ONSET, LEAK = 300.0, -0.1
NOISE = Noise(
    *(np.array(each) for each in (
        [SIGMA], [PROCESS], [],
        *([1e-4], [100.0], [1e-3], [5.0]),  # next to no error of the model
        [], [],
    ))
)  # fmt: skip


LATE = STEP * np.arange(COUNT) >= ONSET


def log(seed, leak=0.0, acts=LATE):
    """Exact under the hold."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.5, 1.5, COUNT // 20), 20)
    t = STEP * np.arange(COUNT)
    fade = np.exp(-0.2 * STEP)
    x = np.full(COUNT, u[0] / 0.2)
    for k in range(COUNT - 1):
        driven = u[k] + leak * acts[k]
        x[k + 1] = fade * x[k] + (1 - fade) / 0.2 * driven
    y = x + SIGMA * rng.standard_normal(COUNT)
    return Run(f"run{seed}", "tank.csv", t, {"u": u, "x": y})


@pytest.fixture(scope="module")
def bank():
    return built(TANK)


RNG = np.random.default_rng(0)
POINTS = np.stack([RNG.uniform(0, 12, 60), RNG.uniform(0, 2, 60)], axis=1)


def built(text):
    return build_fault_bank(as_stated(text, POINTS), [log(0)], NOISE)


@pytest.fixture(scope="module")
def decision(bank):
    return decide(bank, log(1, LEAK))


def test_what_is_over_is_told_as_over(bank, decision):
    """A leak of 300 to 400 s, and one that is there as the log ends."""
    t = STEP * np.arange(COUNT)
    over = decide(bank, log(1, LEAK, (t >= ONSET) & (t < 400)))
    (event,) = over.events
    (line,) = answers(bank, [over])
    assert f" until {event.end:g} s (p > 0.999, run run1); told at" in line
    assert event.end == pytest.approx(400, abs=10)
    (line,) = answers(bank, [decision])
    assert "until" not in line.split("; ")[0]


def test_a_fault_whose_sign_turns_again_and_again_is_one_finding(bank, decision):
    """A leak of half a minute, and as much that comes in, six times: the events stay as they are,
    and one sentence tells of all. Three windows of a fault are three faults."""
    (event,) = decision.events
    sizes = [(-1) ** k * (0.1 + 0.01 * k) for k in range(6)]
    turning = [
        replace(event, start=150.0 + 60 * k, onset=150.0 + 60 * k, end=180.0 + 60 * k, size=size,
                lo=size - 0.01, hi=size + 0.01)
        for k, size in enumerate(sizes)
    ]  # fmt: skip
    found = replace(decision, events=turning)
    (line,) = (line for line in answers(bank, [found]) if line.startswith("leak "))
    assert line.startswith("leak came and went 6 times from 150 s to 480 s")
    assert "between -0.15 and +0.14 m/s" in line
    assert "something undeclared may shake what leak would move" in line
    assert len(as_dicts(bank, [found])) == 6
    t = STEP * np.arange(COUNT)
    thrice = np.where(t < ONSET, 0.0, np.where((t // 50) % 2 == 0, 1.0, 0.0))
    apart = decide(bank, log(1, 3 * LEAK, thrice))
    assert not any("came and went" in line for line in answers(bank, [apart]))


def test_a_rival_is_told_by_the_models_own_error_and_not_as_excluded(bank, decision):
    (event,) = decision.events
    assert event.rivals == ()  # nobody fitted this model, so that its answers are exact
    plain = dict(event.instead)
    assert plain["gauge"] > 20
    doubtful = replace(bank, shape=0.4)
    rivalled = replace(decision, events=[replace(event, rivals=(("gauge", 1.72),))])
    line = answers(doubtful, [rivalled])[0]
    off = "with an answer as far off as in healthy logs (40 %)"
    assert f"; {off}, gauge is 1.7 times less likely" in line
    assert line.count("gauge is") == 1
    assert line.split("; ")[0].endswith("run run1), or gauge by the model's own error")
    assert as_dicts(doubtful, [rivalled])[0]["rivals"] == {"gauge": 1.72}


def test_beside_what_is_told_stands_what_would_not_have_shown(bank, decision, monkeypatch):
    """Of a fault that no size of shows here nothing is said by another one's event; of one run of
    two that speak, where the other would show it, neither."""
    least = {"run1": (0.001, None), "other": (0.001, 0.3)}

    def told(_, one, k):
        return least[one.run.name][k]

    for where in ("telling", "silence", "event_sentence"):
        monkeypatch.setattr(f"faultgauge.reporting.words.{where}.least_told", told)
    *_, last = answers(bank, [decision])
    assert last == "gauge of any size to be expected would not have shown in this log"
    assert first_screen(bank, [decision])[-1] == last
    other = replace(decision, run=replace(decision.run, name="other"))
    assert not any("gauge of any size" in line for line in answers(bank, [decision, other]))


@pytest.mark.parametrize(
    ("p", "said"),
    [
        ((0.96, 0.01), "not certain for long enough to be named: leak"),
        ((0.01, 0.96), "not certain for long enough to be named: gauge"),
        ((0.6, 0.4), "cause undecided: leak or gauge"),
    ],
)
def test_what_no_cause_rivals_is_not_undecided(bank, p, said):
    one = np.zeros(2)
    found = Marginal(np.array(p), one, one, one, *map(np.asarray, (0.0, 1e-9, 0.0)), one)
    reason = np.asarray(Rules.of(bank)._cause(found, jnp.zeros(3, bool)))
    status = np.array([STATUS.index(FAULT)])
    assert words(bank.model.plant.signals, (), status, reason[None])[1] == [said]


def test_a_name_asks_for_0_98_of_what_is_there_once_an_alarm_has_told_that_something_is(bank):
    """Of 0.96 that there is any fault 0.95 is 0.99, and is named, with a sign that is known; of
    0.9 it is not, nor 0.95 of 1."""
    rules = Rules.of(bank)
    one, step = jnp.array([0.1, 0.1]), eqx.filter_jit(rules.step)
    yes, none = jnp.asarray(True), jnp.asarray(0)
    heard = Heard(yes, ~yes, none, jnp.ones((2, 2), bool), none, jnp.zeros(1), yes, jnp.zeros(()))
    named = []
    for p, calm in (((0.95, 0.005), 0.04), ((0.9, 0.005), 0.04), ((0.95, 0.04), 0.001)):
        found = Marginal(jnp.array(p), one, one, one, *map(jnp.asarray, (calm, 1e-9, calm)), one)
        state = rules.init()
        for k in range(400):
            state, verdict = step(state, jnp.asarray(STEP * k), found, heard)
        named.append(bool(verdict.named[0]))
    assert named == [True, False, False]


def test_the_sentence_says_what_since_when_and_what_it_is_not(bank, decision):
    (line,) = answers(bank, [decision])
    assert line.startswith("leak -0.")
    assert "m/s (-0." in line
    assert ") since 299.5 s +- 1.1 s (p > 0.999, run run1); told at 309.5 s, " in line
    assert "; gauge is more than 1000 times less likely;" in line
    assert "; leak below " in line
    assert line.endswith("m/s would not have shown")
    (found,) = as_dicts(bank, [decision])
    assert found["sentence"] == line
    assert found["onset_clock"] is None
    assert found["instead"] == {"gauge": 1000.0, "unknown": 1000.0}
    assert found["lo"] < LEAK < found["hi"]


def test_a_log_with_a_clock_is_answered_in_its_time(bank, decision):
    timed = replace(decision.run, clock=Clock(datetime(2026, 5, 1, 8, 41, 10)))
    (line,) = answers(bank, [replace(decision, run=timed)])
    assert "since 08:46:" in line  # 300 s after 08:41:10, found to within seconds
    (found,) = as_dicts(bank, [replace(decision, run=timed)])
    assert found["onset_clock"].startswith("2026-05-01T08:46:")


def test_timestamps_of_a_file_set_the_clock(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,u\n2026-05-01T23:59:59,1\n2026-05-02T00:00:00,2\n2026-05-02T00:00:01,1\n")
    (run,) = read_telemetry(path)
    assert run.clock == Clock(datetime(2026, 5, 1, 23, 59, 59))
    assert run.t.tolist() == [0.0, 1.0, 2.0]


def test_silence_says_below_what_it_means_nothing(bank):
    (line,) = answers(bank, [decide(bank, log(2))])
    assert line.startswith("No fault; leak below ")
    assert "gauge" in line


def test_of_several_logs_the_least_telling_says_what_would_not_have_shown(bank, monkeypatch):
    quiet = decide(bank, log(2))
    other = replace(quiet, run=replace(quiet.run, name="other"))
    least = {quiet.run.name: (0.02, 0.3), "other": (0.05, None)}
    monkeypatch.setattr(
        "faultgauge.reporting.words.telling.least_told", lambda _, one, k: least[one.run.name][k]
    )
    (line,) = answers(bank, [quiet, other])
    assert line == (
        "No fault; leak below 0.05 m/s would not have shown, nor would gauge of any "
        "size to be expected"
    )


def test_an_alarm_without_a_name_is_no_silence(bank, decision):
    """From 100 s to 110 s, interrupted for a second, and once for a sample within an event. For
    half of the time gauge has p 0.6, then 0.2; it is -0.3 if it is there, and a leak is 0.05."""
    status, reason = [*decision.status], [*decision.reason]
    p, f = decision.posterior.p.copy(), decision.posterior.f.copy()
    rows = [*range(200, 210), *range(212, 222), 700]
    for n, k in enumerate(rows):
        status[k], reason[k] = "FAULT", "cause undecided: leak or gauge"
        p[k] = (0.4, 0.6) if n < 10 else (0.8, 0.2)
        f[k] = p[k] * (0.05, -0.3)
    posterior = decision.posterior._replace(p=p, f=f)
    unsure = replace(decision, status=status, reason=reason, posterior=posterior)
    (first, second) = answers(bank, [unsure])
    assert first == (
        "An alarm from 100 s to 110.5 s (run run1); cause undecided: leak of +0.05 m/s (p 0.6) or "
        "gauge of -0.3 m (p 0.4)"
    )
    assert second == answers(bank, [decision])[0]
    # what no cause rivals in all of it is not undecided, whatever its rows say
    p[rows] = (0.97, 0.01)
    alone = replace(unsure, posterior=decision.posterior._replace(p=p, f=0.05 * p))
    assert answers(bank, [alone])[0] == (
        "An alarm from 100 s to 110.5 s (run run1); not certain for long enough to be named: leak "
        "of +0.05 m/s (p 0.97)"
    )
    p[rows[:10]], p[rows[10:]] = (0.4, 0.6), (0.8, 0.2)
    unnamed = replace(unsure, events=[])
    nameless = answers(bank, [unnamed])
    assert nameless[0] == first
    assert not any("No fault" in line for line in nameless)
    found = runs_as_dicts(bank, [unnamed], ["leak", "gauge"])["run1"]["unnamed"]
    assert found[0] == {"from": 100.0, "to": 110.5, "sentence": first}
    drawn = run_overview(bank, unnamed).svg
    assert "leak (m/s)" in drawn
    assert "gauge (m)" in drawn


def test_an_alarm_that_was_over_before_a_named_one_began_is_told_whole(bank, decision):
    """From 80 s to 115 s, where the event is dated to 110 s by its interval, and told later; an
    alarm that the event began in is told until that date."""
    (event,) = decision.events
    dated = replace(event, onset_lo=110.0)
    for last, until in ((230, "114.5"), (int(2 * event.start) + 1, "109.5")):
        status, reason = [*decision.status], [*decision.reason]
        for k in range(160, last):
            status[k], reason[k] = "FAULT", "no declared fault explains it"
        for k in range(last, int(2 * event.start)):
            status[k] = "HEALTHY"
        unsure = replace(decision, status=status, reason=reason, events=[dated])
        assert answers(bank, [unsure])[0] == (
            f"An alarm from 80 s to {until} s (run run1); no declared fault explains it"
        )


def test_many_alarms_that_nothing_explains_are_one_sentence(bank, decision):
    """From 100 s on, five rows (2 s) every 50 s; another one is not sure for long enough."""

    def told(count):
        status, reason = ([each] * len(decision.status) for each in ("HEALTHY", ""))
        for first in range(200, 200 + 100 * count, 100):
            status[first : first + 5] = ["FAULT"] * 5
            reason[first : first + 5] = ["no declared fault explains it"] * 5
        status[50], reason[50] = "FAULT", "not certain for long enough to be named: "
        return answers(bank, [replace(decision, status=status, reason=reason, events=[])])

    assert [each.partition(" ")[0] for each in told(3)] == ["An"] * 4
    other, many = told(4)
    assert "not certain for long enough" in other
    assert many == (
        "4 alarms from 100 s to 252 s (run run1), 8 s in all; no declared fault explains them"
    )


def test_one_more_fault_than_is_told_is_told_without_a_name(bank, decision):
    """Beside the leak, from 350 s on for 200 s, with p 0.99 in all."""
    part = slice(700, 1100)
    status, p, f = [*decision.status], decision.posterior.p.copy(), decision.posterior.f.copy()
    unknown = decision.posterior.unknown.copy()
    assert status[part] == ["FAULT"] * 400
    p[part, 1], f[part, 1], unknown[part] = 0.6, 0.6 * 0.2, 0.39
    seen = decision.posterior._replace(p=p, f=f, unknown=unknown)
    leak, more = answers(bank, [replace(decision, posterior=seen)])
    assert leak.startswith("leak ")
    assert more == (
        "One more fault than leak from 350 s to 549.5 s (run run1), not sure which: gauge of "
        "+0.2 m (p 0.6) or something undeclared (p 0.39)"
    )
    found = runs_as_dicts(bank, [replace(decision, posterior=seen)], ["leak", "gauge"])["run1"]
    assert found["unnamed"] == [{"from": 350.0, "to": 549.5, "sentence": more}]
    # not as sure as a name is, or not for as long as a name may take
    unknown[part] = 0.37
    assert len(answers(bank, [replace(decision, posterior=seen)])) == 1
    unknown[part] = 0.39
    p[710:1100, 1] = 0.0
    assert len(answers(bank, [replace(decision, posterior=seen)])) == 1


def test_a_fault_that_another_took_the_place_of_may_have_gone_on(decision):
    (event,) = decision.events
    over = replace(event, end=400.0)
    other = replace(event, fault="gauge", onset_lo=399.0, onset=400.0, onset_hi=401.0, start=403.0)
    both = replace(decision, events=[over, other])
    one = built(TANK + "[detection]\nmax_simultaneous = 1\n")
    assert (
        "seen until 400 s, where gauge came: no more than one fault is told at once, as "
        "max_simultaneous has it, so leak may have gone on" in answers(one, [both])[0]
    )
    two = built(TANK + "[detection]\nmax_simultaneous = 2\n")
    assert "may have gone on" not in answers(two, [both])[0]
    crowded = replace(decision, events=[over, other, replace(other, fault="pump")])
    assert _in_its_place(two, crowded, over) == "gauge"
    late = replace(other, onset_lo=500.0, onset=501.0, onset_hi=502.0, start=503.0)
    assert "may have gone on" not in answers(one, [replace(decision, events=[over, late])])[0]


def test_a_log_that_ends_undecided_says_so_and_one_without_a_fault_is_named(bank, decision):
    """From 575 s on the leak has p 0.8, without an alarm, and is as large as 0.016 / 0.8."""
    quiet = decide(bank, log(2))
    found, last = quiet.posterior, STEP * np.arange(COUNT) >= 575
    healthy, p = np.where(last, 0.2, 1.0), np.where(last[:, None], [0.8, 0.0], 0.0)
    status = ["NOT_JUDGED" if each else "HEALTHY" for each in last]
    seen = found._replace(healthy=healthy, p=p, f=0.02 * p)
    open_ = replace(quiet, posterior=seen, status=status)
    (line,) = answers(bank, [open_])
    assert line == (
        "Undecided from 575 s to the end of the log (run run2); the likeliest cause is leak, "
        "+0.02 m/s if it is there (p 0.8); that nothing is wrong has p 0.2"
    )
    told, silent = answers(bank, [decision, quiet])
    assert told == answers(bank, [decision])[0]
    assert silent.startswith("No fault in run run2; leak below ")


def test_a_fault_that_is_told_beside_another_is_no_other_explanation_of_it(bank, decision):
    (event,) = decision.events
    other = replace(event, fault="gauge", onset=event.onset + 50, start=event.start + 50)
    both = replace(decision, events=[event, other])
    assert "less likely" not in answers(bank, [both])[0]
    likely = replace(event, instead=(("gauge", 1000.0), ("unknown", 4.0)))
    said = answers(bank, [replace(decision, events=[likely])])[0]
    assert "; something undeclared is only 4 times less likely;" in said
    early = replace(other, onset=1.0, start=2.0, end=10.0)  # over before the leak begins
    apart = replace(decision, events=[early, event])
    assert "; gauge is" in answers(bank, [apart])[1]


def test_what_may_be_there_too_is_said_and_what_is_told_beside_is_not_said_twice(bank, decision):
    (event,) = decision.events
    event = replace(event, beside=(("gauge", 0.31),))
    (line,) = answers(bank, [replace(decision, events=[event])])
    assert "; gauge may be there too (p 0.31);" in line
    other = replace(event, fault="gauge", beside=())
    assert "there too" not in answers(bank, [replace(decision, events=[event, other])])[0]


def test_no_fault_is_said_of_the_judged_share_alone(bank):
    quiet = decide(bank, log(2))
    status = ["HEALTHY"] * 408 + ["NOT_JUDGED"] * (COUNT - 408)
    reason = [""] * 408 + ["u is outside of its trusted range, 0 to 2"] * (COUNT - 408)
    blind = replace(quiet, status=status, reason=reason)
    u = quiet.run.columns["u"][408:]
    was = f"u was {u.min():.3g} to {u.max():.3g}"
    (line,) = answers(bank, [blind])
    assert line.startswith(
        "No fault in the 34 % of the log that could be judged; not judged from 204 s to 599.5 s (u "
        f"is outside of its trusted range, 0 to 2; {was}); leak below "
    )
    (found,) = runs_as_dicts(bank, [blind], ["leak", "gauge"]).values()
    assert found["judged_share"] == pytest.approx(0.34)
    assert found["silent"] == [
        {
            "from": 204.0,
            "to": 599.5,
            "share": pytest.approx(0.66),
            "reason": f"{reason[-1]}; {was}",
        }
    ]
    assert found["faults"]["leak"]["judged_share"] <= 0.34
    assert found["faults"]["leak"]["smallest"] == least_told(bank, blind, 0)
    # it would show at once in no row, and by all of them together it would all the same
    seen = (
        blind.posterior.seen & np.array([False, True, True])[: blind.posterior.seen.shape[1], None]
    )
    unseen = replace(blind, posterior=blind.posterior._replace(seen=seen))
    (found,) = runs_as_dicts(bank, [unseen], ["leak", "gauge"]).values()
    least = least_told(bank, blind, 0)
    assert found["faults"]["leak"] == {"judged_share": 0.0, "smallest": least}
    assert found["faults"]["gauge"]["smallest"] is not None
    assert answers(bank, [unseen]) == answers(bank, [blind])
    nothing = replace(quiet, status=["NOT_JUDGED"] * COUNT, reason=["not sampled"] * COUNT)
    (line,) = answers(bank, [nothing])
    assert line == "Nothing could be judged: from 0 s to 599.5 s (not sampled)"
    wide = for_bank(bank.model, bank.noise, widened=14.0)
    (line,) = answers(replace(bank, model=wide), [nothing])
    assert line.startswith("Nothing could be judged: from 0 s to 599.5 s (not sampled); by the ")
    assert line.endswith(" and a fault must be 14 times as large to be told")


def test_of_many_stretches_the_reasons_are_said_with_their_shares(bank):
    """Ten of 30 s each in the second half of 600 s: four for one reason, three for each other."""
    quiet = decide(bank, log(2))
    status, reason = ["HEALTHY"] * COUNT, [""] * COUNT
    why = ["not sampled", "leak would not show: u does not excite it", "something else"]
    for k in range(COUNT // 2, COUNT):
        status[k], reason[k] = "NOT_JUDGED", why[(k // 60) % 3]
    status[100], reason[100] = "NOT_JUDGED", "a reason of one row"
    (line,) = answers(bank, [replace(quiet, status=status, reason=reason)])
    assert line.startswith(
        "No fault in the 50 % of the log that could be judged; not judged 20 % (leak would not "
        "show: u does not excite it), 15 % (something else) and 15 % (not sampled); leak below "
    )


def test_a_fault_that_may_be_older_than_the_log_says_so(bank, decision):
    (event,) = decision.events
    old = replace(event, onset=3.0, onset_lo=-1.0, onset_hi=7.0, older="perhaps")
    (line,) = answers(bank, [replace(decision, events=[old])])
    assert " since 7 s or earlier, perhaps already there when the log begins (p > 0.999, " in line
    (line,) = answers(bank, [replace(decision, events=[replace(old, older="yes")])])
    assert " already there when the log begins (p > 0.999, run run1)" in line


def test_the_first_screen_says_one_finding_whole_and_many_by_their_heads(bank, decision):
    (event,) = decision.events
    whole = answers(bank, [decision])[0]
    assert "; ".join(first_screen(bank, [decision])) == whole
    many = replace(decision, events=[replace(event, start=event.start + k) for k in range(12)])
    lines = first_screen(bank, [many])
    assert len(lines) == 5
    assert lines[:4] == [whole.partition("; ")[0]] * 4
    assert lines[4] == f"and {len(answers(bank, [many])) - 4} more (--verbose): leak"
    # that nothing is wrong with another log is no less an answer
    both = [many, decide(bank, log(10))]
    *_, more, last = lines = first_screen(bank, both)
    assert len(lines) == 5
    assert more == f"and {len(answers(bank, both)) - 4} more (--verbose): run run1: leak"
    assert last.startswith("No fault in run run10; ")


def test_what_may_be_there_where_a_log_ends_is_said(bank):
    """A leak of p 0.4 in the last row, and nothing of a gauge of 0.01."""
    quiet = decide(bank, log(10))
    p = quiet.posterior.p.copy()
    p[-1] = 0.4, 0.01
    (line,) = answers(bank, [replace(quiet, posterior=quiet.posterior._replace(p=p))])
    assert line.startswith("No fault; ")
    assert line.endswith("; at the end of the log there may be leak (p 0.4)")
    assert "at the end" not in answers(bank, [quiet])[0]


def test_a_report_leads_with_what_lasts(bank, decision):
    (event,) = decision.events
    brief = replace(event, start=10.0, end=20.0, onset=10.0, onset_lo=9.0, onset_hi=11.0)
    report = decision_report(bank, [replace(decision, events=[brief, event])])
    first, detail, second = report.summary_sentences
    whole = answers(bank, [decision])[0]
    assert whole.startswith(f"{first}; told at")
    assert detail == f"T{whole[len(first) + 3 :]}."
    assert second == "{}.".format(
        answers(bank, [replace(decision, events=[brief])])[0].split(";")[0]
    )
    assert "p 1" not in " ".join(report.summary_sentences)


def test_a_fault_of_twice_the_least_size_is_told_and_one_of_a_third_is_not(bank):
    size = least_told(bank, decide(bank, log(0)), 0)

    def told(seed, leak):
        return any(each.fault == "leak" for each in decide(bank, log(seed, leak)).events)

    assert [told(seed, -2 * size) for seed in (4, 5, 6)] == [True] * 3
    assert [told(seed, -size / 3) for seed in (4, 5, 6)] == [False] * 3


def test_the_evidence_replays_from_a_file(bank, decision, tmp_path):
    found = evidence(bank, decision, decision.events[-1])
    assert found.replayed is not None
    assert found.run.t[0] < ONSET < found.run.t[-1]
    timed = replace(found.run, clock=Clock(datetime(2026, 5, 1, 8, 41, 10)))
    write_table(as_table(timed), tmp_path / "window.csv")
    (again,) = read_telemetry(tmp_path / "window.csv", names=["u", "x"])
    np.testing.assert_array_equal(again.t, timed.t)
    events = decide(bank, again).events
    assert any(same(bank, decision.events[-1], each) for each in events)


def test_a_file_of_evidence_shows_the_clock_of_the_log(bank, decision, tmp_path):
    """Row by row as the log has it, through midnight, and read by that clock it says the same."""
    begun = datetime(2026, 5, 1, 23, 55, 45)
    whole = replace(decision.run, clock=Clock(begun))
    found = evidence(bank, replace(decision, run=whole), decision.events[-1])
    write_evidence([found], [tmp_path / "e.csv"])
    with open(tmp_path / "e.csv") as file:
        rows = list(csv.DictReader(file))
    logged = {
        (begun + timedelta(seconds=t)).isoformat(): (t, x)
        for t, x in zip(whole.t.tolist(), whole.columns["x"].tolist(), strict=True)
    }
    for row in rows:
        # ten digits are written
        assert (float(row["t"]), float(row["x"])) == pytest.approx(logged[row["time"]], rel=1e-9)
    assert {row["time"][:10] for row in rows} == {"2026-05-01", "2026-05-02"}
    (again,) = read_telemetry(tmp_path / "e.csv", time="time", names=["u", "x"])
    (event,) = (each for each in as_dicts(bank, [decide(bank, again)]) if each["fault"] == "leak")
    onset = datetime.fromisoformat(event["onset_clock"])
    first, last = (
        begun + timedelta(seconds=each) for each in (found.event.onset_lo, found.event.onset_hi)
    )
    assert first <= onset <= last


def test_the_report_opens_with_the_answer_and_shows_the_evidence(bank, decision):
    windows = [evidence(bank, decision, each) for each in decision.events]
    report = decision_report(bank, [decision], (), windows)
    assert report.summary_sentences[0].startswith("leak -0.")
    titles = ["Run run1", "Faults", "Evidence", "Every fault, told or not"]
    assert [each.title for each in report.sections] == titles
    assert [each.folded for each in report.sections] == [False, False, False, True]
    glance, _, shown, rest = report.sections
    assert [len(each.figures) for each in (glance, shown)] == [1, 1]
    assert "leak" in glance.figures[0].svg
    assert "gauge" not in glance.figures[0].svg, "what was not told is left out"
    assert "gauge" in shown.figures[0].svg, "no cause looks like another one elsewhere"
    assert [each.title for each in rest.figures] == [
        "Probabilities and residuals, run1",
        "Estimated fault: leak",
        "Estimated fault: gauge",
    ]
    assert "gives the same answer" in shown.paragraphs[0]
    page = render(report)
    places = [page.index(part) for part in ("leak -0.", "<svg", "Every event.", "judged alone")]
    assert places == sorted(places)


@pytest.mark.study
def test_of_several_runs_the_one_with_a_fault_is_open(bank, decision):
    healthy = [decide(bank, log(seed)) for seed in (2, 3)]
    report = decision_report(bank, [*healthy, decision])
    runs = [(each.title, each.folded) for each in report.sections if each.title.startswith("Run ")]
    assert runs == [("Run run1", False), ("Run run2", True), ("Run run3", True)]


@pytest.mark.study
def test_the_open_figure_is_of_the_run_that_the_first_sentence_speaks_of(bank, decision):
    """A short event in the run before, and silence of a run of which little was judged."""
    (event,) = decision.events
    brief = replace(event, run="early", start=310.0, end=320.0)
    early = replace(decision, run=replace(decision.run, name="early"), events=[brief])
    windows = [Evidence(e, one, slice(0, 900), e) for one, e in ((early, brief), (decision, event))]
    report = decision_report(bank, [early, decision], (), windows)
    assert "run run1)" in report.summary_sentences[0]
    runs = [(each.title, each.folded) for each in report.sections if each.title.startswith("Run ")]
    assert runs == [("Run run1", False), ("Run early", True)]
    (evidence_,) = (each for each in report.sections if each.title == "Evidence")
    assert [each.partition(":")[0] for each in evidence_.paragraphs] == [
        f"leak told at {event.start:.12g} s, run run1",
        "leak told at 310 s, run early",
    ]
    quiet = decide(bank, log(10))
    silent = replace(quiet, run=replace(quiet.run, name="silent"), status=["NOT_JUDGED"] * COUNT)
    report = decision_report(bank, [silent, quiet])
    assert report.summary_sentences[0] == "No fault in run run10"
    assert report.sections[0].title == "Run run10"


def test_evidence_is_shown_of_what_the_first_sentence_speaks_of(bank, decision):
    """A fault behind eight short events; of these the seventh was asked for."""
    (event,) = decision.events
    short = [replace(event, start=10.0 * k, end=10.0 * k + 5.0) for k in range(8)]
    many = replace(decision, events=[*short, event])
    shown = [each for _, each in shown_first(bank, [many], [short[6]])]
    assert shown == [event, short[6], *short[: MOST_SHOWN - 2]]
    said = decision_report(bank, [many]).summary_sentences[0]
    assert finding(event, "m/s", bank.step)[0] == said
    assert [each for _, each in shown_first(bank, [decision])] == [event]
    assert shown_first(bank, [decide(bank, log(2))]) == []


def test_a_report_of_a_healthy_run_has_the_outputs_alone(bank):
    report = decision_report(bank, [decide(bank, log(2))])
    assert [each.title for each in report.sections] == ["Run run2", "Every fault, told or not"]
    assert "No fault was told." in report.sections[0].figures[0].caption


def test_a_report_of_a_log_with_a_clock_is_in_its_time(bank, decision):
    timed = replace(decision.run, clock=Clock(datetime(2026, 5, 1, 8, 41, 10)))
    report = decision_report(bank, [replace(decision, run=timed)])
    (table,) = report.sections[1].tables
    assert table.header[1:4] == ("began", "told", "seen until")
    # 300 s after 08:41:10, found to within seconds; told at 309.5 s; the log ends at 599.5 s
    assert table.rows[0][1].startswith("08:46:")
    assert table.rows[0][2] == "08:46:19.5"
    assert table.rows[0][3].startswith("08:51:0")
    assert "time (s)" not in render(report)
    assert "08:44:00" in report.sections[0].figures[0].svg


SIZES = np.concatenate([[-9999.0, 1e9, -1e9, 1e30], 10.0 ** np.arange(-1, 15)])


def glitched(run, rows):
    run.columns["x"][rows] = SIZES[: len(rows)]
    return run


@pytest.mark.parametrize("seed", range(3))
def test_single_samples_of_any_size_raise_nothing(bank, seed):
    """Twenty in ten minutes: no alarm, no event; five samples later every fault's interval holds
    0."""
    rows = np.sort(
        np.random.default_rng(seed).choice(np.arange(20, COUNT - 20, 8), len(SIZES), False)
    )
    said = decide(bank, glitched(log(10 + seed), rows))
    assert not said.events
    assert "FAULT" not in said.status
    for k in rows + 5:
        assert np.all(said.posterior.lo[k] <= 0)
        assert np.all(said.posterior.hi[k] >= 0)
    assert np.isfinite(said.posterior.f[20:]).all()
    # levels are 2.5 m and more, so that the least is off by seventy standard deviations
    odd = [("x", said.run.t[k], said.run.columns["x"][k]) for k in rows]
    assert list(said.glitches) == odd
    assert list(decide(bank, log(10 + seed)).glitches) == []


OFF = np.array([3.0, -4.0, 5.0, -6.0, 7.0, -8.0, 10.0, -12.0, 15.0, -20.0, 30.0, -50.0, 100.0])


@pytest.mark.parametrize("seed", range(3))
def test_single_samples_that_are_a_little_off_raise_nothing(bank, seed):
    """By some standard deviations: what a fault that has just begun would show as well."""
    run = log(30 + seed)
    rows = 40 + 80 * np.arange(len(OFF))
    run.columns["x"][rows] += SIGMA * np.random.default_rng(seed).permutation(OFF)
    said = decide(bank, run)
    assert not said.events
    assert "FAULT" not in said.status
    for k in rows + 5:
        assert np.all(said.posterior.lo[k] <= 0)
        assert np.all(said.posterior.hi[k] >= 0)


def test_a_glitch_tells_no_more_than_a_sample_that_is_missing(bank):
    """The same log without them is answered the same: nothing of a glitch is left in the states,
    nor in what speaks for any fault."""
    run, rows = log(14, LEAK), np.arange(50, COUNT, 60)
    odd, lost = (dict(run.columns) | {"x": run.columns["x"].copy()} for _ in range(2))
    odd["x"][rows] = np.resize([-9999.0, 1e6, -1e9, 1e30], len(rows))
    lost["x"][rows] = np.nan
    said, without = (decide(bank, replace(run, columns=each)) for each in (odd, lost))
    judged = np.isfinite(without.posterior.healthy)
    judged[rows] = False
    for name in ("p", "f", "lo", "hi", "healthy", "unknown", "x"):
        found, expected = (getattr(d.posterior, name)[judged] for d in (said, without))
        # 9999 m is 5e5 times sigma and leaves 25 / 5e5 of it
        np.testing.assert_allclose(found, expected, atol=1e-4, err_msg=name)
    assert [each.fault for each in said.events] == [each.fault for each in without.events]


def test_a_row_that_is_missing_where_an_input_changes_raises_nothing(bank):
    """Off by 0.5 s of the change: up to twenty standard deviations of the sensor."""
    run = log(12)
    kept = np.delete(np.arange(COUNT), np.arange(60, COUNT, 100))
    columns = {name: values[kept] for name, values in run.columns.items()}
    said = decide(bank, replace(run, t=run.t[kept], columns=columns))
    assert not said.events
    assert "FAULT" not in said.status
    assert np.mean(np.array(said.status) == "HEALTHY") > 0.98, "and nothing is held off"


def test_glitches_are_counted_and_named_in_file_and_stream(bank):
    run = log(10)
    run.columns["x"][[50, 120, 300, 301, 400]] = -9999.0, 1e9, 7.0, 7.0, 7.0
    said = decide(bank, run)
    assert [each.t / STEP for each in said.glitches] == [50, 120, 400], "two in a row are no glitch"
    assert [*sentences("run a", said.glitches, None, STEP)] == [
        "run a: 3 samples are far beyond what anything explains, and moved nothing: "
        "x = -9999 at 25 s, 1e+09 at 60 s, 7 at 200 s"
    ]
    assert runs_as_dicts(bank, [said], ["leak", "gauge"])[run.name]["glitches"] == {"x": 3}
    watching, found = Watching(bank, run), []
    for k in range(0, COUNT, 7):
        _, part = watching.push(cut(run, slice(k, k + 7)))
        found += part.glitches
    assert found == list(said.glitches)


def test_the_first_sample_of_a_fault_is_no_glitch(bank, decision):
    assert list(decision.glitches) == []
    run = log(11)
    run.columns["x"][COUNT // 2 :] += 1.0
    said = decide(bank, run)
    assert [each.fault for each in said.events] == ["gauge"]
    assert list(said.glitches) == []


LIMITS = ("", "min = 0\n", "min = 0\nmax = 2\n")


@pytest.mark.parametrize("limits", LIMITS)
def test_what_is_a_hundred_ranges_away_is_no_command(limits):
    """From limit to limit of the plant file, or as far as training where there is none."""
    model = as_stated(TANK.replace("min = 0\nmax = 2\n", limits), POINTS)
    intake, u = Intake.of(model, STEP), POINTS[:, 1]
    low, high = 0.0 if "min" in limits else u.min(), 2.0 if "max" in limits else u.max()
    assert intake.low[0] == pytest.approx(low - 100 * (high - low), rel=1e-12)
    assert intake.high[0] == pytest.approx(high + 100 * (high - low), rel=1e-12)


# the others, by the limits that are taken, above
OTHERS = (pytest.param(each, marks=pytest.mark.study) for each in LIMITS[:-1])


@pytest.mark.parametrize("limits", [*OTHERS, LIMITS[-1]])
@pytest.mark.parametrize("value", [-9999.0, 1e9, -1e30])
def test_a_cell_of_an_input_that_is_no_command_raises_nothing(value, limits):
    """It would act as the limit where the plant file has one."""
    bank = built(TANK.replace("min = 0\nmax = 2\n", limits))
    run = log(21)
    rows = np.arange(50, COUNT, 100)
    run.columns["u"][rows] = value
    said = decide(bank, run)
    assert not said.events
    assert "FAULT" not in said.status
    assert {said.reason[k] for k in rows} == {"not sampled"}
    assert np.mean(np.array(said.status) == "HEALTHY") > 0.7, "held off for ten rows after each"


def test_a_fault_is_sized_and_dated_through_glitches(bank, decision):
    rows = np.arange(50, COUNT, 60)[: len(SIZES)]
    (event,) = decide(bank, glitched(log(1, LEAK), rows)).events
    (plain,) = decision.events
    assert event.fault == plain.fault == "leak"
    assert event.lo < LEAK < event.hi
    assert event.onset == pytest.approx(STEP * np.argmax(LATE), abs=2 * STEP)


def test_a_sensor_that_only_flickers_is_answered_in_numbers(bank):
    """0 and 1 in turn, at one input: nothing that is printed is NaN."""
    run = log(5)
    run.columns["x"][:] = np.arange(COUNT) % 2
    run.columns["u"][:] = 1.0
    said = decide(bank, run)
    for line in answers(bank, [said]):
        assert "nan" not in line
        assert "inf" not in line
    for event in said.events:
        assert np.isfinite(
            [event.start, event.end, event.onset, event.onset_lo, event.onset_hi]
        ).all()


def test_what_an_alarm_without_a_name_may_be_did_show(bank, decision, monkeypatch):
    """Two faults that no data tell apart are named at no size, and yet show."""
    for module in (silence, telling):
        monkeypatch.setattr(module, "least_told", lambda *given: None)
    quiet = replace(decision, events=[])
    (line,) = silence.hidden(bank, [quiet], 1)
    assert line.startswith("gauge of any size to be expected would not have shown")
    status, reason = [*decision.status], [*decision.reason]
    p = decision.posterior.p.copy()
    for k in range(200, 222):
        status[k], reason[k], p[k] = "FAULT", "cause undecided: leak or gauge", (0.5, 0.5)
    posterior = quiet.posterior._replace(p=p)
    unsure = replace(quiet, status=status, reason=reason, posterior=posterior)
    assert silence.hidden(bank, [unsure], 1) == []


def test_of_what_is_as_good_as_gone_no_size_is_told(bank, decision):
    status, reason = [*decision.status], [*decision.reason]
    p, f = decision.posterior.p.copy(), decision.posterior.f.copy()
    for k in range(200, 222):
        status[k], reason[k] = "FAULT", "cause undecided: leak or gauge"
        p[k], f[k] = (0.7, 0.3), (1e-9, -0.09)
    posterior = decision.posterior._replace(p=p, f=f)
    unsure = replace(decision, status=status, reason=reason, posterior=posterior, events=[])
    assert "cause undecided: leak (p 0.7) or gauge of -0.3 m (p 0.3)" in answers(bank, [unsure])[0]
