"""Recordings of ROS: folders, SQLite files, compressed ones, and what is refused."""

import json
import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import inspect_runs, read_telemetry
from faultgauge.telemetry.readers import read_table, stem
from faultgauge.telemetry.readers.interfaces import FIELDS, definition

pytest.importorskip("mcap_ros2", reason="the extra io is not installed")

DATA = Path(__file__).parents[1] / "data"
BAG = DATA / "rosbags_db3"
K = np.arange(50.0)
SECOND = 1_000_000_000
# Tables as rosbag2 makes them before ROS 2 Iron (schema version 3), without definitions.
HUMBLE = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
                      metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                      timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema VALUES (3, 'humble');
"""


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_table(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    return message


def sql(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path)) as file, file:
        for statement in statements:
            file.execute(statement)


def listed(folder: Path, *names: str) -> Path:
    """`folder` as a bag of these files: the part of `metadata.yaml` that names them."""
    items = "".join(f"    - {name}\n" for name in names)
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n" + items
    )
    return folder


def assert_whole(path: Path) -> None:
    """`path` holds what the README of the folder of data says of `rosbags_db3`."""
    table = read_table(path)
    # Integers of 1e-9 s, divided once.
    np.testing.assert_array_equal(table.columns["t"], np.arange(50) * 20_000_000 / 1e9)
    np.testing.assert_array_equal(table.columns["rig/state.speed"], K / 4)
    np.testing.assert_array_equal(table.columns["rig/state.current_1"], -K / 2)
    np.testing.assert_array_equal(table.columns["rig/state.mode"], K // 10)
    np.testing.assert_array_equal(table.columns["cmd.linear.x"][::5], np.arange(10))
    assert np.isnan(table.columns["cmd.linear.x"]).sum() == 40
    assert table.notes == ()


def test_a_folder_of_rosbags_and_the_file_in_it():
    before = sorted(BAG.iterdir())
    assert_whole(BAG)
    assert_whole(BAG / "rosbags_db3.db3")
    assert sorted(BAG.iterdir()) == before  # SQLite leaves no journal behind
    (run,) = inspect_runs(BAG).runs
    assert run.name == "rosbags_db3"


def test_a_folder_is_named_after_itself_wherever_one_stands(monkeypatch):
    assert stem(BAG) == stem(BAG / "rosbags_db3.db3") == "rosbags_db3"
    monkeypatch.chdir(BAG)
    assert stem(Path()) == "rosbags_db3"


def test_a_split_recording_is_one_run(tmp_path):
    names = [f"split_{k}.db3" for k in range(3)]
    for k, name in enumerate(names):
        shutil.copy(BAG / "rosbags_db3.db3", tmp_path / name)
        # message ids run over both topics: 60 messages
        sql(tmp_path / name, f"DELETE FROM messages WHERE (id - 1) / 20 <> {k}")
    shutil.copy(BAG / "rosbags_db3.db3", tmp_path / "other.db3")  # of another recording
    sql(tmp_path / "other.db3", "UPDATE messages SET timestamp = timestamp + 1000000007")
    assert_whole(listed(tmp_path, *names))
    assert_whole(listed(tmp_path, *(f'"my_bag/{name}"' for name in names)))  # as Dashing wrote
    (tmp_path / names[1]).unlink()
    message = refusal(tmp_path)
    assert f"{tmp_path / names[1]} does not exist" in message


def test_a_split_recording_in_mcap_files(tmp_path):
    writer_of = pytest.importorskip("mcap.writer")
    names = [f"log_{k}.mcap" for k in range(12)]  # by name, log_10 would come before log_2
    for k, name in enumerate(names):
        with (tmp_path / name).open("wb") as file:
            writer = writer_of.Writer(file)
            writer.start()
            channel = writer.register_channel("/a", "json", schema_id=0)
            for stamp in (k * SECOND, (k + 1) * SECOND):  # the last one again in the next file
                data = json.dumps({"u": k}).encode()
                writer.add_message(channel, stamp, data, stamp)
            writer.finish()
    table = read_table(listed(tmp_path, *names))
    np.testing.assert_array_equal(table.columns["t"], np.arange(13))
    np.testing.assert_array_equal(table.columns["a.u"], [*range(12), 11])  # the last one counts


def test_compressed_files_and_messages(tmp_path):
    zstandard = pytest.importorskip("zstandard")
    packed = zstandard.ZstdCompressor().compress((BAG / "rosbags_db3.db3").read_bytes())
    (tmp_path / "log_0.db3.zstd").write_bytes(packed)
    assert_whole(tmp_path / "log_0.db3.zstd")
    assert_whole(listed(tmp_path, "log_0.db3.zstd"))
    packed = zstandard.ZstdCompressor().compress((DATA / "rosbags.mcap").read_bytes())
    (tmp_path / "LOG.MCAP.ZSTD").write_bytes(packed)
    plain, again = read_table(DATA / "rosbags.mcap"), read_table(tmp_path / "LOG.MCAP.ZSTD")
    for name, cells in plain.columns.items():
        np.testing.assert_array_equal(again.columns[name], cells)

    path = tmp_path / "messages.db3"
    shutil.copy(BAG / "rosbags_db3.db3", path)
    with closing(sqlite3.connect(path)) as file, file:
        file.create_function("zstd", 1, zstandard.ZstdCompressor().compress)
        file.execute("UPDATE messages SET data = zstd(data)")
    assert_whole(path)


def humble(path: Path, topics: list[tuple[str, str]], messages: list[tuple[int, int, bytes]]):
    """A `.db3` of ROS 2 Humble: `topics` (name, type), `messages` (topic, s, CDR)."""
    with closing(sqlite3.connect(path)) as file, file:
        file.executescript(HUMBLE)
        for name, kind in topics:
            file.execute("INSERT INTO topics VALUES (NULL, ?, ?, 'cdr', '')", (name, kind))
        for topic, second, data in messages:
            row = (topic + 1, second * SECOND, data)
            file.execute("INSERT INTO messages VALUES (NULL, ?, ?, ?)", row)
    return path


def test_a_bag_without_definitions(tmp_path):
    # CDR by hand, little-endian: 4 bytes of header, then each number at a multiple of its size.
    def wrench(k: int) -> bytes:
        header = struct.pack("<iII4s", 90 + k, 500_000_000, 4, b"rig\0")
        return b"\0\1\0\0" + header + struct.pack("<6d", k, 2 * k, 3 * k, 0, 0, -k)

    def joints(k: int) -> bytes:
        names = struct.pack("<iIIsxxxI", 90 + k, 500_000_000, 1, b"\0", 2)  # no frame, two names
        names += struct.pack("<I2sxxI3sx", 2, b"a\0", 3, b"bc\0")
        position = struct.pack("<I2d", 2, k, k / 2)  # at byte 36: its doubles at 40
        return b"\0\1\0\0" + names + position + struct.pack("<II", 0, 0)

    path = humble(
        tmp_path / "log.db3",
        [
            ("/wrench", "geometry_msgs/msg/WrenchStamped"),
            ("/joints", "sensor_msgs/msg/JointState"),
            ("/own", "rig_msgs/msg/State"),
        ],
        [(topic, 91 + k, data(k)) for k in range(3) for topic, data in enumerate((wrench, joints))]
        + [(2, 91, b"\0\1\0\0\0")],
    )
    table = read_table(path)
    np.testing.assert_array_equal(table.columns["t"], [0, 1, 2])  # by stamps, 0.5 s before
    np.testing.assert_array_equal(table.columns["wrench.wrench.force.z"], [0, 3, 6])
    np.testing.assert_array_equal(table.columns["wrench.wrench.torque.z"], [0, -1, -2])
    np.testing.assert_array_equal(table.columns["joints.position_1"], [0, 0.5, 1])
    assert table.columns["joints.name_1"].tolist() == ["bc", "bc", "bc"]
    assert "/own (rig_msgs/msg/State)" in table.notes[0]
    assert "`ros2 bag convert`" in table.notes[0]
    assert "geometry_msgs/msg/WrenchStamped, sensor_msgs/msg/JointState" in table.notes[1]


def test_a_bag_of_unknown_messages_says_how_to_convert_it(tmp_path):
    path = humble(tmp_path / "log.db3", [("/own", "rig_msgs/msg/State")], [(0, 1, b"\0\1\0\0\0")])
    message = refusal(path)
    assert "only /own (rig_msgs/msg/State)" in message
    assert "`ros2 bag convert`" in message
    assert str(path) in message
    assert "holds no messages" in refusal(humble(tmp_path / "empty.db3", [], []))


def test_definitions_are_those_of_ros():
    text = (DATA / "rosbags_definitions.txt").read_text()
    theirs = dict(part.split("\n", 1) for part in text.removeprefix("MSG: ").split("\n\nMSG: "))
    assert set(theirs) == set(FIELDS)
    for kind, lines in theirs.items():
        fields = [line for line in lines.splitlines() if line and "=" not in line]  # no constants
        assert definition(kind).split("\n===\n")[0].splitlines() == fields, kind
    assert definition("std_msgs/msg/Bool") == definition("std_msgs/Bool")
    assert definition("rig_msgs/msg/State") == ""


def test_a_recording_that_was_cut_off_is_read_with_its_journal(tmp_path):
    path = tmp_path / "log.db3"
    shutil.copy(BAG / "rosbags_db3.db3", path)
    with closing(sqlite3.connect(path)) as recorder:
        recorder.execute("PRAGMA journal_mode = WAL")
        recorder.execute("DELETE FROM messages WHERE topic_id = 2")
        recorder.commit()
        assert "cmd.linear.x" not in read_table(path).columns


def test_a_folder_that_is_no_bag(tmp_path):
    assert "no metadata.yaml" in refusal(tmp_path)
    assert "names no .mcap or .db3 file" in refusal(listed(tmp_path, "notes.txt"))


def test_a_damaged_part_is_named(tmp_path):
    (tmp_path / "log_0.db3").write_bytes(b"SQLite format 3\0 and no more")
    message = refusal(listed(tmp_path, "log_0.db3"))
    assert f"{tmp_path / 'log_0.db3'} is no SQLite file, or it is damaged" in message


def test_a_bag_of_ros_1_says_how_to_convert_it(tmp_path):
    path = tmp_path / "flight.bag"
    path.write_bytes(b"#ROSBAG V2.0\n")
    message = refusal(path)
    assert str(path) in message
    assert "`rosbags-convert --src flight.bag --dst flight`" in message


def test_protobuf_says_what_to_do(tmp_path):
    writer_of = pytest.importorskip("mcap.writer")
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = writer_of.Writer(file)
        writer.start()
        schema = writer.register_schema("rig.State", "protobuf", b"\n\0")
        channel = writer.register_channel("/state", "protobuf", schema_id=schema)
        writer.add_message(channel, SECOND, b"\x08\1", SECOND)
        writer.finish()
    message = refusal(path)
    assert str(path) in message
    assert "only /state (protobuf)" in message
    assert "record or convert them as JSON or as ROS 2 messages" in message
    assert "CSV" in message


def test_a_bag_is_fitted_like_any_log():
    maps = ["w=rig_state_speed", "u=cmd_linear_x"]
    (run,) = read_telemetry(BAG, maps=maps, names=["w", "u"], held=["u"])
    np.testing.assert_array_equal(run.columns["w"], K / 4)
    np.testing.assert_array_equal(run.columns["u"][:46], K[:46] // 5)  # to the last command
