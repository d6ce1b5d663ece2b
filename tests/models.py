"""Models that nobody fitted."""

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant


def as_stated(text, points, states=(("x", 0),), outputs=("x",)):
    """The plant with the values of its file `text`, its `points` (states, then inputs) being what
    training covered, and `states` the columns, with the derivative, that they come from."""
    record = {
        "max_step": 1.0,
        "envelope_points": points.tolist(),
        "columns": {"states": [list(each) for each in states], "outputs": list(outputs)},
        "data": {"fit": [], "validate": []},
    }
    return Model(GrayBoxPlant.untrained(parse_plant(text)), record)
