"""Files of other tools: what they hold is known, what is wrong with them is said in a sentence."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import inspect_runs, read_telemetry, segments
from faultgauge.telemetry.readers import READERS, read_table
from faultgauge.telemetry.readers.csv import read_csv
from faultgauge.telemetry.readers.excel import EXCEL_FILES

from .conftest import refusal

DATA = Path(__file__).parents[1] / "data"
I = np.arange(50.0)  # noqa: E741  (the row number, as the README of the folder has it)
BINARY = [suffix for suffix, reader in READERS.items() if reader is not read_csv]
EXTRA = [suffix for suffix in BINARY if suffix not in EXCEL_FILES]  # by packages of `io`


def test_parquet_of_duckdb():
    table = read_table(DATA / "duckdb.parquet")
    assert list(table.columns) == ["stamp", "u", "n", "d", "flag", "mode", "pose.x", "pose.y"]
    # The stamps are integers of a microsecond: only their scaling to seconds rounds.
    np.testing.assert_allclose(table.columns["stamp"], I / 100, rtol=1e-15)
    np.testing.assert_array_equal(table.columns["u"], I / 2 - 3)
    np.testing.assert_array_equal(table.columns["n"], np.where(I % 7 == 3, np.nan, I))
    np.testing.assert_array_equal(table.columns["d"], I / 4)
    np.testing.assert_array_equal(table.columns["flag"], I % 2 == 0)
    np.testing.assert_array_equal(table.columns["pose.x"], 2 * I)
    assert table.columns["mode"].tolist() == ["idle"] * 25 + ["run"] * 25
    assert "pair" in table.notes[0]


def test_parquet_time_nested_names_and_units(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="the extra io is not installed")
    parquet = pytest.importorskip("pyarrow.parquet")

    unit = {b"unit": b"rad/s"}
    schema = pyarrow.schema(
        [
            pyarrow.field("t", pyarrow.timestamp("ns", tz="Europe/Berlin")),
            pyarrow.field("w", pyarrow.float32(), metadata=unit),
            pyarrow.field("kind", pyarrow.dictionary(pyarrow.int8(), pyarrow.string())),
        ]
    )
    start = 1_800_000_000_000_000_000  # ns: float64 is good to 256 of them here
    rows = {"t": [start, start + 1, start + 3], "w": [0.5, None, 2.5], "kind": ["a", None, "b"]}
    parquet.write_table(pyarrow.table(rows, schema=schema), tmp_path / "log.parquet")
    table = read_table(tmp_path / "log.parquet")
    np.testing.assert_allclose(table.columns["t"], [0, 1e-9, 3e-9], rtol=1e-15)
    np.testing.assert_array_equal(table.columns["w"], [0.5, np.nan, 2.5])
    assert table.columns["kind"].tolist() == ["a", "", "b"]
    assert table.units == {"w": "rad/s"}


def test_mat_of_matlab_takes_what_is_sampled_together():
    table = read_table(DATA / "testmulti_7.4_GLNX86.mat")
    assert [table.columns[f"a_{k}"].tolist() for k in range(3)] == [
        [1, 2, 3, 4, 5],
        [2, 0, 0, 0, 0],
        [3, 0, 0, 0, 0],
    ]
    assert "theta (9)" in table.notes[0]


def test_mat_of_matlab_in_v73():
    table = read_table(DATA / "testhdf5_7.4_GLNX86.mat")
    # MATLAB printed pi to the last bit; the multiples may round otherwise by one.
    np.testing.assert_allclose(table.columns["testdouble"], np.arange(9) * np.pi / 4, rtol=3e-16)


@pytest.mark.parametrize("version", ["v5", "v7.3"])
def test_mat_structs_cells_and_text(tmp_path, version):
    path = tmp_path / "log.mat"
    column = I[:, None]
    content = {
        "rig": {"time": column / 100, "speed": column.astype(np.int16), "on": column > 25},
        "gain": 2.5,
        "acc": np.hstack([column, 2 * column]),
    }
    if version == "v5":
        import scipy.io

        scipy.io.savemat(path, content | {"mode": np.array(["a", "b"] * 25, dtype=object)})
    else:
        hdf5storage = pytest.importorskip("hdf5storage", reason="the extra io is not installed")
        hdf5storage.savemat(str(path), content, format="7.3", store_python_metadata=False)
    table = read_table(path)
    np.testing.assert_array_equal(table.columns["rig.time"], I / 100)
    np.testing.assert_array_equal(table.columns["rig.speed"], I)
    np.testing.assert_array_equal(table.columns["rig.on"], I > 25)
    np.testing.assert_array_equal(table.columns["acc_1"], 2 * I)
    assert "gain" not in table.columns
    if version == "v5":
        assert table.columns["mode"].tolist() == ["a", "b"] * 25
    (run,) = read_telemetry(path, time="rig_time", maps=["w=rig_speed*2"], names=["w"])
    np.testing.assert_array_equal(run.columns["w"], 2 * I)


def test_hdf5_of_pytables():
    table = read_table(DATA / "pytables.h5")
    np.testing.assert_array_equal(table.columns["rig/time"], I / 100)
    np.testing.assert_array_equal(table.columns["rig/speed"], I / 2)
    np.testing.assert_array_equal(table.columns["rig/acc_2"], 3 * (I / 100))
    assert table.columns["rig/label"].tolist() == ["a", "b"] * 25
    assert table.units["rig/acc_0"] == "m/s^2"
    assert "calibration (7)" in table.notes[0]
    assert "gain" not in table.columns


def test_hdf5_compound_dataset_and_text(tmp_path):
    h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
    with h5py.File(tmp_path / "log.hdf5", "w") as file:
        records = np.zeros(3, dtype=[("t", "f8"), ("u", "i4")])
        records["t"], records["u"] = [0, 0.5, 1], [7, 8, 9]
        file["log"] = records
        file["mode"] = ["a", "bü", "c"]
        file["empty"] = h5py.Empty("f8")
    table = read_table(tmp_path / "log.hdf5")
    assert table.columns["log/t"].tolist() == [0, 0.5, 1]
    assert table.columns["log/u"].tolist() == [7, 8, 9]
    assert table.columns["mode"].tolist() == ["a", "bü", "c"]


@pytest.mark.parametrize("name", ["mdfreader.mf4", "mdfreader.mdf"])
def test_mdf_of_mdfreader(name):
    table = read_table(DATA / name)
    assert set(table.columns) == {"t", "speed", "gear", "oil"}
    np.testing.assert_array_equal(table.columns["t"], I / 100)
    np.testing.assert_array_equal(table.columns["speed"], I / 2)
    np.testing.assert_array_equal(table.columns["gear"], I // 10)
    slow = np.full(50, np.nan)
    slow[::10] = 80 + np.arange(5)
    np.testing.assert_array_equal(table.columns["oil"], slow)
    assert table.units == {"t": "s", "speed": "rad/s", "oil": "degC"}


def test_mdf_text_invalid_samples_and_repeated_names(tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="the extra io is not installed")
    t = np.array([0.5, 1.0, 1.5])
    texts = {"val_0": 0, "val_1": 1, "text_0": b"off", "text_1": b"on", "default": b"?"}
    mode = asammdf.Signal(np.array([0, 1, 1]), t, name="mode", conversion=texts)
    invalid = np.array([False, True, False])
    speed = asammdf.Signal(np.array([1.0, 2.0, 3.0]), t, name="speed", invalidation_bits=invalid)
    with asammdf.MDF(version="4.10") as file:
        file.append([mode, speed])
        file.append([asammdf.Signal(np.array([7, 8]), t[:2], name="speed")])
        file.save(tmp_path / "log.mf4")
    table = read_table(tmp_path / "log.mf4")
    assert table.columns["t"].tolist() == [0.5, 1, 1.5]  # as the measurement has it, not from 0
    assert table.columns["mode"].tolist() == ["off", "on", "on"]
    np.testing.assert_array_equal(table.columns["speed.0"], [1, np.nan, 3])
    np.testing.assert_array_equal(table.columns["speed.1"], [7, 8, np.nan])


def test_mcap_of_rosbags():
    table = read_table(DATA / "rosbags.mcap")
    # Stamps of /imu and log times of the rest coincide: 50 rows, 10 ms apart, exact in ns.
    np.testing.assert_array_equal(table.columns["t"], np.arange(50) * 10_000_000 / 1e9)
    np.testing.assert_array_equal(table.columns["imu.angular_velocity.x"], I / 2)
    np.testing.assert_array_equal(table.columns["imu.angular_velocity.z"], -I)
    np.testing.assert_array_equal(table.columns["imu.linear_acceleration.z"], 9.81)
    np.testing.assert_array_equal(table.columns["imu.orientation_covariance_8"], 0)
    speed = table.columns["robot/cmd_vel.linear.x"]
    np.testing.assert_array_equal(speed[::10], 0.1 * I[::10])
    assert np.isnan(speed).sum() == 45
    assert [table.columns["mode.data"][k] for k in (0, 1, 25)] == ["idle", "", "run"]
    assert not [name for name in table.columns if "header" in name]


def write_mcap(path: Path, messages) -> Path:
    """Messages (topic, log time in ns, content or bytes) in JSON; bytes as an unknown encoding."""
    writer_of = pytest.importorskip("mcap.writer", reason="the extra io is not installed")
    with path.open("wb") as file:
        writer = writer_of.Writer(file)
        writer.start()
        channels = {}
        for topic, stamp, content in messages:
            known = not isinstance(content, bytes)
            if topic not in channels:
                encoding = "json" if known else "protobuf"
                channels[topic] = writer.register_channel(topic, encoding, schema_id=0)
            data = json.dumps(content).encode() if known else content
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    return path


def test_mcap_json_out_of_order_and_with_what_is_not_read(tmp_path):
    second = 1_000_000_000
    path = write_mcap(
        tmp_path / "log.mcap",
        [
            (
                "/a",
                2 * second,
                {"u": 2, "name": "two", "list": [1, 2], "none": None, "scan": [0] * 360},
            ),
            ("/a", 1 * second, {"u": 1.5, "on": True}),
            ("/a", 2 * second, {"u": 3}),
            ("/image", 1 * second, b"\0\1"),
        ],
    )
    table = read_table(path)
    assert table.columns["t"].tolist() == [0, 1]
    assert table.columns["a.u"].tolist() == [1.5, 3]
    np.testing.assert_array_equal(table.columns["a.on"], [1, np.nan])
    assert "/image (protobuf)" in table.notes[0]
    assert "/a: 1 message" in table.notes[1]
    assert "scan" in table.notes[2]
    np.testing.assert_array_equal(table.columns["a.list_1"], [np.nan, np.nan])
    path = write_mcap(tmp_path / "image.mcap", [("/image", second, b"\0")])
    assert "only /image (protobuf)" in refusal(path)


def test_mcap_header_stamps_of_another_clock_are_not_time(tmp_path):
    second = 1_000_000_000
    stamps = [{"header": {"stamp": {"sec": k, "nsec": 0}}, "u": k} for k in range(3)]  # since boot
    path = write_mcap(
        tmp_path / "log.mcap",
        [("/a", (100 + 2 * k) * second, message) for k, message in enumerate(stamps)],
    )
    assert read_table(path).columns["t"].tolist() == [0, 2, 4]


def test_channels_of_other_rates_make_complete_rows():
    (run,) = read_telemetry(DATA / "mdfreader.mf4", names=["speed", "oil"])
    np.testing.assert_array_equal(run.columns["speed"], I / 2)
    # 80 + 10 t to the last sample at 0.4 s; interpolation rounds in the last bits
    np.testing.assert_allclose(run.columns["oil"][:41], 80 + I[:41] / 10, rtol=1e-14)
    assert np.isnan(run.columns["oil"][41:]).all()
    (run,) = read_telemetry(DATA / "mdfreader.mf4", names=["speed", "oil"], held=["oil"])
    np.testing.assert_array_equal(run.columns["oil"][:41], 80 + I[:41] // 10)


def test_inspection_shows_units_and_what_was_left_out():
    report = inspect_runs(DATA / "mdfreader.mf4")
    assert {c.name: c.unit for c in report.columns} == {
        "speed": "rad/s",
        "gear": "",
        "oil": "degC",
    }
    assert any("'oil' has a sample every 0.1 s" in hint for hint in report.hints)
    report = inspect_runs(DATA / "pytables.h5", time="rig/time")
    assert any("calibration (7)" in hint for hint in report.hints)


def with_units(path: Path, columns: dict[str, tuple[np.ndarray, str]]) -> Path:
    """A file of `columns` {name: (values, unit)}, by the package's own writer."""
    if path.suffix == ".h5":
        h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
        with h5py.File(path, "w") as file:
            for name, (values, unit) in columns.items():
                file[name] = values
                file[name].attrs["units"] = unit
    elif path.suffix == ".parquet":
        pyarrow = pytest.importorskip("pyarrow", reason="the extra io is not installed")
        parquet = pytest.importorskip("pyarrow.parquet")
        fields = [
            pyarrow.field(name, pyarrow.array(values).type, metadata={"unit": unit})
            for name, (values, unit) in columns.items()
        ]
        arrays = [pyarrow.array(values) for values, _ in columns.values()]
        table = pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields))
        parquet.write_table(table, path)
    else:
        asammdf = pytest.importorskip("asammdf", reason="the extra io is not installed")
        signals = [
            asammdf.Signal(values, np.arange(len(values)) * 7.0, name=name, unit=unit)
            for name, (values, unit) in columns.items()
        ]
        with asammdf.MDF(version="4.10") as file:
            file.append(signals)
            file.save(path)
    return path


