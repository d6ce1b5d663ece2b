"""`plant` and `load`: from whatever a user has."""

import numpy as np
import pytest

import faultgauge as fg
from faultgauge.errors import InputError

TEXT = """name = "tank"
[states.x]
unit = "m"
derivative = "b*u - a*x"
trusted = [-1.0, 2]
[inputs.u]
unit = "V"
hold = "zero"
[outputs.x]
value = "x"
unit = "m"
[parameters]
a = { value = 1.0, fixed = true }
b = { value = 0.5, unit = "m/s/V" }
"""
TABLES = {
    "name": "tank",
    "states": {"x": {"unit": "m", "derivative": "b*u - a*x", "trusted": [-1.0, 2]}},
    "inputs": {"u": {"unit": "V", "hold": "zero"}},
    "outputs": {"x": {"value": "x", "unit": "m"}},
    "parameters": {
        "a": {"value": 1.0, "fixed": True},
        "b": {"value": np.float64(0.5), "unit": "m/s/V"},
    },
}


def test_a_text_a_file_and_a_dict_are_one_plant(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(TEXT)
    wanted = fg.load_plant(file).spec
    for source in (file, str(file), TEXT, TABLES):
        spec = fg.plant(source).spec
        assert spec.signals == wanted.signals
        assert spec.parameters == wanted.parameters
        assert [e.text for e in spec.derivatives] == [e.text for e in wanted.derivatives]


def test_a_preset_by_its_name_and_a_plant_as_it_is():
    tank = fg.plant("tank")
    assert tank.spec.text == fg.load_plant("tank").spec.text
    assert fg.plant(tank) is tank


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (3.0, "a float is no plant; give a plant file, a preset"),
        ("nowhere.toml", "nowhere.toml: cannot be read"),
        ("name = 'a'\nsates = 1", "the plant's text: .*unknown key 'sates'"),
        ({"states": {"x": {"derivative": object()}}}, "the plant's dict, .*: a object is neither"),
        ({"states": {"x": {"derivativ": "u"}}}, "the plant's dict: .*'derivativ'"),
    ],
)
def test_what_is_no_plant_is_refused(source, said):
    with pytest.raises(InputError, match=said):
        fg.plant(source)


def test_what_is_no_model_is_refused(tmp_path):
    with pytest.raises(InputError, match="a dict is no fitted model"):
        fg.estimate({}, {"t": [0.0, 1.0]})
    with pytest.raises(InputError, match="cannot be read"):
        fg.load(tmp_path / "none.fgm")
