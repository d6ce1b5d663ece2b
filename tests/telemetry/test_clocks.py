"""Clocks as people write them, and clocks that are put forward and back."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from faultgauge.detection.words import moment
from faultgauge.errors import InputError
from faultgauge.reporting.clock_axis import clock_ticks
from faultgauge.telemetry import read_telemetry
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.stream import read_stream
from faultgauge.telemetry.writing import as_table, stamp

from .conftest import refusal

TEXT = ["22.11.2026 14:03:07,5", "22.11.2026 14:03:08", "22.11.2026 14:03:08,25"]


def log(folder, stamps, separator=";"):
    path = folder / "log.csv"
    rows = [f"{stamp}{separator}{k}" for k, stamp in enumerate(stamps)]
    path.write_text("\n".join([f"when{separator}u", *rows, ""]))
    return path


@pytest.mark.parametrize(
    ("stamps", "form"),
    [
        (TEXT, None),
        ([each.replace(",", ".").replace("2026 ", "26 ") for each in TEXT], None),
        (["22/11/2026 14:03:07.5", "22/11/2026 14:03:08.0", "22/11/2026 14:03:08.25"],
         "%d/%m/%Y %H:%M:%S.%f"),
        (["20261122-140307,5", "20261122-140308,0", "20261122-140308,25"], "%Y%m%d-%H%M%S,%f"),
        (["14:03:07.5", "14:03:08.0", "14:03:08.25"], "%H:%M:%S.%f"),
    ],
    ids=["dotted", "short year", "slashes", "packed", "no date"],
)  # fmt: skip
def test_clocks_that_are_not_iso(tmp_path, stamps, form):
    (run,) = read_telemetry(log(tmp_path, stamps), time="when", time_format=form)
    assert run.t.tolist() == [0, 0.5, 0.75]
    whole = None if form and "%d" not in form else datetime(2026, 11, 22, 14, 3, 7, 500_000)
    assert run.clock == (whole and Clock(whole))


def test_refusals_name_the_option(tmp_path):
    path = log(tmp_path, ["11/22/2026 14:03", "11/22/2026 14:04"])
    assert refusal(path, time="when").endswith(
        """say how it is written, --time-format "%m/%d/%Y %H:%M"."""
    )
    message = refusal(path, time="when", time_format="%d/%m/%Y %H:%M")
    assert "row 2" in message
    assert "'11/22/2026 14:03' is not of the form --time-format '%d/%m/%Y %H:%M'" in message
    for form in ("%Q", "noon"):
        with pytest.raises(InputError, match=r"--time-format .* is no format of a time"):
            read_telemetry(path, time="when", time_format=form)
    assert "holds numbers, not text" in refusal(path, time="u", time_format="%H:%M")
    assert "31.02.2026" in refusal(log(tmp_path, ["31.02.2026", "01.03.2026"]), time="when")
    either = refusal(log(tmp_path, ["1/2/2026 3:04:05 PM", "1/2/2026 3:04:06 PM"]), time="when")
    assert '--time-format "%d/%m/%Y %I:%M:%S %p" or --time-format "%m/%d/%Y %I:%M:%S %p".' in either


def local(zone, begin, step, count):
    """What a wall clock in `zone` shows from the instant `begin` (UTC) on, every `step` s."""
    instants = [begin + timedelta(seconds=step * k) for k in range(count)]
    there = [each.astimezone(ZoneInfo(zone)).replace(tzinfo=None) for each in instants]
    return [each.isoformat(" ", "milliseconds") for each in there]


@pytest.mark.parametrize("step", [0.1, 1.0, 600.0])
@pytest.mark.parametrize(
    ("zone", "change"),
    [
        ("Europe/Berlin", datetime(2026, 3, 29, 1, tzinfo=UTC)),
        ("Europe/Berlin", datetime(2026, 10, 25, 1, tzinfo=UTC)),
        ("America/New_York", datetime(2026, 3, 8, 7, tzinfo=UTC)),
        ("America/New_York", datetime(2026, 11, 1, 6, tzinfo=UTC)),
    ],
)
def test_time_goes_on_where_summer_time_begins_or_ends(tmp_path, zone, change, step):
    """The instants are those of the time-zone database."""
    stamps = local(zone, change - timedelta(seconds=10 * step), step, 20)
    (run,) = read_telemetry(log(tmp_path, stamps), time="when")
    # stamps have milliseconds
    np.testing.assert_allclose(run.t, step * np.arange(20), atol=1e-9)
    assert len(run.notes) == 1 + 1  # the separator, too
    assert f"an hour after {stamps[9][:19]} in run 'log'" in run.notes[-1]
    # what is written has the log's own time again, row by row
    shown = [datetime.fromisoformat(each) for each in as_table(run)["time"]]
    assert shown == [datetime.fromisoformat(each) for each in stamps]


@pytest.mark.parametrize("step", [0.1, 1.0, 600.0])
@pytest.mark.parametrize("change", [(3, 29), (10, 25)])
def test_a_stream_goes_on_as_its_file_does(tmp_path, change, step):
    instant = datetime(2026, *change, 1, tzinfo=UTC)
    stamps = local("Europe/Berlin", instant - timedelta(seconds=10 * step), step, 20)
    path, notes = log(tmp_path, stamps), []
    (run,) = read_telemetry(path, time="when")
    lines = [f"{line}\n" for line in path.read_text().replace(";", ",").splitlines()]
    given = read_stream([[line] for line in lines], time="when", names=["u"], note=notes.append)
    samples = [each for several in given for each in several]
    assert [each.t for each in samples] == run.t.tolist()
    assert [stamp(each.clock, each.t) for each in samples] == as_table(run)["time"]
    (said,) = (note for note in notes if "put forward or back by an hour" in note)
    assert f"an hour after {stamps[9][:19]} in run 'stream'" in said


@pytest.mark.parametrize("lost", [(10,), (9,), (9, 10)], ids=["first", "last", "both"])
@pytest.mark.parametrize("step", [0.1, 1.0, 600.0])
def test_rows_may_be_missing_where_summer_time_ends(tmp_path, step, lost):
    """The last row before the hour comes again, the first one after, or both: bad, and left out."""
    begin = datetime(2026, 10, 25, 1, tzinfo=UTC) - timedelta(seconds=10 * step)
    stamps = local("Europe/Berlin", begin, step, 20)
    rows = [(k, stamp) for k, stamp in enumerate(stamps) if k not in lost]
    path = log(tmp_path, [stamp for _, stamp in rows])
    (run,) = read_telemetry(path, time="when")
    # stamps have milliseconds
    np.testing.assert_allclose(run.t, [step * k for k, _ in rows], atol=1e-9)
    lines = [f"{stamp},{k}\n" if k not in lost else "odd\n" for k, stamp in enumerate(stamps)]
    left_out = []
    given = read_stream(
        [[line] for line in ["when,u\n", *lines]], time="when", names=["u"], skip=left_out.append
    )
    assert [each.t for several in given for each in several] == run.t.tolist()
    assert len(left_out) == len(lost)


def test_an_hour_that_comes_twice_is_told_apart():
    clock = Clock(datetime(2026, 10, 25, 2, 30), ((1800.0, -3600.0),))
    back = " (winter time)"
    assert [moment(clock, t, 1.0) for t in (0.0, 1799.0, 1800.0, 5399.0, 5400.0)] == [
        *("02:30:00", "02:59:59", f"02:00:00{back}", f"02:59:59{back}", "03:00:00")
    ]
    _, ticks = clock_ticks(clock, 0.0, 7200.0)
    assert ticks[0] == "02:30:00\n2026-10-25"
    assert ticks[1:] == ["02:00:00", "02:30:00", "03:00:00", "03:30:00"]


def test_other_jumps_stay(tmp_path):
    step = timedelta(seconds=1)
    midday, sunday = datetime(2026, 10, 25, 12, 59, 50), datetime(2026, 10, 25, 2, 30, 0)
    for begin in (midday, sunday):  # at noon; not at a full hour
        late = [begin + k * step for k in range(10)]
        late += [each + timedelta(hours=1, seconds=10) for each in late]
        stamps = [each.isoformat() for each in late]
        (run,) = read_telemetry(log(tmp_path, stamps), time="when")
        assert run.t[-1] == 3600 + 19
    back = [datetime(2026, 10, 26, 2, 59, 58) + k * step for k in (0, 1, -3598, -3597)]
    assert "runs backwards" in refusal(log(tmp_path, back), time="when")  # a Monday


def test_each_run_of_a_file_has_its_own_change(tmp_path):
    stamps = local("Europe/Berlin", datetime(2026, 10, 25, 0, 59, 57, tzinfo=UTC), 1.0, 6)
    path = tmp_path / "log.csv"
    rows = [f"{stamp},{k},{unit}" for unit in "ab" for k, stamp in enumerate(stamps)]
    path.write_text("\n".join(["when,u,run", *rows, ""]))
    for run in read_telemetry(path, time="when"):
        assert run.t.tolist() == [0, 1, 2, 3, 4, 5]
        assert run.clock.put == ((3.0, -3600.0),)


@pytest.mark.parametrize(("unit", "per_second"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_time_since_1970_with_and_without_its_unit(tmp_path, unit, per_second):
    begin = 1_795_356_187  # 2026-11-22 14:03:07 UTC
    stamps = [begin * per_second + k * per_second // 2 for k in range(4)]
    path = log(tmp_path, stamps, ",")
    (bare,) = read_telemetry(path, time="when")
    path.write_text(path.read_text().replace("when", f"when [{unit}]"))
    (named,) = read_telemetry(path, time="when")
    for run in (bare, named):
        # float64 holds nanoseconds since 1970 to 256 ns
        np.testing.assert_allclose(run.t, [0, 0.5, 1, 1.5], atol=1e-6)
        assert run.clock == Clock(datetime(2026, 11, 22, 14, 3, 7, tzinfo=UTC))
        assert "since 1970 by its size" in run.notes[0]
