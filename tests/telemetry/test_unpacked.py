"""Small files that unpack to much are refused by what they hold, before memory is full of it."""

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from faultgauge.errors import InputError
from faultgauge.telemetry import read_telemetry
from faultgauge.telemetry.readers import unpacked, workbook_size
from telemetry.workbooks import write_workbook

MOST = 5_000_000  # bytes
ROWS = 1_000_000  # of 8 bytes
HEAD_V73 = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"


def parquet(path: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    t, x = np.arange(ROWS, dtype="int32") // ROWS, np.zeros(ROWS)
    parquet.write_table(pyarrow.table({"t": t, "x": x}), path)


def parquet_of_text(path: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    text = pyarrow.DictionaryArray.from_arrays(np.zeros(10_000, "int32"), ["x" * 10_000])
    table = pyarrow.table({"t": np.arange(10_000.0), "x": text.cast(pyarrow.string())})
    parquet.write_table(table, path)


def hdf5(path: Path) -> None:
    """Chunks of which none was written."""
    import h5py

    with h5py.File(path, "w") as file:
        for name in "tx":
            file.create_dataset(name, (1 << 50,), "f8", chunks=(1 << 10,))


def hdf5_of_a_chunk(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name in "tx":
            file.create_dataset(name, (5,), "f8", chunks=(ROWS,), maxshape=(None,))


def hdf5_of_text(path: Path) -> None:
    """Many cells that are the same long one."""
    import h5py

    with h5py.File(path, "w") as file:
        file["t"] = np.arange(10_000.0)
        file.create_dataset("x", (10_000,), h5py.string_dtype(), fillvalue="x" * 10_000)


def mat(path: Path) -> None:
    scipy.io.savemat(path, {"t": np.zeros(ROWS), "x": np.zeros(ROWS)}, do_compression=True)


def mat_73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("x", (1 << 50, 1), "f8", chunks=(1 << 10, 1))
    with path.open("r+b") as file:
        file.write(HEAD_V73)


def mdf(path: Path) -> None:
    import asammdf

    t = np.arange(ROWS, dtype=float)
    with asammdf.MDF(version="4.10") as file:
        file.append(asammdf.Signal(np.zeros(ROWS), t, name="x"))
        file.save(path, compression=2)


def lying_mdf(path: Path) -> None:
    """Its head and that of each block say that there are three samples."""
    mdf(path)
    data = bytearray(path.read_bytes())
    at = data.find(b"##DZ")
    while at >= 0:
        data[at + 32 : at + 40] = struct.pack("<Q", 48)
        at = data.find(b"##DZ", at + 1)
    at = data.find(b"##CG")
    links = struct.unpack("<Q", data[at + 16 : at + 24])[0]
    data[at + 32 + 8 * links : at + 40 + 8 * links] = struct.pack("<Q", 3)
    path.write_bytes(data)


def workbook(path: Path, cells: str = "<c r='XFD1048576'><v>1</v></c>") -> None:
    """All cells between the log and one in the last row and column would be of the table."""
    plain = write_workbook(path.with_name("plain.xlsx"), {"log": [["t", "x"], [0, 1], [1, 2]]})
    row = f"<row r='1048576'>{cells}</row></sheetData>".encode()
    with zipfile.ZipFile(plain) as source, zipfile.ZipFile(path, "w") as target:
        for each in source.infolist():
            target.writestr(each, source.read(each).replace(b"</sheetData>", row))


def workbook_of_unplaced_cells(path: Path) -> None:
    workbook(path, "<c><v>1</v></c>" * 100)


def workbook_of_blanks(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("xl/sharedStrings.xml", b" " * 2 * MOST)


@pytest.mark.parametrize(
    ("write", "suffix"),
    [
        (workbook, ".xlsx"),
        (workbook_of_unplaced_cells, ".xlsx"),
        (workbook_of_blanks, ".xlsx"),
        (parquet, ".parquet"),
        (parquet_of_text, ".parquet"),
        (hdf5, ".h5"),
        (hdf5_of_a_chunk, ".h5"),
        (hdf5_of_text, ".h5"),
        (mat, ".mat"),
        (mat_73, ".mat"),
        (mdf, ".mf4"),
        (lying_mdf, ".mf4"),
    ],
)
def test_what_unpacks_to_much_is_refused(tmp_path, monkeypatch, write, suffix):
    monkeypatch.setattr(unpacked, "MOST", MOST)
    monkeypatch.setattr(workbook_size, "MOST_TEXT", MOST)
    log = tmp_path / f"log{suffix}"
    write(log)
    assert log.stat().st_size < MOST / 10
    with pytest.raises(InputError, match=rf"log{suffix}: holds more than 5 MB,? when it is unp"):
        read_telemetry(log)
