"""Runs: identity, step, and the stretches between gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from faultgauge.telemetry.runs import Run, cut, gaps, segments


def run(t, name="a", source="a.csv", **columns) -> Run:
    arrays = {key: np.array(values, dtype=np.float64) for key, values in columns.items()}
    return Run(name, source, np.array(t, dtype=np.float64), arrays)


def test_step_is_the_median():
    assert run([0, 1, 2, 3, 10]).step == 1.0


def test_hash_knows_the_content_and_not_the_name():
    first = run([0, 1], name="a", source="a.csv", u=[1, 2], h=[0.0, np.nan])
    same = run([0, 1], name="b", source="b.csv", h=[-0.0, -np.nan], u=[1, 2])
    assert first.content_hash == same.content_hash
    assert len(first.content_hash) == 64
    int(first.content_hash, 16)


@pytest.mark.parametrize(
    "other",
    [
        run([0, 2], u=[1, 2], h=[3, 4]),
        run([0, 1], u=[1, 2.5], h=[3, 4]),
        run([0, 1], u=[3, 4], h=[1, 2]),
        run([0, 1], u=[1, 2], g=[3, 4]),
        run([0, 1], u=[1, 2]),
        run([0, 1], u=[1, np.nan], h=[3, 4]),
    ],
    ids=["time", "value", "swapped", "renamed", "fewer", "empty cell"],
)
def test_hash_tells_runs_apart(other):
    assert run([0, 1], u=[1, 2], h=[3, 4]).content_hash != other.content_hash


def test_gap_is_more_than_three_median_steps():
    t = 1.7e9 + np.array([0, 0.01, 0.02, 0.05, 0.06, 0.101, 0.11, 0.12])
    np.testing.assert_array_equal(np.flatnonzero(gaps(t)), [4])  # 0.03 is not above 3 * 0.01


def test_segments_split_at_gaps_and_empty_cells():
    nan = np.nan
    log = run(
        [0, 1, 2, 3, 4, 8, 9, 10, 11, 12],
        u=[1, 1, nan, 1, 1, 1, 1, 1, nan, 1],
        h=[1, 1, 1, 1, 1, 1, 1, 1, 1, 1],
    )
    assert segments(log, ["u", "h"]) == [slice(0, 2), slice(3, 5), slice(5, 8)]
    assert segments(log, ["h"]) == [slice(0, 5), slice(5, 10)]
    assert segments(log, []) == [slice(0, 5), slice(5, 10)]


def test_no_segment_where_nothing_hangs_together():
    nan = np.nan
    assert segments(run([0, 1, 2], u=[1, nan, 1]), ["u"]) == []


@given(st.lists(st.tuples(st.sampled_from([1.0, 1.0, 1.0, 9.0]), st.booleans()), min_size=2))
def test_segments_cover_exactly_the_joined_samples(samples):
    steps = [step for step, _ in samples]
    u = np.array([1.0 if sampled else np.nan for _, sampled in samples])
    log = run(np.cumsum(steps), u=u)
    expected, current = [], []
    median = np.median(np.diff(log.t))
    for k in range(len(u)):  # the definition, one sample at a time
        if current and (np.isnan(u[k]) or log.t[k] - log.t[k - 1] > 3 * median):
            expected.append(current)
            current = []
        if not np.isnan(u[k]):
            current.append(k)
    expected.append(current)
    expected = [part for part in expected if len(part) >= 2]
    found = [list(range(len(u)))[part] for part in segments(log, ["u"])]
    assert found == expected


def test_cut_keeps_what_it_says():
    part = cut(run([0, 1, 2, 3], u=[4, 5, 6, 7]), slice(1, 3))
    np.testing.assert_array_equal(part.t, [1, 2])
    np.testing.assert_array_equal(part.columns["u"], [5, 6])
    assert (part.name, part.source) == ("a", "a.csv")
