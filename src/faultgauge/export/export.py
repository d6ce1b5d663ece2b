"""`export`: a calibrated model as files for another machine."""

import hashlib
import re
from pathlib import Path
from typing import Literal

from faultgauge.errors import InputError
from faultgauge.export.compile import identifier
from faultgauge.export.entry import bank_of, step_of
from faultgauge.export.request import Request
from faultgauge.export.targets import TARGETS
from faultgauge.plants.model import load_model

__all__ = ["Precision", "Tanh", "export"]

Precision = Literal["double", "single"]
Tanh = Literal["exact", "fast"]


def export(
    path: str | Path,
    to: str = "c",
    *,
    name: str | None = None,
    precision: Precision = "double",
    tanh: Tanh = "exact",
) -> dict[str, bytes]:
    """The files, by name, of the model file `path` for the target `to`.

    `name` is that of the files and functions, by default the plant's. Raises `InputError` where
    the model is not calibrated or the target cannot carry it.
    """
    if to not in TARGETS:
        raise InputError(f"--to {to}: no such target; legal is {', '.join(TARGETS)}.")
    if name is not None and not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        raise InputError(
            f"--name {name}: functions are called so; begin with a letter and use letters, digits "
            "and _ only."
        )
    model = load_model(path)
    bank = bank_of(model)
    plant = model.plant.spec.name
    request = Request(
        step=step_of(bank),
        period=bank.step,
        name=name or identifier(plant).lower(),
        title=plant,
        about=_about(bank.model.plant.signals.fault_names),
        digest=hashlib.sha256(Path(path).read_bytes()).hexdigest(),
        single=precision == "single",
        fast_tanh=tanh == "fast",
    )
    return TARGETS[to].files(request)


def _about(faults: tuple[str, ...]) -> str:
    return (
        "The fitted model of the healthy plant runs beside it, and with it the posterior over its "
        f"declared faults ({', '.join(faults)}): which there are, and how large."
    )
