"""Reading within bounds; drafts that a killed writer left; a disk that is full."""

import gzip
import os
import resource
import signal
import subprocess
import sys

import pytest

from faultgauge.cli.app import run
from faultgauge.errors import InputError
from faultgauge.files import read_within, write_atomically
from faultgauge.plants.model import load_model
from faultgauge.plants.plant_file import read_plant_text
from faultgauge.telemetry import read_telemetry
from faultgauge.telemetry.readers import csv as reader

WRITER = """
import os, signal, sys
import faultgauge.files
os.replace = lambda *names: os.kill(os.getpid(), signal.SIGKILL)
faultgauge.files.write_atomically(sys.argv[1], b"half")
"""


def test_the_draft_of_a_killed_writer_goes_with_the_next(tmp_path):
    target = tmp_path / "model.fgm"
    killed = subprocess.run([sys.executable, "-c", WRITER, str(target)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob(".*.draft"))) == 1
    mine = tmp_path / ".my.draft"
    mine.write_text("")
    write_atomically(tmp_path / "other.csv", b"whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".my.draft", "other.csv"]


def test_the_draft_of_somebody_who_still_writes_stays(tmp_path, monkeypatch):
    replace, seen = os.replace, []

    def meanwhile(draft, target):
        monkeypatch.setattr(os, "replace", replace)
        write_atomically(tmp_path / "second", b"2")
        seen.append(os.path.exists(draft))
        replace(draft, target)

    monkeypatch.setattr(os, "replace", meanwhile)
    write_atomically(tmp_path / "first", b"1")
    assert seen == [True]
    assert (tmp_path / "first").read_bytes() == b"1"


def test_a_full_disk_is_said_to_be_full(tmp_path):
    """By the limit of a file's size, which fails as a full disk does."""
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "from faultgauge.files import write_atomically\n"
        "from faultgauge.errors import InputError\n"
        "try: write_atomically('big', b'x' * 2000)\n"
        "except InputError as wrong: print(wrong)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("big: cannot be written (File too large); the disk is full")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is full")
def test_what_cannot_be_printed_is_no_fault_of_ours():
    code = "from faultgauge.cli import main; main()"
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code, "--version"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "standard output: cannot be written, because the disk is full" in done.stderr


def test_a_small_file_that_unpacks_to_much_is_refused_by_what_it_holds(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "MOST_TEXT", 20_000_000)
    log = tmp_path / "log.csv.gz"
    with gzip.open(log, "wb") as file:
        file.write(b"t,x\n0,1\n1,2\n")
        for _ in range(50):
            file.write(b"0" * 1_000_000)
    assert log.stat().st_size < 100_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"log\.csv\.gz: holds more than 20 MB, when it is unp"):
        read_telemetry(log)
    # kB: twice the limit, for the pieces and what joins them
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 40_000


def test_the_limit_counts_what_is_read(tmp_path):
    path = tmp_path / "f"
    path.write_bytes(b"x" * 1001)
    assert len(read_within(path, 1001, "too much")) == 1001
    with pytest.raises(InputError, match=r"holds more than 0\.001 MB, too much"):
        read_within(path, 1000, "too much")


@pytest.mark.parametrize("read", [load_model, read_plant_text, read_telemetry])
def test_what_may_never_end_is_refused(tmp_path, read):
    pipe, device = tmp_path / "log.csv", tmp_path / "zero.csv"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    with pytest.raises(InputError, match="is a named pipe, not a file"):
        read(pipe)
    with pytest.raises(InputError, match="is a device, not a file"):
        read(device)


def test_a_line_without_end_is_cut_in_the_sentence(tmp_path, capsys):
    plant = tmp_path / "plant.toml"
    plant.write_text(f'name = "x"\n[states.{"a" * 900_000}]\nderivative = "q"\n')
    assert run(["fit", str(plant), "none.csv", "--out", str(tmp_path / "m.fgm")]) == 2
    assert len(capsys.readouterr().err) < 5000
