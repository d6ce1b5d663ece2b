"""Refusing, before any work, what could not or must not be written afterwards.

Every option that names a file says in its annotation what becomes of it: `Annotated[..., READS]`,
`Writes()` or `Fills(...)`. `guarded` looks at all of them before the command begins.
"""

import errno
import functools
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from faultgauge.errors import InputError
from faultgauge.files import check_regular

__all__ = ["READS", "Fills", "Writes", "check_apart", "check_folder", "guarded", "make_folder"]


@dataclass(frozen=True)
class Reads:
    """Files or folders that a command reads; a name that is none of either is no matter."""


@dataclass(frozen=True)
class Writes:
    """A file that a command writes; the one that parameter `over` names may be replaced by it. With
    the option --fleet it is a folder, whose own rules `fleet.folder` has."""

    over: str = ""


@dataclass(frozen=True)
class Fills:
    """A folder in which a command writes files of these names."""

    names: tuple[str, ...]


READS = Reads()


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """`command`, which begins only where its outputs are neither its inputs nor each other."""
    roles = {
        name: role
        for name, hint in get_type_hints(command, include_extras=True).items()
        for role in get_args(hint)
        if isinstance(role, Reads | Writes | Fills)
    }
    signature = inspect.signature(command)

    @functools.wraps(command)
    def wrapped(*args: Any, **options: Any) -> None:
        given = signature.bind(*args, **options).arguments
        _check(roles, {name: value for name, value in given.items() if value is not None})
        command(*args, **options)

    return wrapped


def _check(roles: Mapping[str, Reads | Writes | Fills], given: Mapping[str, Any]) -> None:
    outputs: dict[str, list[Path]] = {}
    inputs = {
        name: _paths(given[name]) for name, role in roles.items() if role == READS and name in given
    }
    for name, role in roles.items():
        if name not in given or role == READS:
            continue
        option, path = f"--{name.replace('_', '-')}", Path(given[name])
        of_fleet = name == "out" and given.get("fleet", False)
        if isinstance(role, Fills) or of_fleet:
            _check_name(path, "a folder")
            if os.path.exists(path) and not os.path.isdir(path):
                raise InputError(f"{path}: is a file; give a folder for {option}.")
            names = role.names if isinstance(role, Fills) else ()
            outputs[option] = [path / each for each in names]
            continue
        check_folder(path)
        outputs[option] = [path]
        if isinstance(role, Writes) and role.over in inputs and _same(path, inputs[role.over][0]):
            del inputs[role.over]
    check_apart([path for paths in inputs.values() for path in paths], outputs)


def _paths(value: Any) -> list[Path]:
    return [Path(each) for each in (value if isinstance(value, list) else [value])]


def check_apart(inputs: Iterable[Path], outputs: Mapping[str, Iterable[Path]]) -> None:
    """No output (by its option) may be the file of an input, or of another output, by whatever
    name; standard input and output count too where they are files."""
    taken = {key: "reads" for path in inputs for key in _identities(path)}
    taken |= dict(_standard())
    for option, paths in outputs.items():
        for path in paths:
            check_regular(path)
            key = _identity(path)
            if key in taken:
                raise InputError(
                    f"{option}: {path} is what this call {taken[key]} and would be lost; give "
                    "another name."
                )
            taken[key] = f"writes for {option}"


def _same(first: Path, second: Path) -> bool:
    return _identity(first) == _identity(second)


def _identities(path: Path) -> Iterator[Any]:
    """Of a file, or of every file in a folder: a log may be one of a bag's."""
    yield _identity(path)
    if os.path.isdir(path):
        yield from (_identity(Path(each.path)) for each in os.scandir(path))


def _identity(path: Path) -> Any:
    """The same for all names of a file, links included, and for a file that is not there yet."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return os.path.realpath(path)
    return found.st_dev, found.st_ino


def _standard() -> Iterator[tuple[Any, str]]:
    for stream, does in ((sys.stdin, "reads"), (sys.stdout, "prints to")):
        try:
            found = os.fstat(stream.fileno())
        except (AttributeError, OSError, ValueError):  # closed, or none at all
            continue
        yield (found.st_dev, found.st_ino), does


def check_folder(path: Path) -> None:
    """`path` must stand in a folder that exists and must not be a folder itself."""
    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder; give a file name in it.")
    if not os.path.isdir(path.absolute().parent):
        raise InputError(f"{path}: the folder {path.parent} does not exist; create it first.")
    _check_name(path, "a file")


def _check_name(path: Path, what: str) -> None:
    try:
        os.stat(path)
    except OSError as failure:
        if failure.errno == errno.ENAMETOOLONG:
            raise InputError(
                f"{path}: the name is too long for {what}; give a shorter one."
            ) from None


def make_folder(path: Path) -> Path:
    """`path` as a folder, made where it is missing."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be made a folder ({failure.strerror}); choose another name."
        ) from None
    return path
