"""A state may share an output's name only where both are the same signal."""

import pytest

from faultgauge.errors import InputError
from faultgauge.plants.plant_file import parse_plant

TEXT = """
name = "p"
[states.x]
derivative = "-x"
[outputs.x]
value = "{value}"
"""


def test_an_output_that_is_the_state_may_share_its_name():
    assert parse_plant(TEXT.format(value="x")).signals.outputs[0].measures == "x"


def test_an_output_that_is_not_the_state_may_not():
    with pytest.raises(InputError, match=r"\[outputs.x\] has the name of a state"):
        parse_plant(TEXT.format(value="2*x"))
