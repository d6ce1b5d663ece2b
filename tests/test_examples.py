"""The notebooks run: their code cells, one after the other."""

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

FOLDER = Path(__file__).parents[1] / "examples" / "leaking_tank"


def cells(path):
    """The code of every cell."""
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "code":
            yield "".join(cell["source"])


def test_the_notebook_goes_from_a_frame_to_an_answer_and_three_plots(monkeypatch, capsys):
    monkeypatch.chdir(FOLDER)
    shown, lines = [], 0
    names = {"shown": shown}
    for code in cells(FOLDER / "leaking_tank.ipynb"):
        *before, last = code.splitlines()
        lines += sum(map(bool, code.splitlines()))
        exec("\n".join(before), names)
        if "=" in last:
            exec(last, names)
        else:
            exec(f"shown.append({last})", names)  # which a notebook does
    assert lines == 10
    assert [type(each) for each in shown] == [Figure] * 3
    (event,) = names["answer"].events
    assert event.fault == "leak"
    assert event.size == pytest.approx(-0.001, rel=0.05)  # of 2 mm of noise over 1600 s: 1 %
    assert abs(event.onset - 2400) < 30  # s: by then it has taken 30 mm, fifteen times the noise
    assert "leak -0.001" in capsys.readouterr().out
