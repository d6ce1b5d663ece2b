"""Splits are those of the official loader; files of the data folder are read as they stand."""

import gzip

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge_studies.published import data
from faultgauge_studies.published.benchmark import BENCHMARKS, benchmark, plant_of, records


@pytest.fixture
def offline(monkeypatch, data_dir):
    """The data folder alone: no test of ours downloads anything."""
    monkeypatch.setenv("FAULTGAUGE_DATA", str(data_dir))
    monkeypatch.setattr(data, "_loaded", lambda name: None)


@pytest.fixture
def official(monkeypatch):
    """`official(NAME, mat) -> (train, test)`: its own split of what stands in `mat`."""
    loader = pytest.importorskip("nonlinear_benchmarks.benchmarks", reason="peers extra absent")

    def split(name, mat):
        monkeypatch.setattr(loader, "cashed_download", lambda *a, **k: "")
        monkeypatch.setattr(loader, "loadmat", lambda path: mat)
        return getattr(loader, name)()

    return split


def same(run, theirs, output="y"):
    """Exactly the official samples: both cut the same arrays."""
    np.testing.assert_array_equal(run.columns["u"], theirs.u)
    np.testing.assert_array_equal(run.columns[output], theirs.y)
    # steps are 1/fs, summed up over the run: 1e-9 of it is rounding
    assert run.step == pytest.approx(float(theirs.sampling_time), rel=1e-9)


def test_silverbox_is_split_as_its_loader_does(offline, official):
    whole = data.silverbox()["whole"]
    train, (multisine, arrow, inside) = official("Silverbox", {"V1": [whole.u], "V2": [whole.y]})
    held = records(BENCHMARKS["silverbox"])
    same(held.train[0], train)
    for split, theirs in zip(held.splits, (arrow, inside, multisine), strict=True):
        same(split.test, theirs)
        assert split.window == theirs.state_initialization_window_length


def test_wiener_hammerstein_has_the_stated_split_and_the_loaders_test_inside(offline, official):
    whole = data.wiener_hammerstein()["whole"]
    mat = {
        "uBenchMark": whole.u[:, None],
        "yBenchMark": whole.y[:, None],
        "fs": np.array([[51200.0]]),
    }
    _, theirs = official("WienerHammerBenchMark", mat)
    held = records(BENCHMARKS["wiener_hammerstein_2009"])
    last, steady = held.splits
    np.testing.assert_array_equal(held.train[0].columns["y"], whole.y[:100000])
    np.testing.assert_array_equal(last.test.columns["y"], whole.y[-88000:])
    same(steady.test, theirs)
    assert last.window == steady.window == theirs.state_initialization_window_length


def test_tanks_and_emps_use_the_loaders_windows(offline, official):
    found = data.tanks()
    mat = {
        f"{signal}{part}": getattr(found[name], signal)[:, None]
        for signal in "uy"
        for part, name in (("Est", "train"), ("Val", "test"))
    }
    train, test = official("Cascaded_Tanks", {**mat, "Ts": np.array([[4.0]])})
    held = records(BENCHMARKS["cascaded_tanks"])
    same(held.train[0], train)
    for split in held.splits:
        same(split.test, test)
    windows = [split.window for split in held.splits]
    assert windows == [test.state_initialization_window_length, 5]
    emps = records(BENCHMARKS["emps"])
    assert [split.window for split in emps.splits] == [20]  # EMPS() of nonlinear_benchmarks 1.0.1


def test_no_test_run_of_the_drone_is_fitted_on(offline):
    held = records(BENCHMARKS["quarter_drone"])
    fitted = {run.content_hash for run in held.train}
    assert len(fitted) == 4
    assert not fitted & {split.test.content_hash for split in held.splits}
    for split in held.splits:
        np.testing.assert_allclose(np.diff(split.test.t), 0.01, rtol=1e-9)


def test_a_recording_is_put_on_a_grid_with_the_input_held(tmp_path, monkeypatch):
    folder = tmp_path / "quarter_drone"
    folder.mkdir()
    for file, time in data.DRONE.values():
        factor = 1000 if time == "t_ms/1000" else 1
        rows = [(0.0, 0, 1.0), (0.02, 2, 3.0), (0.03, 4, 5.0), (0.04, 6, 7.0)]
        column = time.split("/")[0]
        lines = [f"{column},angle_deg,u_pct", *(f"{t * factor:g},{y},{u}" for t, y, u in rows)]
        (folder / f"{file}.csv.gz").write_bytes(gzip.compress("\n".join(lines).encode()))
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    for found in data.quarter_drone().values():
        # by hand: at 0.01 s the last command was 1, the angle lies midway between 0 and 2
        np.testing.assert_array_equal(found.u, [1, 1, 3, 5, 7])
        np.testing.assert_allclose(found.y, [0, 1, 2, 4, 6], atol=1e-12)  # times are rounded


def test_absent_data_are_said_in_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    monkeypatch.setattr(data, "_loaded", lambda name: None)
    for each in BENCHMARKS.values():
        with pytest.raises(InputError, match="FAULTGAUGE_DATA"):
            records(each)


def test_a_broken_archive_is_named(tmp_path, monkeypatch):
    (tmp_path / "silverbox").mkdir()
    (tmp_path / "silverbox" / "SNLS80mV.npz").write_bytes(b"not a zip")
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    monkeypatch.setattr(data, "_loaded", lambda name: None)
    with pytest.raises(InputError, match=r"SNLS80mV\.npz"):
        data.silverbox()


def test_a_host_that_cannot_be_reached_leaves_the_folder(monkeypatch):
    pytest.importorskip("nonlinear_benchmarks", reason="peers extra absent")

    def refuse(*arguments):
        raise OSError("no network")

    monkeypatch.setattr(data.socket, "create_connection", refuse)
    assert data._loaded("EMPS") is None


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_plant_file_is_short_and_clean(name):
    plant = plant_of(benchmark(name))
    assert len(plant.spec.text.splitlines()) <= 25
    assert not plant.spec.warnings
    assert BENCHMARKS[name].output in plant.signals.output_names


def test_an_unknown_name_is_refused_with_the_legal_ones():
    with pytest.raises(InputError, match="silverbox"):
        benchmark("silver_box")
