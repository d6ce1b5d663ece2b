"""What MATLAB and Simulink save: structures with time, sampling times, objects that stay closed."""

import struct
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from faultgauge.telemetry import inspect_runs, read_telemetry
from faultgauge.telemetry.readers import read_table

from .conftest import refusal

h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
pytest.importorskip("pymatreader", reason="the extra io is not installed")

DATA = Path(__file__).parents[1] / "data"
OBJECTS = ["pymatreader_datetime_v7.mat", "pymatreader_datetime_v7.3.mat"]
K = np.arange(50.0)


class V73:
    """Writes what MATLAB lays out in v7.3: HDF5 behind a header of 512 bytes, arrays transposed,
    a struct as a group, a struct array as references to its elements, field by field."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def save(self, content: dict) -> None:
        with h5py.File(self.path, "w", userblock_size=512) as file:
            self.elements = file.create_group("#refs#")
            for name, value in content.items():
                self.add(file, name, value)
        with self.path.open("r+b") as file:
            text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64"
            file.write(text.ljust(124) + struct.pack("<H2s", 0x0200, b"IM"))

    def add(self, group, name: str, value) -> None:
        if isinstance(value, dict):
            group.create_group(name).attrs["MATLAB_class"] = np.bytes_("struct")
            for field, item in value.items():
                self.add(group[name], field, item)
        elif isinstance(value, list):
            group.create_group(name).attrs["MATLAB_class"] = np.bytes_("struct")
            for field in value[0]:
                references = np.array([[self.element(item[field])] for item in value], object)
                group[name].create_dataset(field, data=references, dtype=h5py.ref_dtype)
        elif isinstance(value, str):
            codes = np.array([[ord(c)] for c in value], np.uint16)
            group[name] = codes if value else np.zeros(2, np.uint64)
            group[name].attrs["MATLAB_class"] = np.bytes_("char")
            if not value:
                group[name].attrs["MATLAB_empty"] = np.uint8(1)
        else:
            group[name] = np.atleast_2d(value).T
            group[name].attrs["MATLAB_class"] = np.bytes_("double")

    def element(self, value):
        name = f"e{len(self.elements)}"
        self.add(self.elements, name, value)
        return self.elements[name].ref


def save(path: Path, version: str, content: dict) -> Path:
    """`content` as a `.mat`: v5 by SciPy, v7.3 by h5py; a list of dicts is a struct array."""
    if version == "v7.3":
        V73(path).save(content)
        return path

    def converted(value):
        if isinstance(value, dict):
            return {name: converted(item) for name, item in value.items()}
        if not isinstance(value, list):
            return value
        array = np.zeros(len(value), [(field, object) for field in value[0]])
        for k, item in enumerate(value):
            array[k] = tuple(item.values())
        return array

    scipy.io.savemat(path, converted(content))
    return path


def signal(values: np.ndarray, label: str) -> dict:
    """An element of `signals` as Simulink's To Workspace and Scope blocks fill it."""
    width = np.array([[float(values.shape[1])]])
    style = np.zeros((1, 2))
    return {"values": values, "dimensions": width, "label": label, "title": "", "plotStyle": style}


def of_simulink(signals) -> dict:
    return {"time": K[:, None] / 100, "signals": signals, "blockName": "rig/Scope"}


@pytest.mark.parametrize("version", ["v5", "v7.3"])
def test_structure_with_time(tmp_path, version):
    column = K[:, None]
    several = [
        signal(column, "u"),
        signal(np.hstack([2 * column, 3 * column]), "pose"),
        signal(4 * column, ""),
        signal(5 * column, "twice"),
        signal(6 * column, "twice"),
    ]
    content = {
        "log": of_simulink(several),
        "one": of_simulink(signal(7 * column, "y")),
        "bare": of_simulink(signal(8 * column, "")) | {"extra": 9 * column},
    }
    table = read_table(save(tmp_path / "log.mat", version, content))
    found = {name: cells[1] for name, cells in table.columns.items()}  # at k = 1
    assert found == {
        "log.time": 0.01, "log.u": 1, "log.pose_0": 2, "log.pose_1": 3,
        "log.signals.values.2": 4, "log.signals.values.3": 5, "log.signals.values.4": 6,
        "one.time": 0.01, "one.y": 7, "bare.time": 0.01, "bare.signals.values": 8,
        "bare.extra": 9,
    }  # fmt: skip
    if version == "v7.3":  # pymatreader has them in another order every time
        assert list(found) == sorted(found)
    (run,) = read_telemetry(tmp_path / "log.mat", time="log.time", names=["log_u"])
    np.testing.assert_array_equal(run.t, K / 100)
    np.testing.assert_array_equal(run.columns["log_u"], K)


