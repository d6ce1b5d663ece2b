"""Holds what is said of a run against itself: sentence, event, table, report and JSON must be views
of one posterior."""

import json
import re
from datetime import datetime

import numpy as np
import pytest

from faultgauge.detection.answer.shares import WHOLE
from faultgauge.detection.decisions import table
from faultgauge.detection.onset.retrospective import retrospect, shares_in_hindsight
from faultgauge.detection.posterior.events import POSSIBLE, UNKNOWN
from faultgauge.detection.posterior.posterior import LIKELY
from faultgauge.detection.posterior.verdicts import NAMED
from faultgauge.detection.words import OLDER, TOLD_ODDS, UNDECLARED, number
from faultgauge.reporting.decision_chapter import HEADER, _events
from faultgauge.reporting.retrospective_chapter import retrospective_section
from faultgauge.reporting.words.answer import answers, as_dicts, first_screen, runs_as_dicts, told
from faultgauge.reporting.words.hindsight import sentences
from faultgauge.reporting.words.probability import probability

NOTHING = re.compile(r"\b(nan|inf|none)\b", re.IGNORECASE)


def compare(bank, said):
    """Every view of one decision with every other."""
    names = bank.model.plant.signals.fault_names
    rows, lines = table([said], names), answers(bank, [said])
    told_of = as_dicts(bank, [said])
    of_run = runs_as_dicts(bank, [said], names)[said.run.name]
    check_statuses(bank, said, rows, lines, of_run)
    for event, plain in zip(said.events, told_of, strict=True):
        check_event(bank, said, event, plain, rows)
        assert plain["sentence"] in lines
    check_once(said.events)
    check_named(bank, said, told_of, of_run["unnamed"])
    check_undecided(rows, names, of_run)
    check_shares(bank, said, of_run)
    check_screen(first_screen(bank, [said]), lines)
    check_report(bank, said)
    assert not any(NOTHING.search(line) for line in [*lines, *first_screen(bank, [said])])
    assert json.dumps([told_of, of_run], allow_nan=False)


def check_statuses(bank, said, rows, lines, of_run):
    """What could be judged, in every view; and every row under alarm is told of."""
    status = np.array(rows["status"])
    judged = np.mean(np.isin(status, ["HEALTHY", "FAULT"]))
    assert of_run["judged_share"] == pytest.approx(judged)
    assert judged + sum(each["share"] for each in of_run["silent"]) == pytest.approx(1.0)
    if any(line.startswith("No fault") for line in lines):
        assert "FAULT" not in status
        assert len(lines) == 1
        share = re.match(r"No fault in the (\d+) % of the log that could be judged", lines[0])
        assert not share or f"{100 * judged:.0f}" == share[1]
        assert share or judged >= 0.95
        check_least(lines[0], of_run["faults"])
    if any(line.startswith("Nothing could be judged") for line in lines):
        assert judged == 0
    t = said.run.t
    for each in of_run["silent"]:
        part = status[(each["from"] <= t) & (t <= each["to"])]
        assert not np.isin(part, ["HEALTHY", "FAULT"]).any()
        assert each["share"] == pytest.approx(len(part) / len(t))
    covered = [(each.onset_lo, each.end) for each in said.events]
    covered += [(each["from"], each["to"]) for each in of_run["unnamed"]]
    alone = status == "FAULT"
    for low, high in covered:
        alone &= (low > t) | (high < t)
    edges = np.flatnonzero(np.diff(alone, prepend=False, append=False)).reshape(-1, 2)
    # the bank's memory is the longest that an alarm goes before its event, or on behind it
    assert all(t[b - 1] - t[a] <= bank.knowledge.memory for a, b in edges)


def check_shares(bank, said, of_run):
    """Where a part of the log could not be judged, whatever is told says how much could."""
    share = f"{100 * of_run['judged_share']:.0f} %"
    for each in told(bank, [said]):
        if of_run["judged_share"] < WHOLE:
            assert re.search(rf"\b{share} (of the log (that )?)?could be judged", each.text)


def check_least(sentence, faults):
    """What would not have shown is what `smallest` says."""
    for name, each in faults.items():
        small = re.search(rf"\b{name} below ([\d.e+-]+)", sentence)
        assert (small is None) == (each["smallest"] is None)
        assert small is None or small[1] == number(each["smallest"], 2)


def check_once(events):
    """A fault that is dated to before its last event ended is no second event, and one of another
    sign ends the one before, unless it is dated to before that was told."""
    latest = {}
    for k, each in enumerate(events):
        for other in events[:k]:
            if each.fault == other.fault != UNKNOWN:
                assert other.end <= each.onset or each.onset < other.start
        key = each.fault, np.sign(each.size or 0.0)
        assert each.fault == UNKNOWN or each.onset > latest.get(key, -np.inf), each
        latest[key] = each.end


