"""Stuck sensors, and the many things that look like one."""

import numpy as np
import pytest

from faultgauge.telemetry import Run, inspect_runs
from faultgauge.telemetry.stuck import stuck_stretches

T = 0.01 * np.arange(5000)
RNG = np.random.default_rng(0)
NOISE = RNG.normal(size=T.size)


def stretches(values, other=NOISE) -> list[slice]:
    return stuck_stretches(Run("log", "log.csv", T, {"x": values, "other": other}), "x")


def stuck(values, part: slice) -> np.ndarray:
    result = values.copy()
    result[part] = result[part.start]
    return result


def test_a_noisy_sensor_that_freezes():
    x = np.sin(T) + 0.01 * NOISE
    assert stretches(x) == []
    assert stretches(stuck(x, slice(1000, 1400))) == [slice(1000, 1400)]
    assert stretches(stuck(x, slice(0, 400))) == [slice(0, 400)]
    assert stretches(stuck(x, slice(4600, 5000))) == [slice(4600, 5000)]
    twice = stuck(stuck(x, slice(1000, 1400)), slice(3000, 3050))
    assert stretches(twice) == [slice(1000, 1400), slice(3000, 3050)]


def test_a_short_stay_is_not_worth_a_word():
    x = np.sin(T) + 0.01 * NOISE
    assert stretches(stuck(x, slice(1000, 1010))) == []


def test_a_quantised_noisy_sensor_that_freezes():
    x = np.round(np.sin(T) + 0.01 * NOISE, 2)  # stays on a value for a few samples as it is
    (found,) = stretches(stuck(x, slice(2000, 3000)))
    # its neighbours may by chance be on the same value, which makes the stretch a little longer
    assert 0 <= 2000 - found.start <= 5
    assert 0 <= found.stop - 3000 <= 5


@pytest.mark.parametrize(
    "values",
    [
        np.repeat(RNG.normal(size=50), 100),  # a held input
        np.repeat(RNG.normal(size=40), RNG.multinomial(5000, np.ones(40) / 40)),  # of uneven holds
        np.round(20 + 0.5 * np.sin(T / 5), 1),  # a coarse thermometer
        np.full(5000, 3.0),
        np.full(5000, np.nan),
        np.where(T < 25, 0.0, 1.0),
    ],
)
def test_held_coarse_and_constant_columns_are_not_stuck(values):
    assert stretches(values) == []


def test_a_drive_that_comes_to_rest_is_not_stuck():
    speed = np.interp(T, [0, 10, 12, 20, 22, 50], [0, 0, 3, 3, 0, 0])
    counts = np.round(np.cumsum(speed))  # an encoder, without any noise
    assert stretches(counts) == []


def test_where_nothing_else_moves_the_log_stood_still():
    x = stuck(np.sin(T) + 0.01 * NOISE, slice(1000, 1400))
    assert stretches(x, other=stuck(NOISE, slice(990, 1410))) == []


def test_empty_cells_do_not_end_a_stretch():
    x = stuck(np.sin(T) + 0.01 * NOISE, slice(1000, 1400))
    x[[1000, 1200, 1201]] = np.nan
    assert stretches(x) == [slice(1001, 1400)]


def test_inspection_says_where(tmp_path):
    x = stuck(np.sin(T) + 0.01 * NOISE, slice(1000, 1400))
    np.savetxt(
        tmp_path / "log.csv",
        np.stack([T, x, NOISE], 1),
        delimiter=",",
        header="t,x,other",
        comments="",
    )
    (hint,) = [hint for hint in inspect_runs(tmp_path / "log.csv").hints if "stuck" in hint]
    assert "'x'" in hint
    assert "t = 10 to 13.99 s" in hint


def test_cells_that_are_filled_between_a_slow_sensors_samples_repeat_nothing():
    """A sample in 50 rows, in steps of 0.1: where two are alike, so are all 51 rows."""
    sampled = np.arange(T.size) % 50 == 0
    slow = np.round(np.sin(T[sampled]) + 0.05 * NOISE[sampled], 1)
    columns = {"x": np.interp(T, T[sampled], slow), "other": NOISE}
    assert np.any(np.diff(slow) == 0)
    assert stuck_stretches(Run("log", "log.csv", T, columns, sampled={"x": sampled}), "x") == []