@pytest.mark.parametrize(
    ("unit", "times", "seconds"),
    [
        ("s", [1.0, 2.0, 3.5], [1, 2, 3.5]),
        ("ms", [10.0, 20.0, 35.0], [0.01, 0.02, 0.035]),
        ("us", [3.0, 5.0, 8.0], [3e-6, 5e-6, 8e-6]),
        ("ns", [3e9, 5e9, 8e9], [3, 5, 8]),
        ("min", [0.5, 1.0, 3.0], [30, 60, 180]),
        ("h", [0.0, 1.0, 1.5], [0, 3600, 5400]),
        ("Milliseconds since 2026-01-01", [1.0, 2.0, 4.0], [0.001, 0.002, 0.004]),
        ("V", [1.0, 2.0, 3.0], [1, 2, 3]),  # no unit of time: as without one
        ("ticks", [1.0, 2.0, 3.0], [1, 2, 3]),
    ],
)
@pytest.mark.parametrize("suffix", [".h5", ".parquet", ".mf4"])
def test_time_in_the_unit_that_the_file_gives(tmp_path, suffix, unit, times, seconds):
    columns = {"clock": (np.array(times), unit), "u": (np.arange(3.0), "V")}
    path = with_units(tmp_path / f"log{suffix}", columns)
    (run,) = read_telemetry(path, time="clock", names=["u"])
    np.testing.assert_array_equal(run.t, seconds)
    np.testing.assert_array_equal(run.columns["u"], [0, 1, 2])


