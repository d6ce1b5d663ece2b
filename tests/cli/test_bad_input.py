"""Whatever a user gets wrong: exit 2, one line on stderr that names it, nothing written."""

import os
import pickle
import shutil

import numpy as np
import pytest
import safetensors.numpy

import faultgauge.files
import faultgauge.identification.fit
from faultgauge.cli.app import ISSUES
from faultgauge.verbs.check import guessed
from faultgauge.verbs.how import How
from faultgauge.verbs.reading import runs_for_plant

NUL = b"\x00\x01\x02\xff\xfe" * 40


@pytest.fixture
def refuse(call, tmp_path):
    """Call, and check that it was refused in one line with all of `naming` and left nothing."""

    def refusing(*arguments, naming):
        before = {p: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
        said = call(*arguments)
        assert said.code == 2, said.err
        assert said.out == ""
        assert said.err.startswith("faultgauge: ")
        assert said.err.count("\n") == 1, said.err
        assert "Traceback" not in said.err
        for word in naming:
            assert str(word) in said.err
        assert {p: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before
        return said.err

    return refusing


@pytest.mark.parametrize("suffix", [".parquet", ".h5"])
def test_a_log_in_millimetres_for_plants_in_metres_and_in_volts(
    call, refuse, workshop, tmp_path, suffix
):
    t, u, x = np.loadtxt(workshop.healthy, delimiter=",", skiprows=1, unpack=True)
    log = tmp_path / f"log{suffix}"
    columns = {"t": (t, "s"), "u": (u, "V"), "x": (1000 * x, "mm")}
    if suffix == ".h5":
        h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
        with h5py.File(log, "w") as file:
            for name, (values, unit) in columns.items():
                file[name] = values
                file[name].attrs["unit"] = unit
    else:
        pyarrow = pytest.importorskip("pyarrow", reason="the extra io is not installed")
        parquet = pytest.importorskip("pyarrow.parquet")
        fields = [pyarrow.field(k, "double", metadata={"unit": v[1]}) for k, v in columns.items()]
        arrays = [values for values, _ in columns.values()]
        parquet.write_table(pyarrow.table(arrays, schema=pyarrow.schema(fields)), log)
    said = call("evaluate", workshop.model, log, "--json")
    assert "converted to the plant's units: 'x' from mm to m" in said.err
    plain = call("evaluate", workshop.model, workshop.healthy, "--json")
    found, expected = (outcome.json["outputs"]["x"]["nrmse"] for outcome in (said, plain))
    assert found == pytest.approx(expected, rel=1e-9)  # the rounding of x * 1000 * 0.001
    naming = (log, "column 'x'", "'mm'", "'V'", "no unit of the same", "--map 'x=x*1'")
    plant = tmp_path / "volts.toml"
    plant.write_text(workshop.plant.read_text().replace('unit = "m"', 'unit = "V"'))
    refuse("fit", plant, log, "--out", tmp_path / "m.fgm", naming=naming)


def test_a_suspect_log_in_millimetres_beside_a_healthy_one_in_metres(refuse, workshop, tmp_path):
    """The black box of `check` has the healthy log's units; a plant without units has none."""
    h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
    paths = []
    for name, unit, factor in (("healthy", "m", 1), ("suspect", "mm", 1000)):
        t, u, x = np.loadtxt(getattr(workshop, name), delimiter=",", skiprows=1, unpack=True)
        paths.append(tmp_path / f"{name}.h5")
        with h5py.File(paths[-1], "w") as file:
            for column, values in (("t", t), ("u", u), ("x", factor * x)):
                file[column] = values
            file["x"].attrs["unit"] = unit
    naming = (paths[1], "'x' is in 'mm'", "'m'", "--map 'x=x*0.001'")
    how = How()
    body = guessed(paths[0], how)
    (run,) = runs_for_plant(body.spec, paths[1], how)
    x = np.loadtxt(workshop.suspect, delimiter=",", skiprows=1, unpack=True)[2]
    np.testing.assert_allclose(run.columns["x"], x, rtol=1e-12)  # rounding
    plant = tmp_path / "bare.toml"
    plant.write_text(workshop.plant.read_text().replace('unit = "m"', ""))
    out = tmp_path / "m.fgm"
    refuse("fit", plant, *paths, "--out", out, naming=naming)
    refuse("fit", plant, paths[0], "--validate", paths[1], "--out", out, naming=naming)


def test_a_map_is_taken_as_it_is(call, workshop, tmp_path):
    h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
    t, u, x = np.loadtxt(workshop.healthy, delimiter=",", skiprows=1, unpack=True)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, values, unit in (("t", t * 1000, "ms"), ("u", u, "V"), ("x", 1000 * x, "mm")):
            file[name] = values
            file[name].attrs["unit"] = unit
    said = call("evaluate", workshop.model, tmp_path / "log.h5", "--map", "x=x*0.001", "--json")
    assert said.code == 0, said.err
    plain = call("evaluate", workshop.model, workshop.healthy, "--json")

    # the rounding of x * 1000 * 0.001 is all that differs
    found, expected = (outcome.json["outputs"]["x"]["nrmse"] for outcome in (said, plain))
    assert found == pytest.approx(expected, rel=1e-9)


def edited(workshop, change):
    """The lines of the healthy log after `change(lines)`, as text."""
    lines = workshop.healthy.read_text().splitlines()
    return "\n".join(change(lines)) + "\n"


def cell(row, column, text):
    def change(lines):
        cells = lines[row].split(",")
        cells[column] = text
        return [*lines[:row], ",".join(cells), *lines[row + 1 :]]

    return change


def column(index, text):
    def change(lines):
        rows = [line.split(",") for line in lines[1:]]
        return [lines[0], *(",".join([*r[:index], text, *r[index + 1 :]]) for r in rows)]

    return change


LOGS = {  # what is done to the healthy log, and what the refusal must name beside the file
    "missing column": (lambda lines: [line.rsplit(",", 1)[0] for line in lines], ["x"]),
    "text cell": (cell(7, 2, "high"), ["x", "high", "8"]),
    "inf cell": (cell(7, 1, "inf"), ["u", "inf", "8"]),
    "header only": (lambda lines: lines[:1], []),
    "one row": (lambda lines: lines[:2], []),
    "reversed time": (lambda lines: [lines[0], *reversed(lines[1:])], ["t"]),
    "duplicate time": (lambda lines: [*lines[:9], lines[8], *lines[9:]], ["t"]),
    "all-empty column": (column(2, ""), ["x"]),
    "no time": (lambda lines: ["clock,u,x", *lines[1:]], ["'t'", "--time"]),
    "row too long": (cell(7, 2, "1,2"), ["8"]),
    "one usable row": (
        lambda lines: [*column(2, "")(lines)[:7], lines[7], *column(2, "")(lines)[8:]],
        ["16 complete samples", "inspect"],
    ),
}


@pytest.mark.parametrize("case", LOGS)
def test_wrong_logs(refuse, workshop, tmp_path, case):
    change, naming = LOGS[case]
    log = tmp_path / "log.csv"
    log.write_text(edited(workshop, change))
    assert refuse("fit", workshop.plant, log, "--out", tmp_path / "m.fgm", naming=[log, *naming])


def test_no_excitation(refuse, workshop, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(edited(workshop, column(1, "0.5")))
    out = tmp_path / "m.fgm"
    assert refuse("fit", workshop.plant, log, "--out", out, naming=["input 'u'", "no excitation"])


@pytest.mark.parametrize("content", [b"", NUL], ids=["empty", "binary"])
@pytest.mark.parametrize("command", ["inspect", "fit", "evaluate", "calibrate", "estimate"])
def test_files_that_are_no_logs(refuse, workshop, tmp_path, command, content):
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_bytes(content)
    before = {"fit": [workshop.plant], "inspect": []}.get(command, [workshop.calibrated])
    after = [] if command in ("inspect", "evaluate") else ["--out", out]
    assert refuse(command, *before, log, *after, naming=[log])


def test_semicolons_are_read_or_refused_by_name(call, workshop, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(workshop.healthy2.read_text().replace(",", ";"))
    said = call("evaluate", workshop.model, log, "--json")
    if said.code == 0:
        plain = call("evaluate", workshop.model, workshop.healthy2, "--json").json
        assert said.json["outputs"] == plain["outputs"]
    else:
        assert said.code == 2
        assert str(log) in said.err
        assert said.err.count("\n") == 1


def test_missing_log(refuse, workshop, tmp_path):
    log = tmp_path / "absent.csv"
    assert refuse("evaluate", workshop.model, log, naming=[log])


PLANTS = {  # what is replaced in the plant file, by what, and what must be named
    "misspelt key": ("derivative =", "derivatve =", ["derivatve", "states.x"]),
    "unit is a number": ('unit = "V"', "unit = 5", ["inputs.u", "unit"]),
    "attribute access": ("b*u - a*x", "b.real*u - a*x", ["states.x", "derivative"]),
    "import": ("b*u - a*x", "__import__('os')", ["states.x", "derivative"]),
    "unknown name": ("b*u - a*x", "b*w - a*x", ["states.x", "w"]),
    "not TOML": ("[inputs.u]", "[inputs.u", []),
    "unknown section": ("[inputs.u]", "[input.u]", ["input"]),
    "fault without target": ('target = "x"', 'target = "z"', ["faults.leak", "z"]),
    "bandwidth negative": (
        "[parameters]", "[observer]\nbandwidth = -1\n\n[parameters]", ["observer", "bandwidth"]
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", PLANTS)
def test_wrong_plants(refuse, workshop, tmp_path, case):
    old, new, naming = PLANTS[case]
    text = workshop.plant.read_text()
    assert old in text
    plant = tmp_path / "wrong.toml"
    plant.write_text(text.replace(old, new, 1))
    out = tmp_path / "m.fgm"
    assert refuse("fit", plant, workshop.healthy, "--out", out, naming=[plant, *naming])


def test_missing_plant(refuse, workshop, tmp_path):
    plant = tmp_path / "absent.toml"
    out = tmp_path / "m.fgm"
    assert refuse("fit", plant, workshop.healthy, "--out", out, naming=["absent.toml"])


def truncated(model, data):
    model.write_bytes(data[: len(data) // 2])


def cut_by_one(model, data):
    model.write_bytes(data[:-1])


def number_altered(model, data):
    model.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))


def text_altered(model, data):
    assert b"tank" in data
    model.write_bytes(data.replace(b"tank", b"tonk", 1))


def foreign(model, data):
    model.write_bytes(safetensors.numpy.save({"weights": np.zeros(3)}))


def pickled(model, data):
    model.write_bytes(pickle.dumps({"weights": [1, 2, 3]}))


def emptied(model, data):
    model.write_bytes(b"")


DAMAGE = [truncated, cut_by_one, number_altered, text_altered, foreign, pickled, emptied]


@pytest.mark.parametrize("command", ["evaluate", "calibrate", "estimate"])
@pytest.mark.parametrize("damage", DAMAGE, ids=lambda f: f.__name__)
def test_wrong_models(refuse, workshop, tmp_path, damage, command):
    model, out = tmp_path / "model.fgm", tmp_path / "out.csv"
    damage(model, workshop.calibrated.read_bytes())
    after = [] if command == "evaluate" else ["--out", out]
    assert refuse(command, model, workshop.healthy2, *after, naming=[model])


def test_missing_model(refuse, workshop, tmp_path):
    model = tmp_path / "absent.fgm"
    assert refuse("evaluate", model, workshop.healthy, naming=[model, "fit"])


LONG = "x" * 300 + ".csv"
OPTIONS = {  # arguments (files by name), and what must be named
    "unknown option": (["evaluate", "model", "healthy", "--fast"], ["--fast"]),
    "unknown command": (["fitt", "plant", "healthy"], ["fitt"]),
    "missing argument": (["evaluate"], ["model"]),
    "missing log": (["evaluate", "model"], ["logs"]),
    "missing --out": (["fit", "plant", "healthy"], ["--out"]),
    "unknown observer": (
        ["estimate", "calibrated", "healthy", "--observer", "guess", "--out", "new.csv"], ["guess"]
    ),
    "unknown reference": (
        ["estimate", "calibrated", "healthy", "--reference", "guess", "--out", "new.csv"],
        ["guess", "--reference"],
    ),
    "unknown ending": (["estimate", "calibrated", "healthy", "--out", "new.xls"], [".xls", ".csv"]),
    "name too long": (["evaluate", "model", "healthy", "--report", LONG], ["too long for a file"]),
    "log's name too long": (["evaluate", "model", LONG], ["File name too long"]),
    "model's name too long": (["evaluate", LONG, "healthy"], ["File name too long"]),
    "folder's name too long": (
        ["export", "calibrated", "--to", "c", "--out", LONG], ["too long for a folder"]
    ),
    "a file for a folder": (
        ["export", "calibrated", "--to", "c", "--out", "healthy"], ["is a file", "--out"]
    ),
    "no folder": (["estimate", "calibrated", "healthy", "--out", "no/new.csv"], ["no/new.csv"]),
    "no folder, fit": (["fit", "plant", "healthy", "--out", "no/m.fgm"], ["no/m.fgm"]),
    "no report folder": (["evaluate", "model", "healthy", "--report", "no/r.html"], ["no/r.html"]),
    "mtbfa too long": (
        ["calibrate", "model", "healthy2", "--mtbfa", "1e9", "--out", "m.fgm"], ["1e+09", "mtbfa"]
    ),
    "mtbfa negative": (
        ["calibrate", "model", "healthy2", "--mtbfa", "-1", "--out", "m.fgm"], ["--mtbfa"]
    ),
    "map without =": (["evaluate", "model", "healthy", "--map", "x"], ["--map"]),
    "map of nothing": (["evaluate", "model", "healthy", "--map", "x=level*2"], ["level"]),
    "map syntax": (["evaluate", "model", "healthy", "--map", "x=u*(2"], ["--map", "u*(2"]),
    "map is code": (["evaluate", "model", "healthy", "--map", "x=open('f')"], ["--map"]),
    "warmup negative": (["evaluate", "model", "healthy", "--warmup", "-1"], ["--warmup", "0. See"]),
    "seed negative": (["fit", "plant", "healthy", "--seed", "-1", "--out", "m.fgm"], ["--seed"]),
    "seed is text": (["fit", "plant", "healthy", "--seed", "a", "--out", "m.fgm"], ["--seed"]),
    "unknown time": (["evaluate", "model", "healthy", "--time", "clock"], ["clock"]),
}  # fmt: skip


@pytest.mark.usefixtures("noise_once")
@pytest.mark.parametrize("case", OPTIONS)
def test_wrong_options(refuse, workshop, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    arguments, naming = OPTIONS[case]
    files = {name: getattr(workshop, name) for name in
             ("plant", "healthy", "healthy2", "model", "calibrated")}  # fmt: skip
    assert refuse(*(files.get(each, each) for each in arguments), naming=naming)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_that_may_not_be_written_to(refuse, workshop, tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    out = closed / "f.csv"
    assert refuse("estimate", workshop.calibrated, workshop.healthy, "--out", out, naming=[out])


def raising(error):
    def replacement(*args, **kwargs):
        raise error

    return replacement


def test_interrupted(call, workshop, tmp_path, monkeypatch):
    monkeypatch.setattr(faultgauge.identification.fit, "fit", raising(KeyboardInterrupt()))
    said = call("fit", workshop.plant, workshop.healthy, "--out", tmp_path / "m.fgm")
    assert said.code == 130
    assert said.out == ""
    assert said.err.startswith("faultgauge: interrupted")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("debug", [[], ["--debug"]], ids=["plain", "debug"])
def test_our_own_fault(call, workshop, tmp_path, monkeypatch, debug):
    monkeypatch.setattr(faultgauge.identification.fit, "fit", raising(RuntimeError("a\nbug")))
    said = call("fit", workshop.plant, workshop.healthy, "--out", tmp_path / "m.fgm", *debug)
    assert said.code == 1
    assert said.out == ""
    assert ISSUES in said.err
    assert "RuntimeError: a bug" in said.err
    assert ("Traceback" in said.err) == bool(debug)
    assert (said.err.count("\n") == 1) != bool(debug)
    assert list(tmp_path.iterdir()) == []


def test_debug_shows_where_wrong_input_was_found(call, workshop, tmp_path):
    said = call("evaluate", workshop.model, tmp_path / "absent.csv", "--debug")
    assert said.code == 2
    assert "Traceback" in said.err


@pytest.mark.usefixtures("noise_once")
@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize(
    ("error", "code"), [(OSError(28, "No space left on device"), 2), (KeyboardInterrupt(), 130)]
)
def test_a_write_that_fails_leaves_the_old_model_whole(
    call, workshop, tmp_path, monkeypatch, step, error, code
):
    model = tmp_path / "model.fgm"
    shutil.copy(workshop.model, model)
    monkeypatch.setattr(faultgauge.files.os, step, raising(error))
    said = call("calibrate", model, workshop.healthy2)
    assert said.code == code
    assert said.err.count("\n") == 1
    assert model.read_bytes() == workshop.model.read_bytes()
    assert list(tmp_path.iterdir()) == [model], "no draft stays behind"
