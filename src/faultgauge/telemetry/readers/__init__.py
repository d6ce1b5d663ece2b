"""Readers of log files: one file each, registered by suffix in `READERS`; folders are ROS bags."""

import os
from collections.abc import Callable
from pathlib import Path

from faultgauge.errors import InputError
from faultgauge.files import check_regular
from faultgauge.telemetry.readers.bag import BAG_FILES, read_bag
from faultgauge.telemetry.readers.csv import read_csv
from faultgauge.telemetry.readers.excel import EXCEL_FILES, in_workbook, read_excel
from faultgauge.telemetry.readers.hdf5 import read_hdf5
from faultgauge.telemetry.readers.mat import read_mat
from faultgauge.telemetry.readers.mdf import read_mdf
from faultgauge.telemetry.readers.parquet import read_parquet
from faultgauge.telemetry.table import LogTable, check_width

__all__ = ["READERS", "is_log", "logs_in", "read_table", "stem"]

READERS: dict[str, Callable[[Path], LogTable]] = {
    ".csv": read_csv,
    ".csv.gz": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    **dict.fromkeys(EXCEL_FILES, read_excel),
    ".parquet": read_parquet,
    ".mat": read_mat,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
    **dict.fromkeys(BAG_FILES, read_bag),
}


def read_table(path: Path) -> LogTable:
    """Read one file with the reader of its suffix, or a folder as a ROS 2 bag.

    Raises `InputError` if it is missing, of an unknown suffix, or refused by the reader.
    """
    file, _ = in_workbook(path)
    suffix = _suffix(file)
    try:
        file.stat()
        check_regular(file)
        if path.is_dir():
            return _narrow(read_bag(path))
        if suffix is not None:
            return _narrow(READERS[suffix](path))
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; check the path of the log.") from None
    except OSError as failure:
        raise InputError(f"{path} cannot be read: {failure.strerror or failure}.") from None
    if path.suffix.lower() == ".bag":
        raise InputError(
            f"{path} is a bag of ROS 1, which is not read; make one of ROS 2 from it with "
            f"`rosbags-convert --src {path.name} --dst {path.stem}` (pip install rosbags), and "
            "give the folder."
        )
    if path.suffix.lower() == ".fgm":
        raise InputError(f"{path} is a model of faultgauge, not a log; give a log in its place.")
    raise InputError(
        f"{path}: a log must end in {', '.join(READERS)}, not in {path.suffix or 'nothing'}; "
        "convert the file."
    )


def _narrow(table: LogTable) -> LogTable:
    check_width(table.source, len(table.columns))
    return table


def logs_in(path: Path) -> list[Path]:
    """The logs in a folder that is no bag, by name; `path` itself where it is none, or has none."""
    if not os.path.isdir(path) or (path / "metadata.yaml").is_file():  # a name may be too long
        return [path]
    files = sorted(each for each in path.iterdir() if each.is_file())
    hidden = (".", "~$")  # macOS and Excel put their own beside them
    found = [each for each in files if _suffix(each) and not each.name.startswith(hidden)]
    return found or [path]


def stem(path: Path) -> str:
    """Name of a file or folder without directory and without the suffix of its reader; with that
    of the sheet, where one is named."""
    file, sheet = in_workbook(path)
    name = file.name or path.resolve().name  # `.` has none
    bare = name.removesuffix(name[len(name) - len(_suffix(file) or "") :])
    return f"{bare}:{sheet}" if sheet else bare


def is_log(path: Path) -> bool:
    """Whether a file of that name has a reader."""
    return _suffix(in_workbook(path)[0]) is not None


def _suffix(path: Path) -> str | None:
    return next((suffix for suffix in READERS if path.name.lower().endswith(suffix)), None)
