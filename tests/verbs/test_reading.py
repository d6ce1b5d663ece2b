"""`read` and the command line read one log alike, and so is what is in memory."""

from datetime import datetime, timedelta

import numpy as np
import pytest

import faultgauge as fg
import faultgauge.identification.fit
from drawn_models import calibrated, log_of
from faultgauge.cli.app import run as command
from faultgauge.errors import InputError
from faultgauge.telemetry import Run
from faultgauge.telemetry.clock import Clock
from faultgauge.verbs.how import How
from faultgauge.verbs.reading import runs_for_model, unlike_warnings

PLANT = """name = "p"
states.x = { unit = "m", derivative = "b*u - a*x" }
inputs.u = { unit = "V" }
outputs.x = { unit = "m", value = "x" }
parameters = { a = { value = 1.0 }, b = { value = 1.0 } }
"""
CLOCK = datetime(2026, 3, 1, 8, 0)
IN_A_ROW = """name = "in a row"
states = { a = { derivative = "u - a" }, b = { derivative = "a - b" } }
inputs.u = { min = 0, max = 1 }
outputs = { upper = { value = "a" }, lower = { value = "b" } }
faults.leak = { enters = "state", target = "a" }
"""


def table(rows=200, step=0.1, **more):
    t = step * np.arange(rows)
    return {"t": t, "u": np.sign(np.sin(t)), "x": np.sin(0.3 * t), **more}


def every(values, n):
    return np.where(np.arange(len(values)) % n == 0, values, np.nan)


def two_rates(name, n):
    found = table()
    return found | {name: every(found[name], n)}


def timed(cells):
    return {"t": cells} | {name: cells for name, cells in table().items() if name != "t"}


STAMPS = [CLOCK + timedelta(milliseconds=100 * k) for k in range(200)]
EPOCH_MS = 1_772_352_000_000 + 100.0 * np.arange(200)
RENAMED = {"seconds": table()["t"], "volts": table()["u"] / 2, "x": table()["x"]}
# logs (a dict per file), options of the command, arguments of `read`
LOGS = {
    "plain": ([table()], {}),
    "slow input": ([two_rates("u", 4)], {}),
    "slow output": ([two_rates("x", 5)], {}),
    "two files": ([table(), table(300, 0.05)], {}),
    "runs in one file": ([table(run=np.repeat(["a", "b"], 100))], {}),
    "timestamps": ([timed([each.isoformat() for each in STAMPS])], {}),
    "milliseconds since 1970": ([timed(EPOCH_MS)], {}),
    "time and map": ([RENAMED], {"time": "seconds", "map": ["u=volts*2"]}),
    "where": ([table(mode=np.arange(200) % 50 > 5)], {"where": "mode == 1"}),
    "resampled": ([table(2000, 0.01)], {"resample": 10.0}),
    "two rates, resampled": ([two_rates("x", 4)], {"resample": 5.0}),
}


def text(cell):
    return "" if isinstance(cell, float) and np.isnan(cell) else str(cell)


def written(folder, logs):
    paths = []
    for k, columns in enumerate(logs):
        rows = zip(*(np.asarray(cells).tolist() for cells in columns.values()), strict=True)
        lines = [",".join(columns), *(",".join(map(text, row)) for row in rows)]
        paths.append(folder / f"log{k}.csv")
        paths[-1].write_text("\n".join(lines).replace("True", "1").replace("False", "0") + "\n")
    return paths


@pytest.fixture
def by_command(monkeypatch, tmp_path):
    """The runs that `faultgauge fit` comes to."""

    def reading(plant, paths, options):
        seen = []

        def stop(plant, runs, *others, **more):
            seen.extend(runs)
            raise InputError("enough")

        monkeypatch.setattr(faultgauge.identification.fit, "fit", stop)
        told = {"time": "--time", "where": "--where", "resample": "--resample"}
        words = [
            each for key, value in options.items() if key in told for each in (told[key], value)
        ]
        words += [each for value in options.get("map", ()) for each in ("--map", value)]
        out = ["--out", tmp_path / "model.fgm"]
        assert command([str(each) for each in ("fit", plant, *paths, *words, *out)]) == 2
        return seen

    return reading


def same(found, wanted):
    assert len(found) == len(wanted) > 0
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(one.t, other.t)
        assert one.columns.keys() == other.columns.keys()
        for name, values in one.columns.items():
            np.testing.assert_array_equal(values, other.columns[name])
            np.testing.assert_array_equal(one.own(name), other.own(name))
        assert (one.clock, one.units, one.resampled) == (other.clock, other.units, other.resampled)


@pytest.mark.parametrize("name", LOGS)
def test_python_and_the_command_read_one_log_alike(name, by_command, tmp_path):
    logs, options = LOGS[name]
    plant, paths = tmp_path / "plant.toml", written(tmp_path, logs)
    plant.write_text(PLANT)
    found = fg.read(paths, PLANT, **options)
    wanted = by_command(plant, paths, options)
    same(found, wanted)
    assert [run.name for run in found] == [run.name for run in wanted]
    assert [run.content_hash for run in found] == [run.content_hash for run in wanted]
    same(fg.read(logs, PLANT, **options), wanted)


