"""A bar with a share where a terminal looks on, and elsewhere a line now and then."""

from dataclasses import replace

import numpy as np

from faultgauge.cli import options
from faultgauge.cli.options import narrate
from faultgauge.detection import decisions
from faultgauge.detection.watch import Watch
from faultgauge.progress import Step
from scenes import log, tank_bank


def test_a_terminal_is_shown_the_step_and_its_share(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as rich is told that a pipe is a terminal
    with narrate("starting") as progress:
        progress("without a share")
        progress(Step("judging [run a]", 0.25))
    said = capsys.readouterr()
    assert said.out == ""
    assert "judging [run a]" in said.err
    assert "25%" in said.err


def test_a_pipe_is_shown_a_line_every_20_s(monkeypatch, capsys):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    clock = iter([0.0, 19.0, 20.0, 20.0, 39.0, 41.0, 41.0])
    monkeypatch.setattr(options, "monotonic", lambda: next(clock))
    with narrate("starting") as progress:
        for share in (0.1, 0.25, 0.3):
            progress(Step("judging", share))
        progress("writing")
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "judging (25 %)\nwriting\n"


def test_a_walk_that_says_how_far_it_is_says_the_same(monkeypatch):
    """1200 rows in parts of 500, to the bit."""
    bank, run, steps = tank_bank(), log(1), []
    monkeypatch.setattr(decisions, "PART", 500)
    walk = decisions._in_parts(Watch.along, steps.append, 2 * len(run.t))
    whole = decisions.decide(bank, run, None)
    parts = decisions.decide(bank, run, None, walk)
    assert parts.events == whole.events
    for one, other in zip(parts.posterior, whole.posterior, strict=True):
        np.testing.assert_array_equal(one, other)
    decisions.decide(bank, replace(run, name="b"), None, walk)
    assert [round(step.share, 3) for step in steps] == [0.0, 0.208, 0.417, 0.5, 0.708, 0.917]
    assert steps[-1] == "judging run b"
