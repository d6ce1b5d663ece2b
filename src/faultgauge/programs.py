"""Compiled functions whose programs are kept on disk: made once, loaded from then on.

JAX's own cache keeps what its compiler made; to ask for it, a process must trace the function and
lower it anew, which takes longer than all else that a command does. A program kept here is found by
what it hangs on, before anything is traced: the function, what of its arguments is no array, the
arrays' shapes and types, the code of this package and of those that trace it, and the machine's
kind. The folder is that of `FAULTGAUGE_PROGRAMS`, which the commands set; without it nothing is
kept.
"""

import hashlib
import io
import os
import pickle
import platform
from collections.abc import Callable
from contextlib import suppress
from functools import cache, update_wrapper
from pathlib import Path
from threading import Lock
from time import time
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable

from faultgauge.errors import InputError
from faultgauge.files import write_atomically
from faultgauge.phases import phase

__all__ = ["program"]

P = ParamSpec("P")
R = TypeVar("R")
OURS = ("faultgauge", "faultgauge_studies")  # by every file
THEIRS = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy")  # by version
PLAIN = ("builtins", "collections", "functools", "operator", "types", "typing", "pathlib")
CALLS_PYTHON = "python_cpu_callback"  # in the text of a program that means nothing elsewhere
CALLS_LAPACK = "lapack_"
UNUSED = 30 * 86400.0  # s; a program that nothing asked for since goes
LEAST = "jax_persistent_cache_min_compile_time_secs"
PLACES = ("jax_compilation_cache", "jax_persistent_cache")  # settings that change no program


def program(function: Callable[P, R]) -> Callable[P, R]:
    """Compiles a function of a module as `equinox.filter_jit` does, and keeps its programs.

    Not kept are programs that call back into Python, and those that hang on code of others, as that
    of a plant that a user wrote: nothing tells when it changes.
    """
    return _Program(function)


class _Program(Generic[P, R]):
    def __init__(self, function: Callable[P, R]) -> None:
        self.function: Callable[..., R] = function
        self.compiled: Callable[P, R] = eqx.filter_jit(function)
        self.ready: dict[Any, Callable[[list[Any]], Any] | None] = {}
        self.making: dict[Any, Lock] = {}
        update_wrapper(self, function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        folder = os.environ.get("FAULTGAUGE_PROGRAMS")
        if not folder or jax.default_backend() != "cpu":
            return self.compiled(*args, **kwargs)
        leaves, tree = jax.tree.flatten((args, kwargs))
        arrays = [leaf for leaf in leaves if _is_array(leaf)]
        if any(isinstance(each, Tracer) for each in arrays):
            return self.compiled(*args, **kwargs)
        known = tuple(_known(x) if _is_array(x) else (type(x), x) for x in leaves)
        if (key := (tree, known)) not in self.ready:
            # other threads wait for the one that makes it
            with self.making.setdefault(key, Lock()):
                if key not in self.ready:
                    self.ready[key] = self._program(Path(folder), tree, leaves)
        run = self.ready[key]
        with phase("running programs"):
            return self.compiled(*args, **kwargs) if run is None else run(arrays)

    def _program(
        self, folder: Path, tree: Any, leaves: list[Any]
    ) -> Callable[[list[Any]], Any] | None:
        """The program for such arguments, loaded or made and kept; None where it cannot be."""
        outline = [(*_known(x), x.dtype.str) if _is_array(x) else x for x in leaves]
        name = self.function.__module__, self.function.__qualname__
        said = _told((name, _code(), _machine(), jax.tree.unflatten(tree, outline)))
        if said is None:
            return None
        file = folder / f"{hashlib.sha256(said).hexdigest()}.program"
        arrays = sum(map(_is_array, leaves))
        with phase("loading programs"):
            run = _ready(_read(file), arrays)
        if run is None:
            kept = self._made(tree, leaves)
            run = _ready(kept, arrays)
            if kept is not None and run is not None:
                _write(file, kept)
        return run

    def _made(self, tree: Any, leaves: list[Any]) -> "_Kept | None":
        said: list[Any] = []

        def kept(arrays: list[Any]) -> list[Any]:
            left = iter(arrays)
            args, kwargs = jax.tree.unflatten(
                tree, [next(left) if _is_array(leaf) else leaf for leaf in leaves]
            )
            out, form = jax.tree.flatten(self.function(*args, **kwargs))
            found = [each for each in out if _is_array(each)]
            places = iter(map(_Place, range(len(found))))
            said.append(form.unflatten(next(places) if _is_array(x) else x for x in out))
            return found

        with phase("tracing programs"):
            lowered = jax.jit(kept).lower([leaf for leaf in leaves if _is_array(leaf)])
        text = lowered.as_text()
        if CALLS_PYTHON in text or _told(said[-1]) is None:
            return None
        try:
            binary, _, _ = serialize_executable.serialize(_compiled(lowered))
        except (NotImplementedError, ValueError):  # it holds what cannot be written
            return None
        return _Kept(binary, said[-1], CALLS_LAPACK in text)


class _Place(NamedTuple):
    """Where in an answer the array `number` stands."""

    number: int


class _Kept(NamedTuple):
    """A program as bytes; its answer, with places for arrays; whether it calls LAPACK."""

    binary: bytes
    answer: Any
    lapack: bool


class _Telling(pickle.Pickler):
    """Refuses what is of other code than that which `_code` knows."""

    def persistent_id(self, obj: Any) -> None:
        if hasattr(obj, "__qualname__"):  # a class or a function
            home = obj.__module__ or "builtins"
            if home.split(".")[0] not in (*OURS, *THEIRS, *PLAIN):
                raise pickle.PicklingError(home)


def _told(said: Any) -> bytes | None:
    """`said` as bytes; None where that is not possible, or would not tell all."""
    content = io.BytesIO()
    telling = _Telling(content)
    telling.fast = True  # what is equal is told alike, be it one object or two
    try:
        telling.dump(said)
    except (pickle.PicklingError, TypeError, AttributeError, ValueError, RecursionError):
        return None  # what objects raise that are not to be pickled
    return content.getvalue()


def _compiled(lowered: jax.stages.Lowered) -> jax.stages.Compiled:
    """Compiled anew, and not for JAX's cache: what comes from there cannot be written again."""
    with _uncached, phase("compiling programs"):
        return lowered.compile()


class _Uncached:
    """While a thread is in it, JAX keeps nothing that it compiles."""

    def __init__(self) -> None:
        self.lock, self.threads, self.usual = Lock(), 0, 0.0

    def __enter__(self) -> None:
        with self.lock:
            self.threads += 1
            if self.threads == 1:
                self.usual = jax.config.values[LEAST]
                jax.config.update(LEAST, float("inf"))

    def __exit__(self, *_: object) -> None:
        with self.lock:
            self.threads -= 1
            if not self.threads:
                jax.config.update(LEAST, self.usual)


_uncached = _Uncached()


def _ready(kept: _Kept | None, arrays: int) -> Callable[[list[Any]], Any] | None:
    """The program itself, for so many arrays; None where there is none, or it cannot be loaded."""
    if kept is None:
        return None
    if kept.lapack:
        _load_lapack()
    places, form = jax.tree.flatten(kept.answer, is_leaf=_is_place)
    given = jax.tree.structure((([0] * arrays,), {}))
    found = jax.tree.structure([0] * sum(map(_is_place, places)))
    try:
        run = serialize_executable.deserialize_and_load(
            kept.binary, given, found, execution_devices=jax.devices()[:1]
        )
    except jax.errors.JaxRuntimeError:
        return None

    def call(arrays: list[Any]) -> Any:
        found = run(arrays)
        return form.unflatten(found[each.number] if _is_place(each) else each for each in places)

    return call


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray | np.generic)


