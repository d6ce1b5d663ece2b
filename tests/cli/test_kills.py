"""`make kills` in short: each command is ended once at a random moment."""

from pathlib import Path

import pytest


@pytest.mark.study
def test_each_command_ended_once_keeps_its_promises(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import kills

    assert kills.COMMANDS[-1].line.startswith("demo"), "which takes minutes"
    assert kills.carried_out(len(kills.COMMANDS) - 1, seed=1) == 0