def check_named(bank, said, told_of, unnamed):
    """No row names a fault for longer than a name takes that no sentence has there."""
    t, status, reason = said.run.t, np.array(said.status), np.array(said.reason)
    names = (*bank.model.plant.signals.fault_names, UNKNOWN)
    columns = np.concatenate([said.posterior.p, said.posterior.unknown[:, None]], axis=1)
    for name, p in zip(names, columns.T, strict=True):
        open_ = (status == "FAULT") & (reason == "") & (np.nan_to_num(p) >= NAMED)
        spans = [(each.onset_lo, each.end) for each in said.events if each.fault == name]
        spans += [(e["from"], e["to"]) for plain in told_of for e in plain["given_up"]
                  if e["fault"] == name]  # fmt: skip
        spans += [(each["from"], each["to"]) for each in unnamed]
        for first, last in spans:
            open_ &= (t < first) | (t > last)
        edges = np.flatnonzero(np.diff(open_, prepend=False, append=False)).reshape(-1, 2)
        assert all(t[b - 1] - t[a] <= bank.knowledge.memory for a, b in edges), name
    for plain in told_of:
        for each in plain["given_up"]:
            assert "was named beside it" in plain["sentence"]
            part = (each["from"] <= t) & (t <= each["to"])
            assert np.nanmax(columns[part, names.index(each["fault"])]) >= NAMED


def compare_hindsight(bank, said):
    """What is told in hindsight: odds and p of one posterior, and sentence and table of it."""
    seen = retrospect(bank, said)
    lines = sentences(bank, [said], seen)
    for each in seen:
        assert 0 < each.p <= 1
        for _, odds in each.alternatives:
            assert each.p <= odds / (1 + odds) + 1e-6  # a rival of odds o has p / o
    windows = {each.start: each.judged for each in seen}  # of which several changes may be told
    assert sum(windows.values()) <= 1 + 1e-9
    faulty = [each for each in seen if each.cause != "healthy"]
    whole = check_hindsight_shares(said, seen, lines[len(faulty) :], bool(faulty))
    assert len(lines) == len(faulty) + (not faulty or not whole)
    for each, line in zip(faulty, lines, strict=False):
        assert f"(p {probability(each.p)}, run {each.run})" in line
        assert ("as likely" in line) <= (each.p < 0.6)
        for name, p in each.beside:
            assert p > POSSIBLE
            assert re.search(rf"; {name} (may be|is likely) there too \(p {probability(p)}\)", line)
            assert not re.search(rf"\b{name} (is|or)\b(?! likely there)", line)
    section = retrospective_section(bank, [said], seen)
    (found,) = section.tables
    assert all(any(column) for column in zip(*found.rows, strict=True)), "an empty column"
    assert all(each.caption for each in section.figures)
    if len(section.figures) < 6:  # of more, some are left out
        drawn = [each.title for each in section.figures if each.title.startswith("Onset of")]
        assert len(drawn) == sum(_dated(each) for each in faulty)
    at = found.header.index("p")
    assert [row[at] for row in found.rows] == [
        probability(each.p) if each.judged > 0 else "" for each in seen
    ]
    return seen, lines


def check_hindsight_shares(said, seen, rest, faulty):
    """Whether all counts as judged in hindsight: nothing does that has no sample or lies outside;
    a stretch that does not has its reason; `rest` are the sentences behind those of faults."""
    shares = shares_in_hindsight(said, seen)
    silent = np.zeros(len(said.run.t), bool)
    for each in shares.silent:
        assert each.reason
        silent |= (each.start <= said.run.t) & (said.run.t <= each.end)
    assert shares.judged == pytest.approx(1 - np.mean(silent))
    nothing = [why == "not sampled" or status == "STALE"
               for why, status in zip(said.reason, said.status, strict=True)]  # fmt: skip
    outside = ~said.posterior.inside & (np.array(said.status) != "FAULT")
    assert silent[nothing].all()
    assert silent[outside].all()
    if shares.judged < WHOLE:
        share = f"{100 * shares.judged:.0f} % of the log"
        (line,) = rest
        if shares.judged == 0:
            assert line.startswith("In hindsight: nothing could be judged: ")
        elif faulty:
            assert line.startswith(f"In hindsight {share} could be judged; not judged ")
        else:
            start = f"In hindsight: no fault in the {share} that could be judged; not judged "
            assert line.startswith(start)
    return shares.judged >= WHOLE


def _dated(found):
    """Whether its onset is that of its posterior, which lies behind the beginning."""
    step = np.median(np.diff(found.t))
    return found.onset_lo > found.start and abs(found.density @ found.t - found.onset) <= step


