"""The fitted model and its file (`.fgm`): safetensors with one key of canonical JSON.

No pickle, no code, no timestamps: loading a stranger's model is safe, the same fit gives the
same bytes, and a damaged or altered file is refused by name.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy

from faultgauge.errors import InputError
from faultgauge.files import write_atomically
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.plant_file import parse_plant

__all__ = ["Model", "load_model", "save_model"]

KEY = "faultgauge"
FORMAT = 1
MAX_BYTES = 100_000_000


@dataclass(frozen=True)
class Model:
    """A fitted plant and what is known about the fit.

    `record` is plain JSON: training envelope, metrics, data hashes, time steps, versions and,
    after `calibrate`, the calibration.
    """

    plant: GrayBoxPlant
    record: dict[str, Any]

    @property
    def max_step(self) -> float:
        """Longest RK4 step [s] that the fitted dynamics allow."""
        return float(self.record["max_step"])

    @property
    def calibration(self) -> dict[str, Any] | None:
        return self.record.get("calibration")

    def with_calibration(self, calibration: dict[str, Any]) -> "Model":
        return Model(self.plant, {**self.record, "calibration": calibration})


def tensors(plant: GrayBoxPlant) -> dict[str, np.ndarray]:
    """Every number of the plant by name: `parameters/M`, `networks/NN1/bias`."""
    named = {f"parameters/{name}": value for name, value in plant.parameters.items()}
    for name, network in plant.networks.items():
        named |= {f"networks/{name}/{field}": value for field, value in vars(network).items()}
    return {name: np.asarray(named[name], np.float64, order="C") for name in sorted(named)}


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
    """Write `model`; an existing file is replaced whole or not at all."""
    arrays = tensors(model.plant)
    content = {
        "format": FORMAT,
        "plant": model.plant.spec.text,
        "record": model.record,
        "sha256": digest(arrays),
    }
    content["seal"] = hashlib.sha256(canonical(content).encode()).hexdigest()
    write_atomically(path, safetensors.numpy.save(arrays, {KEY: canonical(content)}))


def load_model(path: str | Path) -> Model:
    """Read a model file. Raises `InputError` that names the file and what is wrong with it."""
    advice = f"; write it anew with `faultgauge fit ... --out {path}`"
    try:
        if Path(path).stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than 100 MB, which no model file is; check the path.")
        data = Path(path).read_bytes()
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be read ({failure.strerror}); give a model file made by "
            "`faultgauge fit`."
        ) from None
    try:
        arrays = safetensors.numpy.load(data)
        size = int.from_bytes(data[:8], "little")
        header = json.loads(data[8 : 8 + size]).get("__metadata__", {})
    except (safetensors.SafetensorError, ValueError, KeyError, RecursionError):
        raise InputError(f"{path}: not a model file, or cut short{advice}.") from None
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
        plant = GrayBoxPlant.untrained(parse_plant(content["plant"], str(path)))
        model = Model(filled(plant, arrays), content["record"])
        if not 0 < model.max_step < np.inf:
            raise ValueError("max_step")
        return model
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{path}: its description is damaged{advice}.") from None


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
            **{field: jnp.asarray(arrays[f"networks/{name}/{field}"]) for field in vars(network)}
        )
        for name, network in plant.networks.items()
    }
    parameters = {name: jnp.asarray(arrays[f"parameters/{name}"]) for name in plant.parameters}
    return eqx.tree_at(lambda p: (p.networks, p.parameters), plant, (networks, parameters))
