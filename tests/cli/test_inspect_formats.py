"""`faultgauge inspect` on every format: what it prints is what the files were made to hold."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from faultgauge.plants.plant_file import parse_plant

DATA = Path(__file__).parents[1] / "data"  # its README says how the files were made
K = np.arange(50.0)


def mat(path: Path, version: str) -> Path:
    """By SciPy or hdf5storage: a column i/100 s, speed = i/2, two columns of position."""
    content = {
        "rig": {"time": K[:, None] / 100, "speed": K[:, None] / 2},
        "pos": np.stack([K, -2 * K], axis=1),
    }
    if version == "v5":
        scipy.io.savemat(path, content)
    else:
        hdf5storage = pytest.importorskip("hdf5storage", reason="the extra io is not installed")
        hdf5storage.savemat(str(path), content, format="7.3", store_python_metadata=False)
    return path


def parquet(path: Path) -> Path:
    """By pyarrow: time in ms, pressure in Pa, which the metadata of their fields say."""
    pyarrow = pytest.importorskip("pyarrow", reason="the extra io is not installed")
    written = pytest.importorskip("pyarrow.parquet")
    columns = {"t": (10 * K, "ms"), "p": (1e5 + K, "Pa")}
    fields = [
        pyarrow.field(n, pyarrow.float64(), metadata={"unit": u}) for n, (_, u) in columns.items()
    ]
    table = pyarrow.table([values for values, _ in columns.values()], schema=pyarrow.schema(fields))
    written.write_table(table, path)
    return path


def split_bag(folder: Path) -> Path:
    """The bag of the folder of data in two files."""
    shutil.copytree(DATA / "rosbags_db3", folder)
    shutil.copy(folder / "rosbags_db3.db3", folder / "rosbags_db3_1.db3")
    for name, part in (("rosbags_db3.db3", "> 30"), ("rosbags_db3_1.db3", "<= 30")):  # of 60
        with closing(sqlite3.connect(folder / name)) as file, file:
            file.execute(f"DELETE FROM messages WHERE id {part}")
    listing = folder / "metadata.yaml"
    first = "  - rosbags_db3.db3\n"
    assert first in listing.read_text()
    listing.write_text(listing.read_text().replace(first, first + "  - rosbags_db3_1.db3\n"))
    return folder


BAG = {
    "rig/state.speed": ("", 0, 12.25),
    "rig/state.current_0": ("", 0, 49),
    "rig/state.current_1": ("", -24.5, 0),
    "rig/state.mode": ("", 0, 4),
    "cmd.linear.x": ("", 0, 9),
}
RIG = {"rig.speed": ("", 0, 24.5), "pos_0": ("", 0, 49), "pos_1": ("", -98, 0)}
# A file or what makes it, options, rows, rate (Hz), first time (s), columns: unit, least, most.
CASES = {
    "parquet": (
        DATA / "duckdb.parquet", ["--time", "stamp"], 50, 100, 0,
        {"u": ("", -3, 21.5), "n": ("", 0, 49), "d": ("", 0, 12.25), "pose.x": ("", 0, 98),
         "mode": ("", None, None)},
    ),
    "parquet-units": (
        lambda folder: parquet(folder / "log.parquet"), [], 50, 100, 0,
        {"p": ("Pa", 1e5, 100_049)},
    ),
    "mat-matlab": (
        DATA / "testmulti_7.4_GLNX86.mat", ["--time", "a_0"], 5, 1, 1,
        {"a_1": ("", 0, 2), "a_2": ("", 0, 3)},
    ),
    "mat-v5": (
        lambda folder: mat(folder / "log.mat", "v5"), ["--time", "rig.time"], 50, 100, 0, RIG,
    ),
    "mat-v7.3-matlab": (
        DATA / "testhdf5_7.4_GLNX86.mat", ["--time", "testdouble"], 9, 4 / np.pi, 0, {},
    ),
    "mat-v7.3": (
        lambda folder: mat(folder / "log.mat", "v7.3"), ["--time", "rig.time"], 50, 100, 0, RIG,
    ),
    "hdf5": (
        DATA / "pytables.h5", ["--time", "rig/time"], 50, 100, 0,
        {"rig/speed": ("rad/s", 0, 24.5), "rig/acc_0": ("m/s^2", 0, 0.49),
         "rig/acc_2": ("m/s^2", 0, 1.47), "rig/label": ("", None, None)},
    ),
    "mdf4": (
        DATA / "mdfreader.mf4", [], 50, 100, 0,
        {"speed": ("rad/s", 0, 24.5), "gear": ("", 0, 4), "oil": ("degC", 80, 84)},
    ),
    "mcap": (
        DATA / "rosbags.mcap", [], 50, 100, 0,
        {"imu.angular_velocity.x": ("", 0, 24.5), "imu.angular_velocity.z": ("", -49, 0),
         "robot/cmd_vel.linear.x": ("", 0, 4), "mode.data": ("", None, None)},
    ),
    "db3": (DATA / "rosbags_db3" / "rosbags_db3.db3", [], 50, 50, 0, BAG),
    "bag": (DATA / "rosbags_db3", [], 50, 50, 0, BAG),
    "split-bag": (lambda folder: split_bag(folder / "bag"), [], 50, 50, 0, BAG),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_names_units_time_rate_and_ranges(call, tmp_path, case):
    source, options, rows, rate, start, columns = CASES[case]
    path = source if isinstance(source, Path) else source(tmp_path)
    found = call("inspect", path, *options, "--json")
    assert found.code == 0, found.err
    (run,) = found.json["runs"]
    assert run["rows"] == rows
    assert run["source"] == str(path)
    assert run["start"] == start
    # Steps are differences of decimal fractions: 1e-12 is hundreds of their rounding errors.
    assert run["rate"] == pytest.approx(rate, rel=1e-12)
    assert run["duration"] == pytest.approx((rows - 1) / rate, rel=1e-12)
    assert run["gaps"] == []
    by_name = {column["name"]: column for column in found.json["columns"]}
    assert columns.keys() <= by_name.keys()
    for name, (unit, least, most) in columns.items():
        column = by_name[name]
        assert column["unit"] == unit, name
        assert column["kind"] == ("text" if least is None else "number"), name
        if least is not None:
            # 3 * 0.49 is not 1.47 to the last bit, nor the least and most of what was scaled
            assert column["statistics"]["min"] == pytest.approx(least, rel=1e-15), name
            assert column["statistics"]["max"] == pytest.approx(most, rel=1e-15), name


def test_cells_that_were_not_sampled_are_counted(call):
    found = call("inspect", DATA / "duckdb.parquet", "--time", "stamp", "--json").json
    (n,) = [column for column in found["columns"] if column["name"] == "n"]
    assert n["share_empty"] == 7 / 50  # 3, 10, ..., 45
    found = call("inspect", DATA / "rosbags_db3", "--json").json
    assert found["runs"][0]["empty"]["cmd.linear.x"] == 40


def test_the_table_for_people(call):
    text = call("inspect", f"{DATA / 'rosbags_db3'}/").out
    assert "rosbags_db3" in text
    assert "rig/state.speed" in text
    assert "In --map, --where and plant files, 'rig/state.speed' is rig_state_speed" in " ".join(
        text.split()
    )
    assert "rad/s" in call("inspect", DATA / "mdfreader.mf4").out


def test_a_plant_file_is_drafted_from_a_bag(call, tmp_path):
    draft = tmp_path / "plant.toml"
    assert call("inspect", DATA / "rosbags_db3", "--init-plant", draft).code == 0
    assert "rig_state_speed" in draft.read_text()


@pytest.mark.parametrize("json", [[], ["--json"]])
@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("flight.bag", "`rosbags-convert --src flight.bag --dst flight`"),
        ("proto.mcap", "record or convert them as JSON or as ROS 2 messages"),
        ("pymatreader_datetime_v7.mat", "save vectors in their place"),
        ("pymatreader_datetime_v7.3.mat", "save vectors in their place"),
        ("model.fgm", "is a model of faultgauge, not a log; give a log in its place."),
        ("folder", "give log files, or a folder that holds some"),
    ],
)
def test_what_is_not_read_is_said_in_a_sentence(call, tmp_path, name, advice, json):
    path = DATA / name if name.startswith("pymatreader") else tmp_path / name
    if name == "model.fgm":
        path.write_text("{}")
    if name == "flight.bag":
        path.write_bytes(b"#ROSBAG V2.0\n")
    elif name == "folder":
        path.mkdir()
    elif name == "proto.mcap":
        writer_of = pytest.importorskip("mcap.writer", reason="the extra io is not installed")
        with path.open("wb") as file:
            writer = writer_of.Writer(file)
            writer.start()
            schema = writer.register_schema("rig.State", "protobuf", b"")
            channel = writer.register_channel("/state", "protobuf", schema_id=schema)
            writer.add_message(channel, 1, b"\x08\1", 1)
            writer.finish()
    found = call("inspect", path, *json)
    assert found.code == 2
    assert found.out == ""
    assert str(path) in found.err
    assert advice in found.err
    assert found.err.endswith(".\n")
    assert found.err.count("\n") == 1


def test_a_narrow_screen_cuts_no_number_and_no_name(call, tmp_path, monkeypatch):
    """Against the log's own extremes and names, on 80 columns."""
    t = np.arange(400) * 0.01
    motor = np.c_[t, -1234.5678 * np.sin(t), -0.0023456 * np.cos(t), 98.765 * np.cos(3 * t)]
    header = "t,voltage_of_the_drive,current,speed"
    np.savetxt(tmp_path / "log.csv", motor, delimiter=",", header=header, comments="")
    monkeypatch.setenv("COLUMNS", "80")
    said = call("inspect", tmp_path / "log.csv").out
    assert "…" not in said
    for column in motor.T[1:]:
        assert f"{column.min():.4g}" in said
        assert f"{column.mean():.4g}" in said
    lines = said[said.index(" column ") :].splitlines()
    cells = [line[: lines[0].index("min")].strip() for line in lines]
    assert "voltage_of_the_drive" in "".join(cells)  # folded over lines


