"""A bar with a share where a terminal looks on, and elsewhere a line now and then."""

from dataclasses import replace

import numpy as np
import pytest

from faultgauge.cli import options
from faultgauge.cli.options import narrate
from faultgauge.detection import decisions
from faultgauge.detection.watch import Watch
from faultgauge.identification.fit import EQUATIONS, fit
from faultgauge.identification.simulation_error.result import PHASES
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.progress import Step, in_phases, within
from faultgauge.telemetry import Run
from scenes import log, tank_bank

LEARNED_TANK = """
name = "tank"
[states.h]
derivative = "k*u - out(h)"
[inputs.u]
[outputs.h]
value = "h"
[parameters.k]
value = 0.3
[networks.out]
hidden = 2
"""


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


@pytest.mark.study
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


def test_phases_have_the_share_at_which_they_begin():
    """Of 1 + 2 + 5: what is longest of how a text begins counts, and nothing goes back."""
    told = []
    progress = in_phases(within(told.append, 0.5, 1.0), {"warm": 1, "nets": 2, "nets: at last": 5})
    for text in ("warm start", "nets, margin 2", "odd", "nets: at last", "nets, margin 3"):
        progress(text)
    assert [str(each) for each in told][2] == "odd"
    assert [each.share for each in told] == [0.5, 0.5 + 1 / 16, 0.5 + 1 / 16, 0.6875, 0.6875]


@pytest.mark.study  # it fits
def test_a_refinement_knows_every_phase_that_it_goes_through():
    """A tank with a network for its outlet, from text to standard errors."""
    t = 0.5 * np.arange(400)
    u = 1 + 0.8 * np.sign(np.sin(0.21 * t)) + 0.1 * np.sin(1.3 * t)
    level = [1.0]
    for k in range(399):
        level.append(level[-1] + 0.5 * (0.5 * u[k] - 0.4 * np.sqrt(level[-1])))
    y = np.array(level) + 0.01 * np.random.default_rng(0).standard_normal(400)
    plant = GrayBoxPlant.untrained(parse_plant(LEARNED_TANK))
    told = []
    fit(plant, [Run("a", "a.csv", t, {"u": u, "h": y})], refine=True, restarts=2,
        progress=told.append)  # fmt: skip
    shares = [each.share for each in told if isinstance(each, Step)]
    assert len(shares) == len(told)
    assert shares == sorted(shares)
    assert told[-1] == "standard errors"
    assert told[-1].share > 0.9
    phases = [each for each in told if each.share >= EQUATIONS][1:]
    assert all(any(text.startswith(begins) for begins in PHASES) for text in phases)
