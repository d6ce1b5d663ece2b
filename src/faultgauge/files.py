"""Writing files whole or not at all."""

import contextlib
import os
import secrets
from pathlib import Path

from faultgauge.errors import InputError

__all__ = ["write_atomically"]


def write_atomically(path: str | Path, data: bytes) -> None:
    """Write to a temporary name beside `path`, then rename: never a half-written file."""
    target = Path(path)
    draft = target.parent / f".{target.name[:50]}.{secrets.token_hex(4)}.draft"
    try:
        with open(draft, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, target)
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be written ({failure.strerror}); choose a folder that exists and "
            "that you may write to."
        ) from None
    finally:
        with contextlib.suppress(OSError):  # where it could not be made, or was renamed
            draft.unlink()
