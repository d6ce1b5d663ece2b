"""What is no fleet: one sentence, exit 2, and nothing written."""

import gzip
from importlib.util import find_spec

import pytest

from faultgauge.cli.app import run
from faultgauge.errors import InputError
from faultgauge.fleet.units import units_in

from .conftest import PLANT, write_log


@pytest.fixture
def folder(tmp_path):
    for k in range(2):
        write_log(tmp_path / "logs" / f"tank{k}.csv", k, 0.8, 2.5, count=20)
    (tmp_path / "plant.toml").write_text(PLANT)
    return tmp_path


def refused(capsys, folder, *more):
    """The sentence that refuses to fit."""
    call = ["fit", folder / "plant.toml", folder / "logs", "--fleet", "--out", folder / "out"]
    assert run([str(each) for each in [*call, *more]]) == 2
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0
    assert "Traceback" not in said
    assert not (folder / "out" / "units").exists()
    assert not (folder / "out" / "fleet.fgm").exists()
    return said


def test_a_foreign_file(folder, capsys):
    (folder / "logs" / "readme.pdf").write_bytes(b"%PDF")
    assert "readme.pdf: is no log" in refused(capsys, folder)


def test_a_folder_without_a_log(folder, capsys):
    (folder / "logs" / "more").mkdir()
    assert "more: holds no log" in refused(capsys, folder)


def test_two_units_of_one_name(folder, capsys):
    data = (folder / "logs" / "tank1.csv").read_bytes()
    (folder / "logs" / "Tank1.csv.gz").write_bytes(gzip.compress(data))
    said = refused(capsys, folder)
    assert "Tank1.csv.gz" in said
    assert "tank1.csv" in said
    assert "both of unit" in said


def test_a_single_file_without_units(folder):
    with pytest.raises(InputError, match="has no column 'unit'"):
        units_in([folder / "logs" / "tank0.csv"])


def test_results_among_the_logs(folder, capsys):
    assert "all is log of a unit" in refused(capsys, folder, "--out", folder / "logs" / "out")


def test_all_units_fail(folder, capsys):
    for path in (folder / "logs").iterdir():
        path.write_text("t,u,x\n0,1,one\n1,2,two\n")
    assert "'one' is not a number" in refused(capsys, folder)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--seeds", "3"], "--seeds does not go with --fleet"),
        (["--from", "plant.toml"], "a plant file, and no model yet"),
        (["--scheduler", "tcp://127.0.0.1:1"], "--scheduler"),
    ],
)
def test_options_that_cannot_be_met(folder, capsys, monkeypatch, more, said):
    monkeypatch.chdir(folder)
    assert said in refused(capsys, folder, *more)


def test_options_of_a_fleet_alone(folder, capsys):
    call = ["fit", folder / "plant.toml", folder / "logs", "--out", folder / "m.fgm", "--again"]
    assert run([str(each) for each in call]) == 2
    assert "give --fleet, too" in capsys.readouterr().err


def test_dask_is_named_where_it_is_absent(folder, capsys):
    if find_spec("distributed"):
        pytest.skip("dask is installed here.")
    assert "pip install faultgauge[dask]" in refused(capsys, folder, "--scheduler", "local")


def test_units_by_a_column(tmp_path):
    """Two units whose rows take turns in one file."""
    a = write_log(tmp_path / "a.csv", 0, 0.8, 2.5, count=20, unit="7")
    b = write_log(tmp_path / "b.csv", 1, 0.8, 2.5, count=20, unit="12")
    both = [row for pair in zip(a, b, strict=True) for row in pair]
    (tmp_path / "both.csv").write_text("unit,t,u,x\n" + "".join(both))
    seven, twelve = sorted(units_in([tmp_path / "both.csv"]), key=lambda unit: float(unit.name))
    assert (seven.name, twelve.name) == ("7", "12")
    assert seven.source.columns["x"].tolist() == [float(row.split(",")[-1]) for row in a]
    assert "unit" not in seven.source.columns


@pytest.mark.parametrize("name", ["a/b", ".hidden", "", "x" * 101])
def test_names_that_no_file_can_have(tmp_path, name):
    rows = "".join(f'"{name}",{k},0,0\n' for k in range(3))
    (tmp_path / "log.csv").write_text("unit,t,u,x\n" + rows)
    with pytest.raises(InputError, match=r"is no name of a unit|is empty"):
        units_in([tmp_path / "log.csv"])
