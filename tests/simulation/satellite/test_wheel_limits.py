"""A wheel at the limit of its momentum takes up no more torque, and gives back freely."""

import numpy as np

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.satellite.observatory import AXES, run

LIMIT = 60.0  # N*m*s; the slew wants to bring the pitch wheel from 40 to 97
PLANT = f"""
name = "small wheel"
[states.h]
min = {-LIMIT}
max = {LIMIT}
derivative = "u"
[inputs.u]
min = -0.82
max = 0.82
[outputs.T]
value = "d(h)"
[outputs.hm]
value = "h"
"""


def test_a_full_wheel_gives_no_torque_until_it_is_asked_to_slow_down():
    flown = run(GrayBoxPlant.untrained(parse_plant(PLANT)), 300.0, 0)
    pitch = AXES.index("pitch")
    h, torque, u = (np.asarray(x)[:, pitch] for x in (flown.momentum, flown.torque, flown.u))
    # the limit is looked at in every stage of a step of 0.05 s: at most one step's torque is over
    assert h.max() <= LIMIT + 0.82 * 0.05
    full = (h >= LIMIT) & (u > 0)
    assert full.sum() > 20
    np.testing.assert_array_equal(torque[full], 0.0)
    leaving = (h >= LIMIT) & (u < 0)
    np.testing.assert_array_equal(torque[leaving], u[leaving])
    assert h[-1] < LIMIT - 1.0  # it came back from there