@pytest.mark.parametrize("suffix", [".h5", ".parquet"])
def test_a_column_t_in_milliseconds(tmp_path, suffix):
    columns = {"t": (np.array([10.0, 20, 30]), "ms"), "u": (np.arange(3.0), "V")}
    path = with_units(tmp_path / f"log{suffix}", columns)
    (run,) = read_telemetry(path, names=["u"])
    np.testing.assert_array_equal(run.t, [0.01, 0.02, 0.03])
    (run,) = read_telemetry(path, names=["u"], where="t > 0.015")  # in seconds there, too
    np.testing.assert_array_equal(run.t, [0.02, 0.03])
    (run,) = read_telemetry(path, names=["u"], maps=["t=t/100"])  # the user's own business
    np.testing.assert_array_equal(run.t, [0.1, 0.2, 0.3])


def test_time_stamps_of_parquet_are_converted_once(tmp_path):
    stamps = np.array([0, 10, 20], dtype="datetime64[ms]")
    columns = {"t": (stamps, "ms"), "u": (np.arange(3.0), "V")}
    (run,) = read_telemetry(with_units(tmp_path / "log.parquet", columns))
    np.testing.assert_array_equal(run.t, [0, 0.01, 0.02])


@pytest.mark.parametrize("suffix", [".h5", ".parquet", ".mf4"])
def test_a_column_in_another_unit_than_the_plant(tmp_path, suffix):
    columns = {
        "q": (np.array([1.0, 2, 3]), "mm"),
        "w": (np.array([1.0, 2, 3]), "rpm"),
        "v": (np.array([1.0, 2, 3]), "?"),
    }
    path = with_units(tmp_path / f"log{suffix}", columns)
    options = {"names": ["q"]} | ({} if suffix == ".mf4" else {"time": "v"})

    def said(**more) -> str:
        return refusal(path, **(options | more))

    message = said(units={"q": "V"})
    assert "column 'q' is in 'mm'" in message
    assert "'q' of the plant is in 'V', which is no unit of the same" in message
    assert "--map 'q=q*1'" in message
    (run,) = read_telemetry(path, units={"q": "m", "w": "rad/s"}, **options | {"names": ["q", "w"]})
    np.testing.assert_allclose(run.columns["q"], [0.001, 0.002, 0.003], rtol=1e-15)  # rounding
    np.testing.assert_allclose(run.columns["w"], np.pi / 30 * np.arange(1, 4), rtol=1e-15)
    assert (run.units["q"], run.units["w"]) == ("m", "rad/s")
    assert "'q' from mm to m, 'w' from rpm to rad/s" in run.notes[-1]
    for unit in ("mm", "", "cubits"):
        (run,) = read_telemetry(path, units={"q": unit}, **options)
        np.testing.assert_array_equal(run.columns["q"], [1, 2, 3])
    read_telemetry(path, units={"q": "mm", "w": "m"}, **options)  # w is not read
    (run,) = read_telemetry(path, units={"q": "m"}, maps=["q=q*0.001"], **options)
    np.testing.assert_array_equal(run.columns["q"], [0.001, 0.002, 0.003])
    (run,) = read_telemetry(path, units={"q": "V"}, maps=["q=q*1"], **options)
    np.testing.assert_array_equal(run.columns["q"], [1, 2, 3])


