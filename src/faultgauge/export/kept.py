"""What takes long to make, kept in a folder of the user's by a hash of what it is made from."""

import hashlib
import io
import pickle
from collections.abc import Callable
from functools import cache
from importlib import metadata
from pathlib import Path
from types import FunctionType
from typing import Any

import faultgauge
from faultgauge.files import write_atomically

__all__ = ["hash_of", "kept"]

OWN = ("faultgauge", "jax", "jaxlib", "equinox", "numpy", "builtins", "ast", "collections")


def kept(path: Path, make: Callable[[], bytes]) -> bytes:
    """The bytes at `path`, made where they are not there. The last bytes of the file are a hash of
    the others, so that a damaged one is made anew."""
    size = hashlib.sha256().digest_size
    data = path.read_bytes() if path.is_file() else b""
    if len(data) > size and hashlib.sha256(data[:-size]).digest() == data[-size:]:
        return data[:-size]
    made = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, made + hashlib.sha256(made).digest())
    return made


def hash_of(*objects: Any) -> str | None:
    """Of `objects` and all code that there is to do something with them; None where they hold code
    of others, of which only the name is known."""
    file = io.BytesIO()
    try:
        _Pickler(file).dump(objects)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    return hashlib.sha256(_code() + file.getvalue()).hexdigest()


class _Pickler(pickle.Pickler):
    def persistent_id(self, obj: Any) -> None:
        if isinstance(obj, type | FunctionType) and obj.__module__.split(".")[0] not in OWN:
            raise pickle.PicklingError(f"{obj.__qualname__} is code of others")


@cache
def _code() -> bytes:
    """A hash of this package and of the versions of what it is built on."""
    folder = Path(faultgauge.__file__).parent
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        found.update(path.read_bytes())
    for name in ("jax", "jaxlib", "equinox", "numpy"):
        found.update(f"{name} {metadata.version(name)};".encode())
    return found.digest()
