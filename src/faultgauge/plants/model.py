"""The fitted model and its file (`.fgm`): safetensors with one key of canonical JSON.

No pickle, no code, no timestamps: loading a stranger's model is safe, the same fit gives the
same bytes, and a damaged or altered file is refused by name.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import safetensors
import safetensors.numpy

from faultgauge.errors import InputError
from faultgauge.files import read_within, write_atomically
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.record import (
    CalibrationRecord,
    FitRecord,
    ReadingRecord,
    calibration_in,
    check_record,
    fit_in,
)
from faultgauge.plants.settle import settle
from faultgauge.plants.spec import PlantSpec

__all__ = ["Model", "decoded", "encoded", "load_model", "save_model"]

KEY = "faultgauge"
FORMAT = 1  # of model files
MAX_BYTES = 100_000_000  # of a model file
MEMBERS = "members/"


@dataclass(frozen=True)
class Model:
    """A fitted plant and what is known about the fit.

    `record` is what the fit did and found. `members` are the other plants of an ensemble, `plant`
    being its best; the record counts them. `calibration` is what `calibrate` found, if asked.
    """

    plant: GrayBoxPlant
    record: FitRecord
    members: tuple[GrayBoxPlant, ...] = ()
    calibration: CalibrationRecord | None = None

    @property
    def max_step(self) -> float:
        """Longest RK4 step [s] that the fitted dynamics allow."""
        return float(self.record.max_step)

    @property
    def resample(self) -> float | None:
        """The rate [Hz] that faster logs are brought to before the model sees them, if any."""
        return self.record.resample

    @property
    def reading(self) -> dict[str, Any]:
        """What was said of the logs at the fit: their `time` column, its `time_format`, `maps`."""
        return self.record.reading.as_dict()

    def with_reading(self, said: dict[str, Any]) -> "Model":
        """The model that remembers how its logs were read, where anything was `said`."""
        return (
            replace(self, record=self.record.but(reading=ReadingRecord(**said))) if said else self
        )

    def with_calibration(self, calibration: CalibrationRecord | None) -> "Model":
        """The model with what calibration found; None: with none."""
        return replace(self, calibration=calibration)

    def with_resample(self, rate: float) -> "Model":
        """The model with a `rate` [Hz] that faster logs are brought to."""
        return replace(self, record=self.record.but(resample=rate))

    def with_members(self, members: Sequence[GrayBoxPlant]) -> "Model":
        """The model as the best of an ensemble, `members` being the others."""
        record = self.record.but(members=len(members))
        return replace(self, record=record, members=tuple(members))


def tensors(plant: GrayBoxPlant) -> dict[str, np.ndarray]:
    """Every number of the plant by name: `parameters/M`, `networks/NN1/bias`."""
    named = {f"parameters/{name}": value for name, value in plant.parameters.items()}
    for name, network in plant.networks.items():
        named |= {f"networks/{name}/{field}": value for field, value in network.arrays().items()}
    return {name: np.asarray(named[name], np.float64, order="C") for name in sorted(named)}


def _all_tensors(model: Model) -> dict[str, np.ndarray]:
    """The plant's tensors, and those of its k-th member as `members/k/...`, k from 1 on."""
    named = tensors(model.plant)
    for k, member in enumerate(model.members, 1):
        named |= {f"{_prefix(k)}{name}": value for name, value in tensors(member).items()}
    return named


def _prefix(member: int) -> str:
    return f"{MEMBERS}{member}/"


