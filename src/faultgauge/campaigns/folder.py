"""The folder of a campaign: what was planned, the model that judges, and chunks of rows.

    campaign.json       the campaign's name and key, and what was warned of
    model.fgm           the model that judges
    chunks/00007.json   the rows of some runs, with the key of campaign and model
    runs.parquet, results.json, report.html

Every file is there whole or not at all, so that a call that was ended is gone on with.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from faultgauge.campaigns.outcome import Row
from faultgauge.errors import InputError
from faultgauge.files import read_within, write_atomically

__all__ = ["KEPT", "MODEL", "Folder"]

KEPT, MODEL, CHUNKS = "campaign.json", "model.fgm", "chunks"
LARGEST = 100_000_000  # bytes


class Folder:
    """`path` for the campaign `name` whose content has this `key`; made where it is missing.

    Raises `InputError` where it holds another campaign.
    """

    def __init__(self, path: Path, name: str, key: str) -> None:
        self.path, self.name, self.key = path, name, key
        kept = _read(path / KEPT)
        if kept is None and (path / KEPT).exists():
            raise InputError(f"{path / KEPT}: is damaged; remove that folder, or give another.")
        if kept is not None and kept.get("key") != key:
            raise InputError(
                f"{path}: holds results of another campaign ({kept.get('name')!r}, or this one as "
                "it was before its files or this program changed); give another folder, or remove "
                "it."
            )
        try:
            (path / CHUNKS).mkdir(parents=True, exist_ok=True)
        except OSError as failure:
            raise InputError(
                f"{path}: cannot be made a folder ({failure.strerror}); choose another name."
            ) from None
        if kept is None:
            self.keep(())

    def keep(self, warnings: Sequence[str]) -> None:
        """Write down whose folder this is, and what was warned of."""
        self._write(KEPT, {"name": self.name, "key": self.key, "warnings": list(warnings)})

    @property
    def warnings(self) -> list[str]:
        return (_read(self.path / KEPT) or {})["warnings"]

    @property
    def model(self) -> Path:
        return self.path / MODEL

    def rows(self, chunk: int, key: str) -> list[Row] | None:
        """The rows of a chunk made under this `key`; None where there are none."""
        kept = _read(self.path / _name(chunk))
        return kept["rows"] if kept is not None and kept.get("key") == key else None

    def land(self, chunk: int, key: str, rows: Sequence[Row]) -> None:
        self._write(_name(chunk), {"key": key, "rows": list(rows)})

    def _write(self, name: str, content: Any) -> None:
        write_atomically(self.path / name, json.dumps(content, allow_nan=False).encode())


def _name(chunk: int) -> str:
    return f"{CHUNKS}/{chunk:05d}.json"


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(read_within(path, LARGEST, "which no campaign does"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None
