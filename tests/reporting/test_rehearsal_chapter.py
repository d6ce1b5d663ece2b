"""The report of a rehearsal: every number from its trials, every axis with its unit."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from faultgauge.plants.signals import Fault
from faultgauge.rehearsal.design import Dose, Subject
from faultgauge.rehearsal.result import InjectedFault, Rehearsal, Trial
from faultgauge.rehearsal.scoring import fault_results, large, pair_results
from faultgauge.rehearsal.shares import poisson, wilson
from faultgauge.rehearsal.ways import Way
from faultgauge.rehearsal.words import lines
from faultgauge.reporting.rehearsal_chapter import rehearsal_report
from faultgauge.reporting.report import render


def trial(number, size, found, names=("friction",)):
    told = {"delay": 2.0, "estimate": 1.1 * size, "size_covered": True, "onset_covered": False}
    answers = tuple(
        InjectedFault(n, size, 10.0, size / 0.5, **(told if found else {})) for n in names
    )
    return Trial(number, "w", answers, names if found else (), found, 0, 0.125)


def rehearsal(trials, left_out=None):
    fault = Fault("friction", "input", "u", "N*m")
    dose = Dose("friction", 1.0, 2.0)
    subject = Subject(fault, Way("u", is_input=True, is_loss=False), 0.5, (dose,))
    pooled = large(trials)
    return Rehearsal(
        plant="wheel",
        windows={"w": 1000},
        faults=fault_results([subject], trials, {"friction": {"no room": 2}}, {"friction": 1.5}),
        pairs=pair_results(trials),
        exact=wilson(sum(each.exact for each in pooled), len(pooled)),
        false_alarms=poisson(1, 4.0),
        calibrated_rate=0.5,
        left_out=left_out or {},
        trials=tuple(trials),
        warnings=(),
    )


@pytest.fixture
def found():
    """Found in 0 of 2 at 1 N*m, in all of 2 at 2 N*m and at 4 N*m; one pair of two."""
    sizes = [(1.0, False), (1.0, False), (2.0, True), (2.0, True), (4.0, True), (4.0, True)]
    trials = [trial(k, size, hit) for k, (size, hit) in enumerate(sizes)]
    return rehearsal(
        [*trials, trial(6, 2.0, True, ("friction", "gain"))], {"gain": "a network fault"}
    )


def test_logs_of_which_nothing_is_judged_tell_no_rate_of_false_alarms(found):
    said = lines(replace(found, false_alarms=poisson(0, 0.0)))
    assert not any("nan" in line or "inf " in line for line in said)
    assert any(line.startswith("In untouched logs nothing could be judged") for line in said)


def test_the_table_says_what_the_trials_say(found):
    said = lines(found)
    cells = said[1].split()
    # 0.9 of the way from 1 to 2 in the logarithm; 4 of 4 at 4 times 0.5 and more
    assert cells[:4] == ["friction", "0.5", "N*m", f"{2**0.9:.3g}"]
    assert cells[5:] == ["4/4", "4/4", "4/4", "10", "%", "4/4", "0/4", "2", "s"]
    text = " ".join(said)
    assert "4 of 4, 100 % (51 % to 100 %)" in text  # Wilson: 4 / (4 + 3.84)
    assert "1 false alarm in 4 h, 0.25 per hour" in text
    assert "at most 0.5 per hour" in text
    assert "Not rehearsed: gain, a network fault." in text
    assert "friction: 2 times left out: no room." in text
    assert "1 of 1 named exactly" in text


def test_the_report_draws_each_fault_with_its_unit(found):
    report = rehearsal_report(found)
    assert report.summary_sentences[0].startswith(
        f"Faults were put into one part of the healthy logs, {len(found.trials)} times; "
    )
    page = render(report)
    figures = [figure for section in report.sections for figure in section.figures]
    assert [each.title for each in figures] == ["Foretold and found", "friction by its size"]
    words = " ".join(t.text or "" for t in ET.fromstring(figures[1].svg).iter() if t.text)
    for label in (
        "size of friction (N·m)",
        "share of logs (%)",
        "size error (%)",
        "told after (s)",
    ):
        assert label in words
    assert "friction and gain, 4 times" in page
    assert " nan" not in page


def test_a_fault_that_is_never_found_is_drawn_and_said(tmp_path):
    found = rehearsal([trial(0, 4.0, False), trial(1, 4.0, False)])
    assert "not reached" in lines(found)[1]
    assert "told as: nothing (2)" in " ".join(lines(found))
    assert "friction by its size" in render(rehearsal_report(found))