def check_undecided(rows, names, of_run):
    """Where the log ends with a fault likelier than none and no row judged, the likeliest cause is
    said, as the last such row has it."""
    told = [each for each in of_run["unnamed"] if each["sentence"].startswith("Undecided")]
    sampled = [k for k, p in enumerate(rows["p_healthy"]) if p is not None and np.isfinite(p)]
    last = sampled[-1] if sampled else None
    expected = (
        last is not None
        and rows["status"][last] == "NOT_JUDGED"
        and rows["p_healthy"][last] < LIKELY
    )
    assert len(told) == expected
    if told:
        p = {UNDECLARED if n == UNKNOWN else n: rows[f"p_{n}"][last] for n in (*names, UNKNOWN)}
        found = re.search(
            r"cause is ([^,]+?)(?:, (\S+)(?: \S+)? if it is there)? \(p ([^)]+)\); "
            r"that nothing is wrong has p (.+)$",
            told[0]["sentence"],
        )
        cause, size, sure, calm = found.groups()
        assert p[cause] == max(p.values())
        assert sure == probability(p[cause])
        assert calm == probability(rows["p_healthy"][last])
        assert (size is None) == (cause == UNDECLARED)
        if size:  # three figures
            mean = rows[f"f_{cause}"][last] / p[cause]
            assert float(size) == pytest.approx(mean, rel=6e-3, abs=1e-12)


def check_screen(shown, lines):
    """A first screen is at most five lines, each the beginning or the rest of what is said in
    full, or how much more there is, and what."""
    assert 0 < len(shown) <= 5
    more = [line for line in shown if re.fullmatch(r"and \d+ more \(--verbose\)(: .+)?", line)]
    whole = [line for line in shown if line not in more]
    assert all(any(line in each for each in lines) for line in whole)
    if more:
        assert len(whole) + int(more[0].split()[1]) == len(lines)


def check_event(bank, said, event, plain, rows):
    """One event against the table."""
    begin, end = (int(np.flatnonzero(t == said.run.t)[0]) for t in (event.start, event.end))
    assert rows["status"][begin] == rows["status"][end] == "FAULT"
    assert event.onset_lo <= event.onset <= event.onset_hi <= event.start <= event.end
    column = rows["p_unknown" if event.fault == UNKNOWN else f"p_{event.fault}"]
    at = [k for k in range(begin, end + 1) if column[k] == event.p]
    assert at, "its p is that of one of its rows"
    sentence = plain["sentence"]
    assert f"p {probability(event.p)}, run {event.run})" in sentence
    if event.fault != UNKNOWN:
        k = min(at, key=lambda k: abs(rows[f"f_{event.fault}"][k] - event.size * event.p))
        assert rows[f"f_{event.fault}"][k] == pytest.approx(event.size * event.p)
        if event.p >= NAMED:  # of a less likely one the row's are of there being none, too
            assert rows[f"f_{event.fault}_lo"][k] >= event.lo
            assert rows[f"f_{event.fault}_hi"][k] <= event.hi
        assert event.lo <= event.size <= event.hi
        check_size(event, sentence)
    else:
        k = at[-1]
    check_times(bank, said, event, plain, rows, begin, end)
    names = (*bank.model.plant.signals.fault_names, UNKNOWN)
    marginal = {name: rows[f"p_{name}"][k] for name in names}  # alone and with others
    beside = dict(event.beside)
    for name, odds in event.instead:
        assert 0 < odds <= TOLD_ODDS
        # 1e-6: the sets are kept in single precision
        assert marginal[name] <= event.p / odds + event.p * beside.get(name, 0.0) + 1e-6
        if f"{name} is more than" in sentence:
            assert name not in beside
            assert marginal[name] <= event.p / TOLD_ODDS + 1e-6
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


def check_times(bank, said, event, plain, rows, begin, end):
    """Told and seen last in the time of the table; the onset never later than told."""
    sentence = plain["sentence"]
    clocked = "time" in rows
    for word, row in (("told at", begin), ("seen until", end)):
        if not clocked:
            assert f"{word} {rows['t'][row]:.12g} s" in sentence
            continue
        stamp = datetime.fromisoformat(rows["time"][row])
        shown = re.search(rf"{word} (?:(\S+) )?(\d+:\d+:[\d.]+)", sentence)
        day = shown[1] or said.run.clock.begun.date().isoformat()
        assert datetime.fromisoformat(f"{day}T{shown[2]}") == stamp
    began = re.search(r"since (?:(\S+) )?([\d.:-]+) ?", sentence)
    clock = said.run.clock
    if event.older != "no":
        assert OLDER in sentence
        assert event.onset_lo <= said.run.t[0] + bank.hold_off
    elif not clocked:
        assert float(began[2]) <= event.start
    else:
        day = began[1] or said.run.clock.begun.date().isoformat()
        assert datetime.fromisoformat(f"{day}T{began[2]}") <= clock.at(event.start)
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
        assert row[place["fault"]] == (UNDECLARED if event.fault == UNKNOWN else event.fault)
        assert f"told at {row[place['told']]}, seen until {row[place['seen until']]}" in answer.text
        if event.size is not None:
            assert row[place["p"]] == probability(event.p)
