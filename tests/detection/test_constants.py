"""How uncertain the constants are that the bank tracks, by hand."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.bank.uncertain_constants import constants_of
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant import respond
from faultgauge.plants.plant_file import parse_plant
from models import record_of

HOIST = """
name = "load on a rope"
[states.s]
derivative = "v"
[states.v]
derivative = "(F - k*s - c*v)/m"
[inputs.F]
[outputs.s]
value = "s"
[parameters.k]
value = 500
min = 0
[parameters.c]
value = 3
min = 0
[parameters.m]
value = 20
min = 1
vary = "run"
"""


def test_of_a_constant_of_each_run_as_far_as_runs_lie_apart_and_which_are_positive():
    """Each load's mass differs by 30 %, whatever the standard error of what has no value of its
    own; the file's limits make all three positive."""
    plant = GrayBoxPlant.untrained(parse_plant(HOIST))
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    record = record_of(
        envelope_points=points.tolist(),
        constants={
            "names": ["k", "c", "m"],
            "errors": [400.0, 1.0, 9e5],
            "correlation": [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]],
        },
        between={"apart": {"m": 0.3}, "off": {"s": 0.1}, "lasting": 2.0},
    )
    found = constants_of(model := Model(plant, record))
    assert found.names == ("k", "c", "m")
    wanted = [[400**2, 200, 0], [200, 1, 0], [0, 0, 36]]
    assert found.covariance == pytest.approx(np.array(wanted, float), abs=1e-9)
    assert found.positive == (0, 1, 2)
    # a calibration tells of what it tracks, whatever was asked before; without one, as ever
    noise = {"sigma": {"s": 0.1}, "spread": {"k": 1.0, "m": 1.0}}
    assert constants_of(for_bank(model, noise)).names == ("k", "m")
    assert constants_of(model).names == ("k", "c", "m")


def test_what_no_log_tells_is_as_sure_as_the_bounds_of_the_file():
    """k and c, each by far less sure than its bounds, of which only the ratio is told; m has none,
    and a tenth part in common with k. By inverses: P^-1 + D^-1, D being width^2 / 12 or nothing."""
    bounded = HOIST.replace("value = 500\nmin = 0", "value = 500\nmin = 0\nmax = 1200")
    bounded = bounded.replace("value = 3\nmin = 0", "value = 3\nmin = 0\nmax = 12")
    plant = GrayBoxPlant.untrained(parse_plant(bounded))
    errors, correlation = np.array([5e4, 300.0, 1.5]), np.eye(3)
    correlation[0, 1] = correlation[1, 0] = 0.9999
    correlation[0, 2] = correlation[2, 0] = 0.1
    correlation[1, 2] = correlation[2, 1] = 0.1
    record = record_of(
        envelope_points=np.random.default_rng(0).uniform(-1, 1, (20, 3)).tolist(),
        constants={
            "names": ["k", "c", "m"],
            "errors": errors.tolist(),
            "correlation": correlation.tolist(),
        },
    )
    P = correlation * np.outer(errors, errors)
    wanted = np.linalg.inv(np.linalg.inv(P) + np.diag([12 / 1200**2, 12 / 12**2, 0.0]))
    np.testing.assert_allclose(constants_of(Model(plant, record)).covariance, wanted, rtol=1e-6)


DRAG = """
name = "cart"
[states.v]
derivative = "u - drag(v) - play(v, u)"
[inputs.u]
[outputs.v]
value = "v"
[networks.drag]
hidden = 2
[networks.play]
hidden = 1
[faults.fouling]
enters = "network"
target = "play"
"""


def test_the_gain_of_a_network_is_a_constant_of_each_run():
    """Of an untrained network, which is 0 everywhere, no gain moves anything; one of 0.3 moves v'
    by 0.3, and a gain of 1.2 by 0.36."""
    plant = GrayBoxPlant.untrained(parse_plant(DRAG))
    drag = replace(plant.networks["drag"], output_center=jnp.asarray(0.3))
    plant = replace(plant, networks=plant.networks | {"drag": drag})
    points = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    found = constants_of(Model(plant, record_of(envelope_points=points.tolist())))
    assert found.names == ("drag", "play")
    assert found.positive == ()  # it differs by a percent or so
    assert not found.covariance.any()
    nothing = Error(*[np.zeros(0)] * 3)
    unsure = 0.1 * jnp.eye(2)
    run = Disturbed.of(plant, (), (), nothing, found.names, jnp.zeros(2), unsure, positive=(0, 1))
    dx, _ = respond(run, jnp.array([0.0, 2.0, 0.0]), jnp.array([1.0]))
    assert float(dx[0]) == pytest.approx(1 - 1.2 * 0.3)


@pytest.mark.parametrize(
    ("share", "tracked"),
    [
        (1.0, 10),  # no more than ten
        (0.7, 8),  # sums of 0.49^k: 1 - 0.49^8 = 0.9967 of all, 0.9932 with seven
        (0.3, 6),  # 1 - 0.09^3 = 0.9993, but no fewer than six
    ],
)
def test_those_that_matter_are_tracked_and_those_that_a_fault_changes(share, tracked):
    """Of twelve on one state, each so much as strong as the one before, by the geometric series of
    their squares; the weakest is a fault's, and stays."""
    text = 'name = "sums"\n[states.v]\nderivative = "u - '
    text += " - ".join(f"c{k}*v" for k in range(12)) + '"\n[inputs.u]\n[outputs.v]\nvalue = "v"\n'
    text += "".join(f"[parameters.c{k}]\nvalue = 1\n" for k in range(12))
    text += '[faults.worn]\nenters = "parameter"\ntarget = "c11"\nrelative = true\n'
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    names, errors = [f"c{k}" for k in range(12)], [1e3 * share**k for k in range(12)]
    told = {"names": names, "errors": errors, "correlation": np.eye(12).tolist()}
    record = record_of(envelope_points=points.tolist(), constants=told)
    found = constants_of(Model(GrayBoxPlant.untrained(parse_plant(text)), record))
    assert sorted(found.names, key=names.index) == [*names[:tracked], "c11"]


def test_what_moves_an_output_most_is_tracked_however_little_that_is():
    """Eleven constants of a state's rate do all but a thousandth of what constants do; the scale of
    a second output, which no other moves, does a tenth of the least of them, and is one of each
    run nevertheless: what is not tracked looks like a fault that is as old as the log."""
    text = 'name = "sums"\n[states.v]\nderivative = "u - '
    text += " - ".join(f"c{k}*v" for k in range(11)) + '"\n[inputs.u]\n[outputs.v]\nvalue = "v"\n'
    text += '[outputs.shown]\nvalue = "scale*u"\n[parameters.scale]\nvalue = 1\n'
    text += "".join(f"[parameters.c{k}]\nvalue = 1\n" for k in range(11))
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    names = ["scale", *(f"c{k}" for k in range(11))]
    errors = [1e-3, *(0.5 + 0.01 * k for k in range(11))]
    told = {"names": names, "errors": errors, "correlation": np.eye(12).tolist()}
    record = record_of(envelope_points=points.tolist(), constants=told)
    found = constants_of(Model(GrayBoxPlant.untrained(parse_plant(text)), record))
    assert len(found.names) == 10
    assert "scale" in found.names