def test_a_slow_input_is_held_as_the_plant_says():
    """By hand: held between its samples, which without a plant nobody can know."""
    t, x = 0.1 * np.arange(13), np.arange(13.0)
    log = {"t": t, "u": every(np.arange(13.0) // 4, 4), "x": x}
    (held,), (plain,) = fg.read(log, PLANT), fg.read(log)
    np.testing.assert_array_equal(held.columns["u"][:9], [0, 0, 0, 0, 1, 1, 1, 1, 2])
    np.testing.assert_allclose(plain.columns["u"][:9], np.arange(9) / 4, rtol=1e-12)


@pytest.mark.parametrize("package", ["pandas", "polars", "pyarrow"])
def test_a_frame_of_any_package_is_a_log(package):
    module = pytest.importorskip(package)
    make = {"pandas": "DataFrame", "polars": "DataFrame", "pyarrow": "table"}[package]
    columns = two_rates("u", 4) | {"t": STAMPS, "on": [True, False] * 100}
    columns["x"] = [None, *columns["x"].tolist()[1:]]  # an empty cell
    plain = {name: list(cells) for name, cells in columns.items()}
    (run,) = fg.read(getattr(module, make)(plain), PLANT)
    same([run], fg.read(columns, PLANT))
    assert run.clock == Clock(CLOCK)
    np.testing.assert_allclose(run.t, 0.1 * np.arange(200), atol=1e-9)  # stamps are whole ms
    assert np.isnan(run.columns["x"][0])
    assert fg.read(getattr(module, make)(plain))[0].columns["on"].tolist() == [1, 0] * 100


def test_an_index_of_pandas_that_is_the_time_is_taken_for_it():
    pandas = pytest.importorskip("pandas")
    whole = table()
    frame = pandas.DataFrame(whole)
    same(fg.read(frame.set_index("t"), PLANT), fg.read(whole, PLANT))
    stamped = pandas.DataFrame(
        {name: whole[name] for name in "ux"}, index=pandas.DatetimeIndex(STAMPS)
    )
    assert fg.read(stamped, PLANT)[0].clock == Clock(CLOCK)
    filtered = frame[frame.t > 5]  # the index is a mere number
    np.testing.assert_array_equal(fg.read(filtered, PLANT)[0].t, whole["t"][whole["t"] > 5])


def test_units_of_frames_are_those_of_the_columns():
    pandas, pyarrow = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    frame = pandas.DataFrame(table())
    frame.attrs["units"] = {"x": "mm", "u": "V"}
    (run,) = fg.read(frame, PLANT)  # in m
    np.testing.assert_allclose(run.columns["x"], 1e-3 * table()["x"], rtol=1e-15)  # rounding
    fields = [pyarrow.field(n, pyarrow.float64(), metadata={"unit": "V"}) for n in table()]
    with pytest.raises(InputError, match=r"'x' is in 'V'.*no unit of the same"):
        fg.read(pyarrow.table(list(table().values()), pyarrow.schema(fields)), PLANT)


def test_several_sources_are_several_runs(tmp_path):
    (path,) = written(tmp_path, [table()])
    found = fg.read([path, table(), table(100)], PLANT)
    assert [run.name for run in found] == ["log0", "table", "table#2"]
    assert repr(found) == (
        "<3 runs: log0: 200 rows of u, x; table: 200 rows of u, x; table#2: 100 rows of u, x>"
    )


def test_maps_may_be_a_dict_or_one_text():
    wanted = fg.read(table(), PLANT)
    for maps in ({"u": "volts*2"}, "u=volts*2", ["u=volts*2"]):
        same(fg.read(RENAMED, PLANT, time="seconds", map=maps), wanted)


def test_runs_that_are_read_stay_as_they_are():
    runs = fg.read(table(), PLANT)
    same(fg.read(runs, PLANT), runs)
    same(fg.read(list(runs), PLANT), runs)
    assert isinstance(fg.read(runs[0], PLANT)[0], Run)
    with pytest.raises(InputError, match="these runs are read already"):
        fg.read(runs, PLANT, where="x > 0")


MATRIX = np.zeros((3, 3, 3))


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (42, "a int is no log; a log is a path, a data frame"),
        ([table(), None], "a NoneType is no log"),
        ([], "No log was given"),
        ({}, "table has no column"),
        ({"t": [0.0], "u": [1.0], "x": [1.0]}, r"table has 1 row\(s\)"),
        (table(199) | {"x": np.zeros(200)}, "column 't' has 199 samples, but 'x' has 200"),
        (table() | {"x": 3.0}, "column 'x': is no array of samples"),
        (table() | {"x": MATRIX}, "column 'x': is no array of samples"),
        (table() | {"x": ["high"] * 200}, "row 1, column 'x': 'high' is not a number"),
        (table() | {"x": np.full(200, np.inf)}, "row 1, column 'x': inf is not a finite"),
        ({"t": table()["t"], "x": table()["x"]}, "table has no column 'u'"),
    ],
)
def test_what_is_no_log_is_refused_in_one_sentence(source, said):
    with pytest.raises(InputError, match=said) as refused:
        fg.read(source, PLANT)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("lost", "said"),
    [
        ((), None),
        (("lower",), "table has no column 'lower', which the logs had"),
        (("upper", "lower"), "table has no columns 'upper' and 'lower', which the logs had"),
    ],
)
def test_an_output_that_the_fit_had_and_a_log_lacks_is_said(lost, said):
    """It may be a typing error in a header, and nothing else would tell."""
    model = calibrated(IN_A_ROW)
    samples = {name: of for name, of in log_of(model, 300).items() if name not in lost}
    warned = unlike_warnings(model, runs_for_model(model, samples, How()))
    assert len(warned) == (said is not None)
    assert all(each.startswith(said) and "--map" in each for each in warned)
