"""`plant` and `load`: what to fit, and what was fitted."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import Model, load_model
from faultgauge.plants.plant import Plant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.toml_text import toml_text
from faultgauge.plants.written import written

__all__ = ["load", "model_of", "plant"]


def plant(source: Any) -> GrayBoxPlant:
    """An untrained plant.

    **Arguments**

    - `source`: the path of a plant file, the name of a preset (`"tank"`), the text of a plant file
      (which has lines or an `=`), a dict of its tables, or a subclass of `Plant` in Python. What
      is read already is given back as it is.

    Raises `InputError` that names the key and the column of the first mistake.
    """
    if isinstance(source, GrayBoxPlant):
        return source
    if isinstance(source, Plant):
        return written(source)
    if isinstance(source, Mapping):
        return _parsed(toml_text(source), "the plant's dict")
    if isinstance(source, str) and ("\n" in source or "=" in source):
        return _parsed(source, "the plant's text")
    if isinstance(source, str | Path):
        return load_plant(source)
    raise InputError(
        f"a {type(source).__name__} is no plant; give a plant file, a preset, the text of a plant "
        "file, a dict of its tables, or an object of a class that is a `faultgauge.Plant`."
    )


def load(path: str | Path) -> Model:
    """Read the model file `path` (`.fgm`), as `faultgauge fit` and `save_model` write it.

    Raises `InputError` that names the file and what is wrong with it.
    """
    return model_of(path)


def model_of(given: Any) -> Model:
    """A model, or the one in the file of that name."""
    if isinstance(given, Model):
        return given
    if isinstance(given, str | Path):
        return load_model(given)
    raise InputError(
        f"a {type(given).__name__} is no fitted model; give the `.model` of `faultgauge.fit` or "
        "`faultgauge.calibrate`, or a model file."
    )


def _parsed(text: str, source: str) -> GrayBoxPlant:
    return GrayBoxPlant.untrained(parse_plant(text, source))