def digest(arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 over names, shapes and bytes of all tensors."""
    sha = hashlib.sha256()
    for name in sorted(arrays):
        sha.update(f"{name}{arrays[name].shape}".encode())
        sha.update(arrays[name].astype("<f8").tobytes())
    return sha.hexdigest()


def canonical(content: dict[str, Any]) -> str:
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def save_model(model: Model, path: str | Path) -> None:
    """Write `model` to the file `path`; an existing one is replaced whole or not at all."""
    write_atomically(path, encoded(model))


def encoded(model: Model) -> bytes:
    """What a model file holds; the same model gives the same bytes. Raises `InputError` for a plant
    that is written in Python: a model file holds no code."""
    spec = model.plant.spec
    if not spec.text:
        raise InputError(
            f"plant {spec.name!r} is written in Python, and a model file holds no code; use the "
            "model where it was made, or write the plant as a plant file."
        )
    arrays = _all_tensors(model)
    record = model.record.as_dict()
    if model.calibration is not None:
        record["calibration"] = model.calibration.as_dict()
    content = {
        "format": FORMAT,
        "plant": spec.text,
        "record": record,
        "sha256": digest(arrays),
    }
    content["seal"] = hashlib.sha256(canonical(content).encode()).hexdigest()
    return safetensors.numpy.save(arrays, {KEY: canonical(content)})


def load_model(path: str | Path) -> Model:
    """Read the model file `path`. Raises `InputError` that names it and what is wrong with it."""
    try:
        data = read_within(path, MAX_BYTES, "which no model file does; check the path")
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be read ({failure.strerror}); give a model file made by "
            "`faultgauge fit`."
        ) from None
    return decoded(data, path)


def decoded(data: bytes, path: str | Path) -> Model:
    """The model that is `encoded` in `data`, which came from `path`; errors as `load_model`."""
    advice = f"; write it anew with `faultgauge fit ... --out {path}`"
    try:
        arrays = safetensors.numpy.load(data)
        size = int.from_bytes(data[:8], "little")
        header = json.loads(data[8 : 8 + size]).get("__metadata__", {})
    except (safetensors.SafetensorError, ValueError, KeyError, RecursionError):
        if Path(path).suffix == ".toml":
            raise InputError(
                f"{path}: a plant file, and no model yet; make one of it by `faultgauge fit {path} "
                "LOG...`."
            ) from None
        raise InputError(
            f"{path}: not a model file, or cut short; give one made by `faultgauge fit`."
        ) from None
    if KEY not in header:
        raise InputError(f"{path}: a safetensors file, but not one of faultgauge's{advice}.")
    try:
        content = json.loads(header[KEY])
        seal = content.pop("seal")
        if content["format"] != FORMAT:
            raise InputError(
                f"{path}: format {content['format']!r}, but this faultgauge reads {FORMAT}{advice}."
            )
        if seal != hashlib.sha256(canonical(content).encode()).hexdigest():
            raise InputError(f"{path}: its description was altered or damaged{advice}.")
        if content["sha256"] != digest(arrays):
            raise InputError(f"{path}: its numbers were altered or damaged{advice}.")
        calibration = calibration_in(content["record"].pop("calibration", None))
        record = fit_in(content["record"])
        left_open = parse_plant(content["plant"], str(path))
        chosen = record.choices
        left_open = settle(left_open, delays=chosen.delay)
        spec = settle(left_open, chosen.hold, chosen.hidden)
        own = {name: array for name, array in arrays.items() if not name.startswith(MEMBERS)}
        rest = {name: array for name, array in arrays.items() if name.startswith(MEMBERS)}
        members = _members(left_open, chosen.hold, record.members, rest)
        check_record(record, calibration, spec)
        return Model(filled(GrayBoxPlant.untrained(spec), own), record, members, calibration)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise InputError(f"{path}: its description is damaged{advice}.") from None


def _members(
    spec: PlantSpec, holds: dict[str, str], count: int, arrays: dict[str, np.ndarray]
) -> tuple[GrayBoxPlant, ...]:
    """The `count` members; where the file leaves a network's size open, each has its own."""
    found, read = [], 0
    for k in range(1, count + 1):
        start = _prefix(k)
        each = {n.removeprefix(start): a for n, a in arrays.items() if n.startswith(start)}
        sizes = {name: len(each[f"networks/{name}/bias"]) for name in spec.open_sizes}
        found.append(filled(GrayBoxPlant.untrained(settle(spec, holds, sizes)), each))
        read += len(each)
    if read != len(arrays):
        raise KeyError("members")
    return tuple(found)


def filled(plant: GrayBoxPlant, arrays: dict[str, np.ndarray]) -> GrayBoxPlant:
    """`plant` with the numbers of a model file; KeyError or ValueError where they do not fit."""
    wanted = tensors(plant)
    if wanted.keys() != arrays.keys():
        raise KeyError("tensors")
    for name, array in arrays.items():
        fits = array.shape == wanted[name].shape and array.dtype == np.float64
        if not fits or not np.all(np.isfinite(array)):
            raise ValueError(name)
    networks = {
        name: Network(
            **{key: jax.device_put(arrays[f"networks/{name}/{key}"]) for key in network.arrays()},
            shape=network.shape,
        )
        for name, network in plant.networks.items()
    }
    parameters = {name: jax.device_put(arrays[f"parameters/{name}"]) for name in plant.parameters}
    return eqx.tree_at(lambda p: (p.networks, p.parameters), plant, (networks, parameters))
