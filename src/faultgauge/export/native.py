"""A printed step, compiled with the system's C compiler and called from Python."""

import ctypes
import functools
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from faultgauge.errors import InputError
from faultgauge.export.compile import Member, Printed
from faultgauge.export.kept import kept
from faultgauge.export.sources import header, step_source, table_source

__all__ = ["Native", "built", "compiler", "needed_compiler"]

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
# Sums keep their order but where a loop says otherwise (OpenMP); a product and a sum are rounded
# once where the processor can (so does XLA). Functions stay apart: one of thousands of lines takes
# a compiler minutes.
FASTER = (
    *("-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"),
    *("-fopenmp-simd", "-fno-inline-functions-called-once"),
)
RUN = """
#define _POSIX_C_SOURCE 199309L
#include "{name}.h"
#include <time.h>
void fg_times(int64_t count, const {name}_input *in, double *took, {name}_state *state)
{{
    for (int64_t k = 0; k < count; k++) {{
        {name}_output out;
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        {name}_step(in + k, &out, state);
        clock_gettime(CLOCK_MONOTONIC, &b);
        took[k] = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
    }}
}}
void fg_init({name}_state *state) {{ {name}_init(state); }}
void fg_run(int64_t count, const {name}_input *in, {name}_output *out, {name}_state *state)
{{
    for (int64_t k = 0; k < count; k++) {{
        {name}_step(in + k, out + k, state);
    }}
}}
int64_t fg_sizes(int32_t which)
{{
    return which == 0 ? (int64_t)sizeof({name}_input)
        : which == 1 ? (int64_t)sizeof({name}_output) : (int64_t)sizeof({name}_state);
}}
"""


def compiler() -> str | None:
    """The path of a C compiler: $CC, cc, gcc or clang, whichever is there first."""
    names = [os.environ.get("CC", ""), "cc", "gcc", "clang"]
    return next((found for name in names if name and (found := shutil.which(name))), None)


def needed_compiler() -> str:
    """The same; raises `InputError` where there is none."""
    found = compiler()
    if found is None:
        raise InputError(
            "no C compiler was found, which this needs; install gcc or clang, or name one in "
            "the environment variable CC."
        )
    return found


def built(files: Mapping[str, str], flags: Sequence[str] = ()) -> bytes:
    """The shared library of C `files` by name. Raises `InputError` where there is no C compiler, or
    it refuses the code."""
    cc = needed_compiler()
    with tempfile.TemporaryDirectory(prefix="faultgauge-") as name:
        folder = Path(name)
        for each, text in files.items():
            (folder / each).write_text(text)
        sources = [each for each in files if each.endswith(".c")]
        command = [cc, *FLAGS, *flags, *sources, "-o", "built.so", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise InputError(f"{cc} refused the exported code: {done.stderr.strip()[:500]}")
        return (folder / "built.so").read_bytes()


@functools.cache
def _own_flags() -> tuple[tuple[str, ...], str]:
    """(flags for programs that run here alone, what the compiler says of itself and of the
    processor with them)."""
    for flags in ((*FASTER, "-march=native"), FASTER):
        command = [needed_compiler(), *flags, "-dM", "-E", "-x", "c", os.devnull]
        said = subprocess.run(command, capture_output=True, text=True, check=False)
        if said.returncode == 0:
            break
    return flags, said.stdout


def _kept(files: Mapping[str, str], flags: Sequence[str], folder: Path) -> Path:
    """The library in `folder`, by the hash of all that it is made from."""
    own, here = _own_flags()
    flags = [*own, *flags]
    made_from = repr((needed_compiler(), here, FLAGS, flags, sorted(files.items())))
    path = folder / f"{hashlib.sha256(made_from.encode()).hexdigest()}.so"
    kept(path, lambda: built(files, flags))
    return path


class Native:
    """A compiled step with its state; `run` takes many samples at once.

    The library lives in a folder of its own until `close`, or the end of `with`; in the folder
    `cache` it stays, made for this processor, and is not compiled again. Raises `InputError` where
    there is no C compiler, or it refuses the code.
    """

    def __init__(
        self, printed: Printed, flags: Sequence[str] = (), cache: Path | None = None
    ) -> None:
        name = printed.name
        files = {
            f"{name}.h": header(printed, ""),
            f"{name}.c": step_source(printed, ""),
            f"{name}_tables.c": table_source(printed, ""),
            "run.c": RUN.format(name=name),
        }
        self._open = ExitStack()
        if cache is None:
            folder = self._open.enter_context(tempfile.TemporaryDirectory(prefix="faultgauge-"))
            library = Path(folder) / "step.so"
            library.write_bytes(built(files, flags))
        else:
            library = _kept(files, flags, cache)
        self._library = ctypes.CDLL(str(library))
        self.input, self.output = (
            _record(each, printed.single) for each in (printed.inputs, printed.outputs)
        )
        work = _record(printed.work, printed.single)
        self.state_type = _record(printed.state, printed.single, [("work", work)])
        self._check_sizes()
        self._state = np.zeros(1, self.state_type)
        self.begin()

    def __enter__(self) -> "Native":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        self._open.close()

    def begin(self) -> None:
        """`NAME_init`."""
        self._library.fg_init(self._state.ctypes.data_as(ctypes.c_void_p))

    @property
    def state(self) -> np.ndarray:
        """The state struct: a record of one element; `state["t"]` is a member."""
        return self._state

    def run(self, samples: Mapping[str, Any]) -> np.ndarray:
        """Records of the output struct, one per sample; `samples` are arrays by member name."""
        return self._called("fg_run", samples)

    def longest(self, samples: Mapping[str, Any]) -> float:
        """The longest step [s] of these samples, by the clock: of three runs the quickest, since
        other programs only make steps longer."""
        took = []
        for _ in range(3):
            self.begin()
            took.append(self._called("fg_times", samples)["s"])
        return float(np.min(took, axis=0).max())

    def _called(self, function: str, samples: Mapping[str, Any]) -> np.ndarray:
        count = len(next(iter(samples.values())))
        given = np.zeros(count, self.input)
        for name in given.dtype.names or ():
            if name in samples:
                given[name] = np.asarray(samples[name]).reshape(given[name].shape)
        said = np.zeros(count, self.output if function == "fg_run" else [("s", "f8")])
        pointers = (each.ctypes.data_as(ctypes.c_void_p) for each in (given, said, self._state))
        getattr(self._library, function)(ctypes.c_int64(count), *pointers)
        return said

    def _check_sizes(self) -> None:
        self._library.fg_sizes.restype = ctypes.c_int64
        for k, record in enumerate((self.input, self.output, self.state_type)):
            if self._library.fg_sizes(k) != record.itemsize:
                raise RuntimeError("the compiler lays the structs out unlike NumPy")


def _record(members: Sequence[Member], single: bool, more: Sequence[Any] = ()) -> np.dtype:
    real = "f4" if single else "f8"
    kinds = {"real": real, "wide": "f8", "bool": "?", "int64_t": "i8", "int32_t": "i4"}
    fields: list[Any] = [
        (each.name, kinds[each.kind], (each.size,)) if each.shape
        else (each.name, kinds[each.kind])
        for each in members
        if each.size
    ]  # fmt: skip
    return np.dtype([*fields, *more] or [("none", "i1")], align=True)
