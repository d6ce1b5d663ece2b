"""From files to runs: time, runs, columns, and every refusal."""

from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import read_telemetry


@pytest.fixture
def log(tmp_path):
    def write(text: str, name: str = "log.csv") -> Path:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def refusal(paths, **options) -> str:
    with pytest.raises(InputError) as caught:
        read_telemetry(paths, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    return message


def test_one_file_is_one_run(log):
    path = log("t,u,h,mode\n0,1,5,on\n0.5,,6,on\n1,3,7,off\n", "wheel.csv")
    (run,) = read_telemetry(path)
    assert (run.name, run.source) == ("wheel", str(path))
    np.testing.assert_array_equal(run.t, [0, 0.5, 1])
    assert list(run.columns) == ["u", "h"]
    np.testing.assert_array_equal(run.columns["u"], [1, np.nan, 3])


def test_required_and_optional_columns(log):
    path = log("t,u,h,mode,dead\n0,1,5,on,\n1,2,6,off,\n")
    (run,) = read_telemetry(str(path), names=["h"], optional=["u", "d_h"])
    assert set(run.columns) == {"h", "u"}
    (run,) = read_telemetry(path, names=["h"])
    assert set(run.columns) == {"h"}
    (run,) = read_telemetry(path, optional=["u"])
    assert set(run.columns) == {"u"}


def test_a_needed_column_is_found_by_its_identifier(log):
    path = log("t,wheel speed\n0,5\n1,6\n")
    (run,) = read_telemetry(path, names=["wheel_speed"])
    np.testing.assert_array_equal(run.columns["wheel_speed"], [5, 6])


def test_maps_come_before_names(log):
    path = log("t,rpm\n0,10\n1,20\n")
    (run,) = read_telemetry(path, maps=["h=rpm*2"], names=["h"])
    np.testing.assert_array_equal(run.columns["h"], [20, 40])


def test_time_named_mapped_and_in_a_column_of_another_name(log):
    path = log("t,t_ms,u\n5,0,1\n4,500,2\n")
    (run,) = read_telemetry(path, time="t_ms")
    np.testing.assert_array_equal(run.t, [0, 500])
    assert list(run.columns) == ["u"]
    (run,) = read_telemetry(path, maps=["t=t_ms/1000"], names=["u"])
    np.testing.assert_array_equal(run.t, [0, 0.5])


def test_timestamps_become_seconds_since_the_first(log):
    path = log(
        "stamp,u\n2026-03-29T01:59:59.5+01:00,1\n2026-03-29T03:00:00+02:00,2\n"
        "2026-03-29 01:00:01.25Z,3\n"
    )
    (run,) = read_telemetry(path, time="stamp")
    np.testing.assert_array_equal(run.t, [0, 0.5, 1.75])
    (run,) = read_telemetry(path, maps=["t=stamp"])
    np.testing.assert_array_equal(run.t, [0, 0.5, 1.75])


def test_a_run_column_splits_by_label_in_order_of_appearance(log):
    path = log("t,run,u\n0,b,1\n0,a,2\n1,b,3\n1,a,4\n2,a,5\n")
    first, second = read_telemetry(path)
    assert (first.name, second.name) == ("log:b", "log:a")
    np.testing.assert_array_equal(first.columns["u"], [1, 3])
    np.testing.assert_array_equal(second.t, [0, 1, 2])
    assert "run" not in first.columns


def test_numbers_label_runs_too(log):
    runs = read_telemetry(log("t,run,u\n0,2,1\n1,2,2\n0,10,3\n1,10,4\n0,0.5,5\n1,0.5,6\n"))
    assert [run.name for run in runs] == ["log:2", "log:10", "log:0.5"]
    np.testing.assert_array_equal(runs[1].columns["u"], [3, 4])


def test_names_of_runs_are_unique(log):
    text = "t,u\n0,1\n1,2\n"
    paths = [log(text, "a/log.csv"), log(text, "b/log.csv"), log(text, "c/log.csv")]
    assert [run.name for run in read_telemetry(paths)] == ["log", "log#2", "log#3"]


def test_a_column_empty_in_one_run_is_absent_from_it(log):
    path = log("t,run,u,h\n0,1,1,5\n1,1,2,6\n0,2,3,\n1,2,4,\n")
    first, second = read_telemetry(path, names=["u"], optional=["h"])
    assert set(first.columns) == {"u", "h"}
    assert set(second.columns) == {"u"}
    message = refusal(path, names=["u", "h"])
    for word in [str(path), "'h'", "'log:2'", "empty"]:
        assert word in message


def test_constant_columns_and_unused_faults_are_no_error(log):
    path = log("t,u,bad,dead\n0,1,inf,\n1,1,ERR,\n")
    (run,) = read_telemetry(path, names=["u"])
    np.testing.assert_array_equal(run.columns["u"], [1, 1])


def test_no_time_column_lists_columns_and_proposes(log):
    message = refusal(log("u,t_s,T,h\n3,0,9,5\n2,1,8,6\n"))
    for word in ["log.csv", "u, t_s, T, h", "try --time t_s."]:  # a torque and a ramp are no times
        assert word in message
    assert "try --time Time." in refusal(log("u,Time (ms),h\n3,0,5\n2,1,6\n"))  # read in ms
    assert '--map "t=Time_ms/1000"' in refusal(log("u,Time_ms,h\n3,0,5\n2,1,6\n"))
    message = refusal(log("u,when\n3,2026-01-01\n2,2026-01-02\n"))
    assert "--time when" in message
    assert "--time COLUMN" in refusal(log("u,h\n3,5\n2,6\n2,6\n"))


def test_an_unknown_time_column_lists_columns(log):
    message = refusal(log("t_s,u\n0,1\n1,2\n"), time="t_sec")
    for word in ["log.csv", "--time", "'t_sec'", "did you mean 't_s'", "t_s, u"]:
        assert word in message


def test_time_named_twice(log):
    message = refusal(log("a,b\n0,1\n1,2\n"), time="a", maps=["t=b"])
    assert "--time a" in message
    assert "--map t=" in message


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("0,1\n1,2\n1,3\n", ["same again", "row 3 (1.0)", "row 4 (1.0)"]),
        ("0,1\n2,2\n1,3\n", ["backwards", "row 3 (2.0)", "row 4 (1.0)"]),
        ("0,1\n,2\n2,3\n", ["row 3", "empty"]),
        ("0,1\nnan,2\n2,3\n", ["row 3", "empty"]),
        ("0,1\n1,2\ninf,3\n", ["row 4", "inf"]),
        ("0,1\nx,2\n2,3\n", ["row 3", "'x'", "not a number"]),
        ("x,1\n1,2\n2,3\n", ["row 2", "'x'", "ISO 8601"]),
        ("2026-01-01,1\n5,2\n", ["row 3", "'5'", "ISO 8601"]),
        ("2026-01-01,1\n,2\n", ["row 3", "empty"]),
        ("2026-01-01,1\n2026-01-02T00:00Z,2\n", ["row 3", "zone", "2026-01-02T00:00Z"]),
        ("2026-01-02,1\n2026-01-01,2\n", ["backwards", "row 2 (2026-01-02)", "row 3"]),
    ],
)
def test_refused_times(log, rows, words):
    message = refusal(log("t,u\n" + rows))
    for word in ["log.csv", "'t'", *words]:
        assert word in message


