"""The tight C loop beside us: own C, compiled here and now for this machine."""

import ctypes
import subprocess
import tempfile
from pathlib import Path

import numpy as np

__all__ = ["compiled", "pointer"]

FLAGS = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]


def compiled(name: str) -> ctypes.CDLL:
    """The functions of `name`.c in this folder."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / f"{name}.so"
        source = Path(__file__).with_name(f"{name}.c")
        subprocess.run(["cc", *FLAGS, "-o", library, source, "-lm"], check=True)
        return ctypes.CDLL(str(library))


def pointer(array: np.ndarray) -> "ctypes._Pointer[ctypes.c_double]":
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