@pytest.mark.parametrize("suffix", [".h5", ".parquet", ".mf4"])
def test_a_column_that_is_only_renamed_keeps_its_unit(tmp_path, suffix):
    times = {} if suffix == ".mf4" else {"t": (np.arange(3.0), "s")}
    columns = {"wheel_h": (np.array([1.0, 2, 3]), "mm"), **times}
    path = with_units(tmp_path / f"log{suffix}", columns)
    options = {"names": ["h"], "maps": ["h=wheel_h"]}
    message = refusal(path, units={"h": "V"}, **options)
    assert "column 'h' is in 'mm'" in message
    assert "--map 'h=wheel_h*1'" in message  # the file has no h
    (run,) = read_telemetry(path, units={"h": "m"}, **options)
    np.testing.assert_allclose(run.columns["h"], [0.001, 0.002, 0.003], rtol=1e-15)  # rounding
    (run,) = read_telemetry(path, units={"h": "mm"}, **options)
    assert run.units == {"h": "mm"}
    (run,) = read_telemetry(path, units={"h": "m"}, names=["h"], maps=["h=wheel_h*0.001"])
    assert run.units == {}
    np.testing.assert_array_equal(run.columns["h"], [0.001, 0.002, 0.003])


def test_logs_of_one_call_have_one_unit(tmp_path):
    def log(name, unit, values=(1.0, 2, 3)):
        columns = {"t": (np.arange(3.0), "s"), "q": (np.array(values), unit)}
        return with_units(tmp_path / f"{name}.h5", columns)

    metres, bare, odd = log("a", "m"), log("b", ""), log("c", "m?")
    assert len(read_telemetry([metres, bare, odd])) == 3
    for unit, words in (
        ("mm", ["'q' is in 'mm'", "a.h5 it is in 'm'", "--map 'q=q*0.001'", "call of its own"]),
        ("V", ["'q' is in 'V'", "'m', which is no unit of the same"]),
    ):
        with pytest.raises(InputError) as caught:
            read_telemetry([metres, bare, log("d", unit)])
        for word in ["d.h5", *words]:
            assert word in str(caught.value)