def test_time_is_checked_within_each_run(log):
    message = refusal(log("t,run,u\n0,a,1\n0,b,2\n1,a,3\n0,b,4\n"))
    for word in ["'log:b'", "row 3", "row 5"]:
        assert word in message


def test_refused_runs(log):
    message = refusal(log("t,run,u\n0,a,1\n1,a,2\n2,b,3\n"))
    for word in ["'log:b'", "row 4", "two samples"]:
        assert word in message
    for label in ["a,1\n1,,2", "1,1\n1,,2", "1,1\n1,inf,2"]:
        message = refusal(log(f"t,run,u\n0,{label}\n"))
        assert "row 3" in message
        assert "run label" in message


def test_a_missing_column_lists_those_there(log):
    message = refusal(log("t,wheel_rpm,u\n0,1,2\n1,2,3\n"), names=["u", "wheel_rmp", "T"])
    for word in [
        "log.csv", "'wheel_rmp', 'T'", "did you mean 'wheel_rpm'", "t, wheel_rpm, u",
        '--map "wheel_rmp=EXPRESSION"',
    ]:  # fmt: skip
        assert word in message


@pytest.mark.parametrize("options", [{"names": ["u"]}, {"optional": ["u"]}])
def test_text_in_a_used_column(log, options):
    message = refusal(log("t,u\n0,1\n1,ERR\n2,3\n"), **options)
    for word in ["log.csv, row 3", "'u'", "'ERR'"]:
        assert word in message


@pytest.mark.parametrize("options", [{"names": ["u"]}, {"optional": ["u"]}, {}])
def test_infinite_and_empty_columns(log, options):
    message = refusal(log("t,u\n0,1\n1,\n2,-inf\n"), **options)
    for word in ["log.csv, row 4", "'u'", "-inf"]:
        assert word in message
    message = refusal(log("t,u\n0,\n1,\n2,\n"), **options)
    for word in ["log.csv", "'u'", "all 3 rows"]:
        assert word in message


def test_the_same_file_twice(log, tmp_path):
    path = log("t,u\n0,1\n1,2\n")
    (tmp_path / "link.csv").symlink_to(path)
    message = refusal([path, tmp_path / "link.csv"])
    assert str(path) in message
    assert "link.csv" in message
    assert "same file" in refusal([path, path])


def test_no_file_at_all():
    assert "at least one file" in refusal([])


def test_maps_must_hold_for_every_file(log):
    first = log("t,rpm\n0,1\n1,2\n", "a.csv")
    second = log("t,speed\n0,1\n1,2\n", "b.csv")
    message = refusal([first, second], maps=["h=rpm"])
    assert str(second) in message
    assert "'rpm'" in message


def test_a_measured_log(data_dir):
    (run,) = read_telemetry(
        data_dir / "emps" / "train_nominal.csv.gz", time="t_s", names=["q_m", "v_V"]
    )
    assert run.t.shape == (24841,)  # its README
    assert run.step == pytest.approx(1e-3, rel=1e-3)  # sampled at 1000 Hz by a real clock