def _known(array: Any) -> tuple[Any, ...]:
    """What a program knows of an array."""
    return array.shape, array.dtype.num, getattr(array, "weak_type", False)


def _is_place(leaf: Any) -> bool:
    return isinstance(leaf, _Place)


def _read(file: Path) -> _Kept | None:
    """None where it is not there or was damaged."""
    with suppress(OSError):
        content = file.read_bytes()
        os.utime(file)  # it is in use
        if hashlib.sha256(content[32:]).digest() == content[:32]:
            return pickle.loads(content[32:])
    return None


def _write(file: Path, kept: _Kept) -> None:
    content = pickle.dumps(kept)
    with suppress(OSError, InputError):  # without room or right it is made anew next time
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, hashlib.sha256(content).digest() + content)
        for each in file.parent.glob("*.program"):
            if each.stat().st_mtime < time() - UNUSED:
                each.unlink()


@cache
def _load_lapack() -> None:
    """JAX tells its programs where LAPACK is when it lowers the first that calls it."""
    jax.lax.linalg.cholesky(jnp.asarray(np.eye(1)), symmetrize_input=False)


def _code() -> tuple[Any, ...]:
    """What the same arguments may be compiled otherwise by."""
    return (
        sorted((k, repr(v)) for k, v in jax.config.values.items() if not k.startswith(PLACES)),
        os.environ.get("XLA_FLAGS", ""),
        _files(),
    )


@cache
def _files() -> tuple[Any, ...]:
    from importlib.metadata import version

    home, found = Path(__file__).parents[1], list[tuple[str, int, int]]()
    for package in OURS:
        for file in sorted((home / package).rglob("*.py")):
            about = file.stat()
            found.append((str(file.relative_to(home)), about.st_size, about.st_mtime_ns))
    return *(version(name) for name in THEIRS), *found


@cache
def _machine() -> tuple[str, ...]:
    """The kind of processor: its instructions, where the system tells them."""
    about = platform.system(), platform.machine(), platform.processor()
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        told = (line for line in lines if line.startswith(("flags", "Features")))
        return *about, next(told, "")
    return about