@pytest.mark.parametrize("suffix", BINARY)
@pytest.mark.parametrize("content", [b"", b"t,u\n0,1\n1,2\n", b"\x00\x01\x02\xff" * 300])
def test_a_file_of_another_kind(tmp_path, suffix, content):
    (tmp_path / f"log{suffix}").write_bytes(content)
    assert "damaged" in refusal(tmp_path / f"log{suffix}")


@pytest.mark.parametrize(
    "name",
    ["duckdb.parquet", "testmulti_7.4_GLNX86.mat", "testhdf5_7.4_GLNX86.mat", "pytables.h5",
     "mdfreader.mf4", "mdfreader.mdf", "rosbags.mcap", "rosbags_db3/rosbags_db3.db3"],
)  # fmt: skip
@pytest.mark.parametrize("share", [0.1, 0.4, 0.7])
def test_a_truncated_file(tmp_path, name, share):
    whole = (DATA / name).read_bytes()
    path = tmp_path / Path(name).name
    path.write_bytes(whole[: int(share * len(whole))])
    assert path.name in refusal(path, time=None)


@pytest.mark.parametrize("suffix", EXTRA)
def test_a_missing_package_names_the_extra(tmp_path, monkeypatch, suffix):
    package = {".parquet": "pyarrow", ".mat": "pymatreader", ".h5": "h5py", ".hdf5": "h5py",
               ".mf4": "asammdf", ".mdf": "asammdf", ".mcap": "mcap", ".db3": "mcap_ros2",
               ".mcap.zstd": "zstandard", ".db3.zstd": "zstandard"}[suffix]  # fmt: skip
    for name in [package, *(name for name in sys.modules if name.startswith(f"{package}."))]:
        monkeypatch.setitem(sys.modules, name, None)  # so that importing it fails
    (tmp_path / f"log{suffix}").write_bytes(b"x")
    assert "pip install faultgauge[io]" in refusal(tmp_path / f"log{suffix}")


