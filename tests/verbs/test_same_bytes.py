"""The command and Python give the same bytes: the table of `estimate`, on logs of all kinds."""

import numpy as np
import pytest

import faultgauge as fg
from faultgauge.cli.app import run as command
from faultgauge.telemetry.writing import write_table
from tanks import as_csv

HOUR = 1_772_352_000  # s since 1970


def every(columns, name, n):
    kept = np.where(np.arange(len(columns[name])) % n == 0, columns[name], np.nan)
    return columns | {name: kept}


def without(columns, rows):
    return {name: np.delete(cells, rows) for name, cells in columns.items()}


def other(columns):
    """Under other names, the input in halves."""
    return {"seconds": columns["t"], "volts": columns["u"] / 2, "height": columns["x"]}


MAP = ["u=volts*2", "x=height"]
# what becomes of the log; what is said of it to the verb and, likewise, to the command
LOGS = {
    "plain": (lambda log: log, {}),
    "a slow input": (lambda log: every(log, "u", 5), {}),
    "a slow output": (lambda log: every(log, "x", 4), {}),
    "both slow": (lambda log: every(every(log, "u", 10), "x", 3), {}),
    "a gap": (lambda log: without(log, slice(200, 260)), {}),
    "a late row": (lambda log: log | {"t": log["t"] + 0.03 * (np.arange(600) > 300)}, {}),
    "since 1970": (lambda log: log | {"t": log["t"] + HOUR}, {}),
    "other names": (other, {"time": "seconds", "map": MAP}),
    "a condition": (lambda log: log | {"mode": np.arange(600) % 100 > 2}, {"where": "mode == 1"}),
    "two runs": (lambda log: log | {"run": np.repeat([1, 2], 300)}, {}),
    "another rate": (lambda log: log, {"resample": 5.0}),
}
OPTIONS = {"time": "--time", "where": "--where", "resample": "--resample", "map": "--map"}


def cells(value):
    return [str(each) for each in (value if isinstance(value, list) else [value])]


# both slow is there, too
ONE_SLOW = pytest.param("a slow output", marks=pytest.mark.study)


@pytest.mark.parametrize("name", [ONE_SLOW if each == "a slow output" else each for each in LOGS])
def test_the_command_and_python_write_the_same_bytes(name, calibrated, tank, tmp_path):
    change, said = LOGS[name]
    log = as_csv(change(tank.log(3, tank.leak)), tmp_path / "log.csv", 17)
    log.write_text(log.read_text().replace("nan", ""))
    model = tmp_path / "model.fgm"
    fg.save_model(calibrated.model, model)
    answer = fg.estimate(model, log, **said)
    write_table(answer.columns(), tmp_path / "python.csv")
    words = [
        w for key, value in said.items() for each in cells(value) for w in (OPTIONS[key], each)
    ]
    called = ["estimate", model, log, "--out", tmp_path / "command.csv", *words]
    assert command([str(each) for each in called]) == 0
    by_command, by_python = (tmp_path / f"{who}.csv" for who in ("command", "python"))
    assert by_command.read_bytes() == by_python.read_bytes()
    assert (
        len(by_python.read_text().splitlines()) > 200
    )  # rows of 600, of the slowest log every third