def test_names_that_mean_something_else_are_printed_and_drafted_harmlessly(call, tmp_path):
    """Markup, escape sequences, and what is reserved in plant files."""
    log, draft = tmp_path / "log.csv", tmp_path / "plant.toml"
    names = ["t", "[/red]", "\x1b[31mhot", "sin", "run_", "x", "NN_x", "d", "d_x"]
    lines = [",".join(str((k * (j + 3)) % 7) for j in range(1, 9)) for k in range(30)]
    log.write_text(",".join(names) + "\n" + "".join(f"{k},{r}\n" for k, r in enumerate(lines)))
    said = call("inspect", log, "--init-plant", draft)
    assert said.code == 0, said.err
    assert "\x1b" not in said.out + said.err
    assert "[/red]" in said.out
    assert "\\x1b[31mhot" in said.out
    spec = parse_plant(draft.read_text())
    assert "x" in spec.signals.state_names
    assert not {"sin", "d", "NN_x"} & {*spec.signals.state_names}


@pytest.mark.study
def test_no_draft_is_better_than_one_that_is_refused(call, tmp_path):
    """Of 500 states the networks would have more arguments than an expression may."""
    log, draft = tmp_path / "log.csv", tmp_path / "plant.toml"
    names = ",".join(["t", *(f"x{k}" for k in range(500))])
    log.write_text(names + "\n" + "".join(f"{k}{',1' * 500}\n" for k in range(5)))
    said = call("inspect", log, "--init-plant", draft)
    assert said.code == 2
    assert "make no legal plant file" in said.err
    assert not draft.exists()
