"""What the CSV reader takes, and what it says of everything else."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry.readers import READERS, read_table, stem
from faultgauge.telemetry.table import is_text, text_error


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_table(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert message.endswith(".")
    return message


def test_numbers_are_float64_and_rows_are_those_of_the_file(tmp_path):
    path = write(tmp_path / "log.csv", "t, u\n0,1e-3\n0.1, -2 \n0.2,+3.5\n")
    table = read_table(path)
    assert table.source == str(path)
    assert list(table.columns) == ["t", "u"]
    assert all(column.dtype == np.float64 for column in table.columns.values())
    np.testing.assert_array_equal(table.columns["u"], [1e-3, -2.0, 3.5])
    np.testing.assert_array_equal(table.rows, [2, 3, 4])


@pytest.mark.parametrize(
    "text",
    [
        "t,u,h\n0,1,\n1,,\n2,,7\n,3,8\n",
        't,u,h\r\n0,1,\r\n1,,\r\n2,"",7\r\n,3,8\r\n',
        "t,u,h\n0,1,nan\n1, ,NaN\n2,,7\n ,3,8",
        "\ufefft,u,h\n0,1,\n1,,\n2,,7\n,3,8\n\n \n",
    ],
    ids=["plain", "quotes and CRLF", "nan and blanks", "BOM and empty end"],
)
def test_empty_cells_are_nan(tmp_path, text):
    table = read_table(write(tmp_path / "log.csv", text))
    np.testing.assert_array_equal(table.columns["t"], [0, 1, 2, np.nan])
    np.testing.assert_array_equal(table.columns["u"], [1, np.nan, np.nan, 3])
    np.testing.assert_array_equal(table.columns["h"], [np.nan, np.nan, 7, 8])
    np.testing.assert_array_equal(table.rows, [2, 3, 4, 5])


def test_blank_rows_are_passed_over_and_counted(tmp_path):
    table = read_table(write(tmp_path / "log.csv", "t,u\n\n0,1\n\n  \n1,2\n"))
    np.testing.assert_array_equal(table.columns["u"], [1, 2])
    np.testing.assert_array_equal(table.rows, [3, 6])


def test_text_is_kept_and_can_be_pointed_at(tmp_path):
    path = write(tmp_path / "log.csv", 't,"mode, old",u\n0,"a\nb",1\n1,2,ERR\n2,,3\n')
    table = read_table(path)
    assert list(table.columns["mode, old"]) == ["ab", "2", ""]
    assert is_text(table.columns["u"])
    message = str(text_error(table, "u"))
    assert f"{path}, row 4, column 'u': 'ERR'" in message


def test_underscores_do_not_make_numbers(tmp_path):
    table = read_table(write(tmp_path / "log.csv", "t,u\n0,1_0\n1,2\n"))
    assert is_text(table.columns["u"])


def test_gzip_reads_the_same(tmp_path):
    text = "t,u\n0,1\n1,\n2,3\n"
    plain = read_table(write(tmp_path / "log.csv", text))
    packed = read_table(write(tmp_path / "LOG.CSV.GZ", gzip.compress(text.encode())))
    for name, column in plain.columns.items():
        np.testing.assert_array_equal(packed.columns[name], column)


def test_suffixes_give_the_stem():
    assert {".csv", ".csv.gz"} < set(READERS)
    assert stem(Path("a/run.2026.csv.gz")) == "run.2026"
    assert stem(Path("a/run.csv")) == "run"


def test_missing_file(tmp_path):
    assert "does not exist" in refusal(tmp_path / "none.csv")
    assert "does not exist" in refusal(tmp_path / "none.parquet")


def test_directory(tmp_path):
    assert "directory" in refusal(tmp_path)


def test_unreadable_file(tmp_path):
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    assert "cannot be read" in refusal(tmp_path / "loop.csv")


def test_unknown_suffix_names_the_legal_ones(tmp_path):
    message = refusal(write(tmp_path / "log.docx", "x"))
    assert ".csv, .csv.gz, .tsv, .txt, .xlsx" in message
    assert ".docx" in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["empty", "header"]),
        ("\n \n", ["empty", "header"]),
        ("t,u\n", ["only a header row", "two samples"]),
        ("t,u\n0,1\n", ["only one row", "two samples"]),
        ("t,u,u\n0,1,2\n1,2,3\n", ["row 1", "2 columns", "'u'"]),
        ("t,,u\n0,1,2\n1,2,3\n", ["row 1", "cell 2 of 3", "name"]),
        ("\nt,u\n0,1\n1,2\n", ["row 1 is empty", "name the columns"]),
        ("0,1\n1,2\n2,3\n", ["row 1", "numbers", "header"]),
        ("t,u\n0,1\n1,2,3\n2,4\n", ["row 3", "3 cells", "has 2"]),
        ("t,u\n0,1\n\n1\n2,4\n", ["row 4", "1 cells", "has 2"]),
        ('t,u\n0,1\n1,"2\n2,4\n', ["row 4", "quotes"]),
        ('"t,u\n0,1\n', ["row 1", "quotes", "header"]),
    ],
    ids=[
        "empty", "blank", "header only", "one row", "duplicate", "nameless", "blank header",
        "no header", "long row", "short row", "open quote", "open quote in header",
    ],
)  # fmt: skip
def test_refused_tables(tmp_path, text, words):
    message = refusal(write(tmp_path / "log.csv", text))
    for word in words:
        assert word in message


def test_a_quoted_semicolon_is_part_of_a_name(tmp_path):
    table = read_table(write(tmp_path / "log.csv", '"t;;","u;"\n0,1\n1,2\n'))
    assert list(table.columns) == ["t;;", "u;"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("log.csv", b"t,u\n0,1\n\x00\x01\n", ["binary"]),
        ("log.csv", "t,u\n0,1\n1,é\n".encode("latin-1"), ["row 3", "UTF-8"]),
        ("log.csv", "t,u\n0,1\n".encode("utf-16")[:-1], ["row", "UTF-8"]),
        ("log.csv", gzip.compress(b"t,u\n0,1\n1,2\n"), ["gzip", "rename", "log.csv.gz"]),
        ("log.csv.gz", b"t,u\n0,1\n1,2\n", ["not gzip"]),
        ("log.csv.gz", gzip.compress(b"t,u\n0,1\n1,2\n")[:-9], ["damaged"]),
        ("log.csv.gz", gzip.compress(b"t,u\n0,1\n1,2\n")[:-8] + bytes(8), ["damaged"]),
    ],
    ids=["NUL", "latin-1", "UTF-16", "gzip as csv", "csv as gzip", "cut gzip", "wrong CRC"],
)
def test_refused_bytes(tmp_path, name, content, words):
    message = refusal(write(tmp_path / name, content))
    for word in words:
        assert word in message


def test_every_cell_of_a_long_log_is_what_was_written(tmp_path):
    values = np.random.default_rng(0).normal(size=(25_000, 4))
    path = tmp_path / "log.csv"
    np.savetxt(path, values, delimiter=",", header="t,a,b,c", comments="", fmt="%.9g")
    table = read_table(path)
    # nine significant digits were written
    np.testing.assert_allclose(np.column_stack(list(table.columns.values())), values, rtol=1e-8)


def test_more_columns_than_a_log_has_are_refused(tmp_path):
    log = tmp_path / "wide.csv"
    log.write_text(",".join(["t", *(f"c{k}" for k in range(10_000))]) + "\n0\n")
    with pytest.raises(InputError, match="has 10001 columns, and at most 10000 are read"):
        read_table(log)