@pytest.mark.parametrize("version", ["v5", "v7.3"])
def test_fields_time_and_data(tmp_path, version):
    content = {"ts": {"Time": K[:, None] / 100, "Data": np.stack([K, -K], axis=1)}}
    table = read_table(save(tmp_path / "log.mat", version, content))
    assert set(table.columns) == {"ts.Time", "ts.Data_0", "ts.Data_1"}
    assert "--time ts.Time" in refusal(tmp_path / "log.mat")
    (run,) = read_telemetry(tmp_path / "log.mat", time="ts.Time", names=["ts_Data_1"])
    np.testing.assert_array_equal(run.t, K / 100)
    np.testing.assert_array_equal(run.columns["ts_Data_1"], -K)


@pytest.mark.parametrize("version", ["v5", "v7.3"])
@pytest.mark.parametrize(
    ("scalars", "step"),
    [
        ({"Ts": 4.0}, 4),
        ({"dt": 0.25}, 0.25),
        ({"fs": 8.0}, 0.125),
        ({"set": {"Fs": 8.0}, "Ts": 0.125}, 0.125),  # the same, said twice
    ],
)
def test_a_sampling_time_in_the_place_of_a_time(tmp_path, version, scalars, step):
    content = {"u": K[:, None], "y": -K[:, None], "gain": 7.0} | scalars
    path = save(tmp_path / "log.mat", version, content)
    (run,) = read_telemetry(path)
    np.testing.assert_array_equal(run.t, step * K)  # steps that are exact in binary
    np.testing.assert_array_equal(run.columns["y"], -K)
    hint = f"{path} has no time: t is made in steps of {step} s, from "
    assert any(each.startswith(hint) for each in inspect_runs(path).hints)
    (run,) = read_telemetry(path, time="u", names=["y"])  # the user's own choice goes first
    np.testing.assert_array_equal(run.t, K)
    (run,) = read_telemetry(path, maps=["t=u/2"], names=["y"])
    np.testing.assert_array_equal(run.t, K / 2)


def test_a_time_in_the_file_is_not_replaced(tmp_path):
    content = {"tout": K[:, None] ** 2, "u": -K[:, None], "Ts": 0.5}
    path = save(tmp_path / "log.mat", "v5", content)
    assert set(read_table(path).columns) == {"tout", "u"}
    assert "--time tout" in refusal(path)


@pytest.mark.parametrize(
    "scalars", [{}, {"Ts": 0.5, "Fs": 3.0}, {"Ts": -1.0}, {"dt": np.inf}, {"gain": 2.0}]
)
def test_no_time_and_no_sampling_time(tmp_path, scalars):
    path = save(tmp_path / "log.mat", "v5", {"u": -K[:, None], "y": K[::-1, None]} | scalars)
    message = refusal(path)
    assert "has no time column 't'" in message
    assert "its step Ts in s" in message


@pytest.mark.parametrize("name", OBJECTS)
def test_objects_of_matlab_classes_are_named(tmp_path, name):
    """MATLAB stores a timeseries as it stores these: a reference into data of its own."""
    message = refusal(DATA / name)
    assert "timeseries" in message
    assert "here date_time_and_time_zone, date_time_only;" in message
    assert "t = date_time_and_time_zone.Time; y = date_time_and_time_zone.Data" in message


def test_objects_beside_vectors_are_left_out(tmp_path):
    # A v5 file is a header of 128 bytes and then one variable after the other.
    scipy.io.savemat(tmp_path / "vectors.mat", {"t": K[:, None] / 100, "u": K[:, None]})
    objects = (DATA / OBJECTS[0]).read_bytes()[128:]
    path = tmp_path / "v5.mat"
    path.write_bytes((tmp_path / "vectors.mat").read_bytes() + objects)
    table = read_table(path)
    assert set(table.columns) == {"t", "u"}
    assert "here date_time_and_time_zone, date_time_only;" in table.notes[0]

    path = tmp_path / "v7.3.mat"
    path.write_bytes((DATA / OBJECTS[1]).read_bytes())
    with h5py.File(path, "r+") as file:
        for name, values in {"t": K / 100, "u": K}.items():
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    table = read_table(path)
    assert set(table.columns) == {"t", "u"}
    assert "here date_time_and_time_zone, date_time_only;" in table.notes[0]
