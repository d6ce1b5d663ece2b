"""What is said in logs over which it has once misled, and in a healthy one; each scene's sentence,
events, table and report also agree (`views`)."""

import re
from dataclasses import replace

import numpy as np
import pytest

from faultgauge.detection.decisions import decide, table
from faultgauge.detection.posterior.verdicts import NAMED
from faultgauge.reporting.words.answer import answers, as_dicts, runs_as_dicts
from scenes import NEVER, SCENES, T, between, log, tank_bank
from views import compare, compare_hindsight


def judged(scene):
    """(decision, its sentences), the views of which agree."""
    bank = tank_bank()
    said = decide(bank, SCENES[scene]())
    compare(bank, said)
    return said, answers(bank, [said])


def test_a_healthy_log_has_no_fault_and_says_what_would_not_have_shown():
    said, lines = judged("healthy")
    assert said.events == []
    assert re.fullmatch(
        r"No fault; leak below 0\.\d+ m/s, gauge below 0\.\d+ m and weak below 0\.\d+ would not "
        r"have shown",
        lines[0],
    )


BEYOND = "mostly beyond what the plant file trusts"


def test_no_fault_is_said_of_what_was_judged_alone():
    """Two thirds of the log are beyond what the plant file trusts."""
    said, (line,) = judged(BEYOND)
    assert line.startswith(
        "No fault in the 32 % of the log that could be judged; not judged from 0 s to 4.5 s (too "
        "soon after a start or a gap) and from 200 s to 599.5 s (u is outside of its trusted "
        "range, 0 to 1.8 m/s; u was 1.9); "
    )
    assert re.search(r"; leak below \S+ m/s, gauge below \S+ m and weak below \S+ would", line)
    assert line.endswith(" would not have shown there")
    _, (line,) = compare_hindsight(tank_bank(), said)
    assert line.startswith("In hindsight: no fault in the 33 % of the log that could be judged; ")
    assert line.endswith(" would not have shown there")


def test_what_would_have_shown_of_the_judged_rows_is_named_there_and_not_where_none_was():
    """A bias of the gauge from the middle of the judged rows on, and from 300 s on."""
    (least,) = runs_as_dicts(tank_bank(), [judged(BEYOND)[0]], ("leak", "gauge", "weak")).values()
    size, run = 1.2 * least["faults"]["gauge"]["smallest"], SCENES[BEYOND]
    found = []
    for start in (102, 300):
        biased = run()
        biased.columns["x"] += between(start, NEVER, size)
        found.append([each.fault for each in decide(tank_bank(), biased).events])
    assert found == [["gauge"], []]


@pytest.mark.study  # online is above
def test_in_hindsight_a_fault_that_would_have_shown_is_named_and_one_of_a_third_is_not():
    """Each from the middle of the log on. Hindsight sees the rows that online has judged, so what
    either could have named is of one size; told from what is most like it, not only from none."""
    said, _ = judged("healthy")
    (seen,), _ = compare_hindsight(tank_bank(), said)
    (online,) = runs_as_dicts(tank_bank(), [said], ("leak", "gauge", "weak")).values()
    for fault, size in seen.least.items():
        assert size == pytest.approx(online["faults"][fault]["smallest"], rel=0.02)
        for share, named in ((1.5, True), (1 / 3, False)):
            faulty = log(2, **{fault: between(300, NEVER, share * size)})
            (found,), _ = compare_hindsight(tank_bank(), decide(tank_bank(), faulty))
            assert (found.cause == fault and found.p >= NAMED) == named


def test_a_fault_that_cannot_show_silences_no_other():
    """At u = 0 no gain shows, and a leak does."""
    said, (line, hidden) = judged("a leak while the pump rests")
    assert hidden == "weak of any size to be expected would not have shown in this log"
    assert line.startswith("leak +0.099")
    assert re.search(r"told at 41[23]\S* s", line)
    before = slice(700, 799)  # the last 50 s before it, at rest
    assert set(said.status[before]) == {"HEALTHY"}
    assert "weak would not show: u does not excite it" in said.reason[before]


def test_what_may_be_there_too_is_not_ruled_out():
    """A bias of the gauge and, in the last 100 s, a leak too small for a name."""
    bank, leak = tank_bank(), between(500, NEVER, 0.003)
    said = decide(bank, log(2, gauge=between(300, NEVER, 0.2), leak=leak))
    line, more = answers(bank, [said])
    assert line.startswith("gauge")
    assert re.match(
        r"One more fault than gauge from 5\d\d\S* s to 599.5 s, the end of the log .*, "
        r"the likeliest being weak of ",
        more,
    )
    assert re.search(r"leak (may be|is likely) there too \(p 0\.", line)
    assert "leak is " not in line.replace("leak is likely there too", "")
    assert "leak or" not in line
    assert "or leak" not in line


def test_in_hindsight_too_what_may_be_there_too_is_not_ruled_out():
    """A bias of the gauge and, in the last 100 s, a leak too small for a name: it may be there, as
    may what it looks like, and only one of them is."""
    leak = between(500, NEVER, 0.003)
    said = decide(tank_bank(), log(2, gauge=between(300, NEVER, 0.2), leak=leak))
    (seen,), (line,) = compare_hindsight(tank_bank(), said)
    (event,) = said.events
    assert seen.cause == event.fault == "gauge"
    for beside in (dict(seen.beside), dict(event.beside)):
        assert set(beside) == {"leak", "weak"}
        assert sum(beside.values()) < 1
    assert re.search(r"; leak (may be|is likely) there too \(p 0\.", line)


