"""Sharing torque out among wheels, against constrained least squares and by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.accommodation.allocation import allocate, null_projector
from faultgauge_studies.paper.accommodating.pyramid import AXES, NULL

TAU = np.array([0.3, -0.2, 0.5])


def test_the_pyramid_costs_the_same_in_every_direction():
    # columns of unit length with A A^T = 4/3 I
    assert np.linalg.norm(AXES, axis=0) == pytest.approx(np.ones(4))
    assert pytest.approx(np.eye(3) * 4 / 3) == AXES @ AXES.T


@pytest.mark.parametrize("left", [(1, 1, 1, 1), (1, 0.5, 1, 0.3), (0.2, 1, 1, 1)])
def test_torques_are_those_of_least_commands(left):
    """Minimise sum (t/e)^2 subject to A t = -tau: solved here by its Lagrange conditions."""
    left = np.array(left, float)
    t = np.asarray(allocate(jnp.asarray(AXES), jnp.asarray(left**2), jnp.asarray(TAU)))
    K = np.block([[np.diag(1 / left**2), AXES.T], [AXES, np.zeros((3, 3))]])
    expected = np.linalg.solve(K, np.concatenate([np.zeros(4), -TAU]))[:4]
    assert t == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("lost", range(4))
def test_three_wheels_do_what_four_did(lost):
    weights = np.ones(4)
    weights[lost] = 0.0
    t = np.asarray(allocate(jnp.asarray(AXES), jnp.asarray(weights), jnp.asarray(TAU)))
    assert t[lost] == 0.0
    rest = np.delete(np.arange(4), lost)
    assert t[rest] == pytest.approx(np.linalg.solve(AXES[:, rest], -TAU), abs=1e-9)


def test_two_wheels_do_what_they_can():
    """Least squares in the plane that is left, and nothing large."""
    weights = np.array([1.0, 1.0, 0.0, 0.0])
    t = np.asarray(allocate(jnp.asarray(AXES), jnp.asarray(weights), jnp.asarray(TAU)))
    expected = np.linalg.lstsq(AXES[:, :2], -TAU, rcond=None)[0]
    assert t == pytest.approx([*expected, 0, 0], abs=1e-9)


def test_null_motion_leaves_the_body_alone():
    assert pytest.approx(np.zeros(3), abs=1e-12) == AXES @ NULL
    N = np.asarray(null_projector(jnp.asarray(AXES), jnp.ones(4, bool)))
    assert pytest.approx(np.outer(NULL, NULL) / 4, abs=1e-9) == N


@pytest.mark.parametrize("lost", range(4))
def test_with_a_wheel_lost_there_is_none(lost):
    used = jnp.arange(4) != lost
    N = np.asarray(null_projector(jnp.asarray(AXES), used))
    assert pytest.approx(np.zeros((4, 4)), abs=1e-9) == N
