"""Time in milli-, micro- or nanoseconds since 1970."""

from datetime import UTC, datetime
from itertools import chain

import numpy as np
import pytest

from faultgauge.telemetry import inspect_runs, read_telemetry
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.stream import read_stream

FIRST = datetime(2026, 3, 29, 1, 59, 59, tzinfo=UTC)


@pytest.mark.parametrize(
    ("digits", "unit", "atol"),
    # nanoseconds since 1970 are good to 256 in float64
    [(3, "milliseconds", 0), (6, "microseconds", 0), (9, "nanoseconds", 3e-7)],
)
def test_numbers_that_count_since_1970(tmp_path, digits, unit, atol):
    path = tmp_path / "log.csv"
    stamps = [int(FIRST.timestamp()) * 10**digits + k * 10**digits // 50 for k in range(30)]
    lines = [f"{stamp},{k}\n" for k, stamp in enumerate(stamps)]
    path.write_text("stamp,u\n" + "".join(lines))
    (run,) = read_telemetry(path, time="stamp")
    np.testing.assert_allclose(run.t, np.arange(30) / 50, rtol=1e-12, atol=atol)
    assert run.clock == Clock(FIRST)
    assert f"{unit} since 1970" in run.notes[0]
    assert "2026-03-29 01:59:59 UTC" in run.notes[0]
    assert run.notes[0] in inspect_runs(path, time="stamp").hints
    lines = path.read_text().splitlines(keepends=True)
    samples = list(chain(*read_stream([lines], time="stamp", names=["u"])))
    np.testing.assert_allclose([sample.t for sample in samples], run.t, atol=1e-12)
    (run,) = read_telemetry(path, maps=[f"t=stamp/1e{digits}"], names=["u"])
    assert run.t[0] == pytest.approx(FIRST.timestamp())  # the user's own business
    assert run.notes == ()


@pytest.mark.parametrize("first", [0.0, 1e5, 1.7e9, 1e11, 6.39e17])
def test_numbers_that_do_not(tmp_path, first):
    """Also seconds since 1970, which stay as they are, and ticks of 100 ns since the year 1."""
    path = tmp_path / "log.csv"
    t = [first, first + 1024, first + 2048]
    path.write_text("t,u\n" + "".join(f"{each!r},1\n" for each in t))
    (run,) = read_telemetry(path)
    np.testing.assert_array_equal(run.t, t)
    assert run.notes == ()
    assert run.clock is None