@pytest.mark.study
def test_since_is_never_later_than_told_where_a_fault_changes_its_sign():
    said, lines = judged("a leak that changes its sign")
    compare_hindsight(tank_bank(), said)
    first, second = said.events
    assert first.size < 0 < second.size
    assert first.onset_lo < 150 < first.onset_hi <= first.start
    assert second.onset == pytest.approx(300, abs=2.0)  # in four samples, seen through noise
    # while the posterior still took the change for something beside the first, it was the second
    assert first.end <= second.onset
    assert "told at 163.5 s, seen until 300.5 s, where its sign changed, as was told at" in lines[0]
    assert "weak is likely" not in lines[0]
    # rows of the table have weak for as long, and the sentence says so
    assert re.search(r"; weak was named beside it from 30\S+ s to 31\S+ s, and given up;", lines[1])
    assert not re.search(r"; weak (is|may be|or|and) ", lines[1])


@pytest.mark.parametrize(
    ("scene", "first", "last"),
    [("a leak that grows", 149.0, 151.0), ("a loss that grows slowly", 200.0, 300.0)],
)
def test_in_hindsight_a_fault_that_is_not_constant_is_weighed_against_one_that_is(
    scene, first, last
):
    """What is undeclared is there beside the constant fault: a fault alone is not as likely, and
    the first of the two begins it."""
    said, _ = judged(scene)
    (seen,), (line,) = compare_hindsight(tank_bank(), said)
    assert seen.cause == "unknown"
    assert line.startswith("In hindsight: something undeclared or not constant since ")
    assert "; constant leak, gauge or weak is more than 1000 times less likely;" in line
    assert first <= seen.onset_lo <= seen.onset_hi <= last


def test_a_fault_that_grows_is_one_with_the_onset_it_had():
    said, (line,) = judged("a leak that grows")
    (event,) = said.events
    assert "run a), after it was told between -0.30 and -0.10 m/s; told at " in line
    assert event.lo < -0.3 < event.hi
    assert event.onset_lo < 150 < event.onset_hi


def test_a_fault_older_than_the_log_says_so():
    said, (line,) = judged("a loss from before the log")
    assert re.match(r"weak \+0\.150\d+ \(.*\) already there when the log begins \(p > ", line)
    assert "since" not in line
    assert "after it was told" not in line  # it was told a little larger, to within its interval
    assert said.events[0].older == "yes"


def test_a_bias_is_one_event_through_dropouts_and_what_is_not_judged():
    """Empty cells for 3 and 15 s, and the command out of its trusted range for 50 s."""
    said, (line,) = judged("a bias through dropouts")
    (event,) = said.events
    assert event.lo < 0.1 < event.hi
    assert line.endswith("would not have shown")
    assert "told at 155 s, seen until 599.5 s, the end of the log; leak or weak is more" in line


def test_a_loss_of_gain_is_one_event_however_the_command_rests():
    """15 %; at 0 for 60 s, where it does not show, and at one value for 60 s."""
    said, _ = judged("a loss through rest")
    (event,) = said.events
    assert event.lo < 0.15 < event.hi


def test_an_event_ends_with_its_fault():
    said, (line,) = judged("a leak that ends")
    assert said.events[0].end == pytest.approx(140, abs=2.0)
    assert re.search(r"seen until 14(0|0\.5|1) s;", line)
    assert set(said.status[300:]) == {"HEALTHY"}


def test_an_event_ends_with_the_last_row_that_was_judged():
    """The sensor falls silent at 400 s with the fault still there: nobody knows about later."""
    said, (line,) = judged("a sensor that falls silent")
    assert said.events[0].end == T[np.flatnonzero(np.array(said.status) == "FAULT")[-1]] < 410
    assert "seen until 404.5 s, and nothing was judged from then on;" in line


def test_an_interval_is_its_two_ends_however_off_centre():
    """The upper end three times as far off as the lower one: the event's own numbers."""
    said, _ = judged("a leak that ends")
    (event,) = said.events
    off = replace(event, hi=event.size + 3 * (event.size - event.lo))
    (line, *_) = answers(tank_bank(), [replace(said, events=[off])])
    assert "(-0.1006 to -0.0961)" in line
    assert not re.search(r"m/s \+-", line)


def test_times_are_the_clocks_in_every_view():
    said, (line,) = judged("a log with a clock")
    (event,) = said.events
    rows = table([said], ("leak", "gauge", "weak"))
    assert rows["time"][int(2 * event.start)] == "2026-05-01T08:46:14"
    assert "told at 08:46:14, seen until 08:50:59.5" in line
    assert re.search(r"since 08:(46:00|45:59) \+- 1\.\d s", line)
    assert as_dicts(tank_bank(), [said])[0]["onset_clock"].startswith("2026-05-01T08:4")


def test_a_fault_that_grew_slowly_is_as_old_as_its_alarm():
    """15 % of gain, lost between 200 and 300 s. Without a `rate` a fault steps, so nothing declared
    explains it until it stands; the posterior then dates it to 406 s, amid the alarm."""
    said, (line,) = judged("a loss that grows slowly")
    (event,) = said.events
    assert event.onset_lo <= 300
    assert event.onset == pytest.approx(213.5, abs=5.0)
    assert "; from 213.5 s until it was told the alarm had no name;" in line
