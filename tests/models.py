"""Models that nobody fitted."""

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.record import FitRecord


def as_stated(text, points, states=(("x", 0),), outputs=("x",)):
    """The plant with the values of its file `text`, its `points` (states, then inputs) being what
    training covered, and `states` the columns, with the derivative, that they come from."""
    columns = {"states": [list(each) for each in states], "outputs": list(outputs)}
    record = record_of(envelope_points=points.tolist(), columns=columns)
    return Model(GrayBoxPlant.untrained(parse_plant(text)), record)


def record_of(**told):
    """What a fit has `told`, and of the rest what it tells where there is nothing to tell."""
    nothing = {
        "max_step": 1.0,
        "sample_time": 1.0,
        "columns": {"states": []},
        "data": {"fit": [], "validate": []},
        "derivatives": {},
        "envelope": {},
        "envelope_points": [],
        "metrics": {"validation_free_run_nrmse": None},
    }
    return FitRecord.model_validate(nothing | told)
