"""Points outside what a training log covered."""

import numpy as np

from faultgauge.reporting.coverage import outside


def ring(points: int) -> np.ndarray:
    angle = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, points)
    radius = np.random.default_rng(2).uniform(9.0, 11.0, points)
    return np.stack([radius * np.cos(angle), 1e-4 * radius * np.sin(angle)], axis=1)


def test_the_training_points_themselves_are_inside():
    assert not outside(ring(5000), ring(5000)).any()


def test_a_hole_in_the_data_is_outside_though_within_the_range():
    inside_the_hole = np.array([[0.0, 0.0], [3.0, 1e-4], [-2.0, -3e-4]])
    assert outside(ring(5000), inside_the_hole).all()


def test_beyond_the_range_is_outside_on_every_side():
    far = np.array([[30.0, 0.0], [-30.0, 0.0], [10.0, 5e-3], [10.0, -5e-3], [1e300, 1e300]])
    assert outside(ring(5000), far).all()


def test_just_beyond_the_range_is_near_enough():
    # 0.2 beyond a radius of 11; the cells are 22/35 = 0.63 wide, and one cell's distance counts.
    assert not outside(ring(5000), np.array([[11.2, 0.0]])).any()


def test_unknown_points_are_not_outside():
    assert not outside(ring(100), np.array([[np.nan, 0.0], [np.nan, np.nan]])).any()


def test_a_constant_argument():
    training = np.stack([np.linspace(0.0, 1.0, 200), np.full(200, 5.0)], axis=1)
    assert outside(training, np.array([[0.5, 5.0], [0.5, 50.0]])).tolist() == [False, True]


def test_without_training_data_everything_is_outside():
    assert outside(np.empty((0, 2)), np.zeros((2, 2))).all()
