"""Reading files within bounds, and writing them whole or not at all."""

import contextlib
import errno
import os
import re
import secrets
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

from faultgauge.errors import InputError

try:
    import fcntl
except ImportError:  # Windows: drafts stay there
    fcntl = None

__all__ = [
    "check_regular",
    "full_disk",
    "read_within",
    "size_in_words",
    "take",
    "write_atomically",
]

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
DRAFT = re.compile(r"\..*\.[0-9a-f]{8}\.draft")
SPECIAL = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def check_regular(path: str | Path) -> None:
    """Refuse a pipe, a device or a socket: reading may never end, and writing would replace it.

    What is not there passes, and so does a folder, of which others know more to say.
    """
    with contextlib.suppress(OSError):
        kind = SPECIAL.get(stat.S_IFMT(os.stat(path).st_mode))
        if kind is not None:
            raise InputError(f"{path}: is {kind}, not a file; give the name of a file.")


def read_within(path: str | Path, limit: int, what: str) -> bytes:
    """All bytes of a regular file of at most `limit`, by what is read and not by what the folder
    says; `what` names it in the refusal."""
    check_regular(path)
    with open(path, "rb") as file:
        return take(file.read, limit, path, what)


def take(read: Callable[[int], bytes], limit: int, path: str | Path, what: str) -> bytes:
    """All that `read` gives, piece by piece, of at most `limit` bytes."""
    pieces, left = [], limit
    while piece := read(min(1 << 24, left + 1)):
        left -= len(piece)
        if left < 0:
            raise InputError(f"{path}: holds more than {size_in_words(limit)}, {what}.")
        pieces.append(piece)
    return b"".join(pieces)


def size_in_words(count: int) -> str:
    """ "1 GB", "20 MB" """
    return f"{count / 1e9:g} GB" if count >= 1e9 else f"{count / 1e6:g} MB"


def write_atomically(path: str | Path, data: bytes) -> None:
    """Write to a temporary name beside `path`, then rename: never a half-written file."""
    target = Path(path)
    check_regular(target)
    draft = target.parent / f".{target.name[:50]}.{secrets.token_hex(4)}.draft"
    try:
        with _drafting_in(target.parent):
            with open(draft, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(draft, target)
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be written ({failure.strerror}); {_advice(failure)}."
        ) from None
    finally:
        with contextlib.suppress(OSError):  # where it could not be made, or was renamed
            draft.unlink()


def full_disk(failure: OSError) -> bool:
    """Whether there was no room for what was to be written."""
    return failure.errno in FULL


def _advice(failure: OSError) -> str:
    if full_disk(failure):
        return "the disk is full: make room, or choose a folder on another"
    return "choose a folder that exists and that you may write to"


@contextlib.contextmanager
def _drafting_in(folder: Path) -> Iterator[None]:
    """While a draft is in `folder`. Those of writers that were killed are removed, which is known
    by nobody's writing there: whoever does shares a lock of the folder."""
    with contextlib.ExitStack() as stack:
        if fcntl is not None:
            with contextlib.suppress(OSError):  # a folder that cannot be read, or locked
                held = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, held)
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    _remove_drafts(folder)
                fcntl.flock(held, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield


def _remove_drafts(folder: Path) -> None:
    with os.scandir(folder) as entries:
        left = [each.path for each in entries if DRAFT.fullmatch(each.name)]
    for path in left:
        with contextlib.suppress(OSError):
            os.unlink(path)