def test_a_missing_file_is_said_so(tmp_path):
    for suffix in BINARY:
        assert "does not exist" in refusal(tmp_path / f"none{suffix}")


def test_the_suffix_in_capitals(tmp_path):
    shutil.copy(DATA / "duckdb.parquet", tmp_path / "LOG.PARQUET")
    (run,) = read_telemetry(tmp_path / "LOG.PARQUET", time="stamp", names=["u"])
    assert run.name == "LOG"


def written(folder: Path, columns: dict[str, np.ndarray]) -> list[Path]:
    """The same log in every format, by the packages' own writers."""
    import scipy.io

    asammdf = pytest.importorskip("asammdf", reason="the extra io is not installed")
    h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
    pyarrow = pytest.importorskip("pyarrow", reason="the extra io is not installed")
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pyarrow.table(columns), folder / "log.parquet")
    scipy.io.savemat(folder / "log.mat", {name: x[:, None] for name, x in columns.items()})
    with h5py.File(folder / "log.h5", "w") as file:
        for name, values in columns.items():
            file[name] = values
    t = columns["t"]
    signals = [asammdf.Signal(x, t, name=name) for name, x in columns.items() if name != "t"]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(folder / "log.mf4")
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    messages = [("/", round(row.pop("t") * 1e9), row) for row in rows]
    return [folder / f"log{suffix}" for suffix in (".parquet", ".mat", ".h5", ".mf4")] + [
        write_mcap(folder / "log.mcap", messages)
    ]


def test_a_log_is_the_same_run_in_every_format(tmp_path):
    rng = np.random.default_rng(0)
    columns = {"t": np.arange(200) / 100, "u": rng.normal(size=200), "y": rng.normal(size=200)}
    lines = [",".join(map(repr, row)) for row in np.stack(list(columns.values()), 1).tolist()]
    (tmp_path / "log.csv").write_text("\n".join(["t,u,y", *lines]))
    (plain,) = read_telemetry(tmp_path / "log.csv")
    for path in written(tmp_path, columns):
        (run,) = read_telemetry(path)
        assert run.content_hash == plain.content_hash, path


def test_a_bag_is_read_with_names_as_in_a_plant_file():
    maps = ["w=imu_angular_velocity_x", "u=robot_cmd_vel_linear_x"]
    (run,) = read_telemetry(
        DATA / "rosbags.mcap", maps=maps, names=["u"], optional=["w"], held=["u"]
    )
    assert segments(run, ["u", "w"]) == [slice(0, 41)]  # to the last command, at 0.4 s
    np.testing.assert_array_equal(run.columns["u"][:41], 0.1 * (I[:41] // 10 * 10))
