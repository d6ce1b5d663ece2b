"""What a run takes one value of: listed, or between two ends."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pydantic

from faultgauge.plants.toml_file import Number, SchemaTable

__all__ = ["Axis", "AxisOf"]


@dataclass(frozen=True)
class Axis:
    """The `values` of a grid. A random design draws one of them, or, where they stand for a range,
    `between` its ends: evenly, or evenly in the logarithm, and of either sign where `signs`."""

    values: tuple[float, ...]
    between: tuple[float, float] | None = None
    log: bool = False
    signs: bool = False

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the largest value."""
        return min(self.values), max(self.values)

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        if self.between is None:
            return float(rng.choice(self.values))
        low, high = self.between
        share = rng.uniform()
        size = low * (high / low) ** share if self.log else low + (high - low) * share
        return float(size * (rng.choice([-1.0, 1.0]) if self.signs else 1.0))


class _Range(SchemaTable):
    low: Number
    high: Number
    count: Annotated[int, pydantic.Field(ge=2, le=1000)] = 8
    log: bool = False
    signs: bool = False

    @pydantic.model_validator(mode="after")
    def _forwards(self) -> "_Range":
        if self.low >= self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}")
        if self.log and self.low * self.high <= 0:
            raise ValueError("log = true needs two ends of one sign, neither of them 0")
        return self

    @property
    def axis(self) -> Axis:
        ends = (self.low, self.high)
        values = (np.geomspace if self.log else np.linspace)(*ends, self.count).tolist()
        every = [each for v in values for each in ((v, -v) if self.signs else (v,))]
        return Axis(tuple(every), ends, self.log, self.signs)


_LIST = pydantic.TypeAdapter(list[Number], config=pydantic.ConfigDict(strict=True))


def _axis(given: Any) -> Axis:
    if isinstance(given, dict):
        try:
            return _Range.model_validate(given).axis
        except pydantic.ValidationError as failure:
            error = failure.errors()[0]
            place = "".join(f"{part}: " for part in error["loc"])
            raise ValueError(f"{place}{error['msg'].removeprefix('Value error, ')}") from None
    try:
        values = _LIST.validate_python(given if isinstance(given, list) else [given])
    except pydantic.ValidationError:
        raise ValueError(
            "should be a number, a list of them, or {low = ..., high = ..., count = ..., "
            "log = true, signs = true}"
        ) from None
    if not values:
        raise ValueError("holds no value, so the grid is empty; give one at least")
    return Axis(tuple(dict.fromkeys(float(each) for each in values)))


AxisOf = Annotated[Axis, pydantic.PlainValidator(_axis)]
