"""Commands ended at random moments: what was promised is there, and nothing else.

    python benchmarks/kills.py [--kills 200] [--seed 0] [--cache FOLDER]

Every command is run once undisturbed over small logs, with its cache of compiled programs warm, and
then ended by SIGKILL, SIGTERM or SIGHUP: at any moment of its processor time, which other programs
beside it do not stretch, or in the last fifth, in which files are written. Each time what it would
write is there already, from before, but where it refuses to write over a file. Afterwards

- a file is as it was before, or whole and byte for byte as undisturbed, but for times that were
  measured; of the bench and of a stream there are whole rows from the first one on, and all that
  were given out;
- a command that had done its work says so by 0, one that was told to end by 130 and one sentence;
- after the next write in a folder there is no draft in it, and after SIGTERM and SIGHUP nothing of
  ours where temporary files are;
- what the command reads is as it was.

Commands take turns; those that take long are left out of most rounds. `--cache` keeps the compiled
programs for the next time. Exit code 1 where anything of this does not hold.
"""

import argparse
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path
from typing import NamedTuple

from faultgauge.files import write_atomically
from stream_speed import COMMAND, PLANT, rows, used

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)
POLLED = 0.01  # s between two looks at a command's processor time
LATE = 0.8  # of the time that a command takes: from then on it writes
ROOM = 1.05  # of that time: some kills come too late
ROWS = 600
MEASURED = re.compile(rb"\d+ us, measured")  # by `export`, in its README.md
GAUGE = """[faults.gauge]
enters = "output"
target = "lower"
"""  # a state's fault cannot be put into a recorded log
SCENARIO = """name = "two tanks"
plant = "PLANT"
seconds = 60
step = 0.1
seed = 7
[inputs.u]
source = "noise"
sigma = 0.5
low = 0.01
high = 1
[noise]
upper = 0.002
lower = 0.002
"""
# signals as a program has them at a terminal: `nohup` and a shell's `&` have some ignored
AT_A_TERMINAL = [
    COMMAND[0],
    "-c",
    "import signal as s; s.signal(s.SIGINT, s.default_int_handler); "
    "s.signal(s.SIGTERM, s.SIG_DFL); s.signal(s.SIGHUP, s.SIG_DFL); "
    "from faultgauge.cli import main; main()",
]


class Command(NamedTuple):
    """A command line, what of the given files stands in its folder before, what standard input is,
    whether its rows come one by one, in which rounds it is run: the first, and `every` so many-th;
    and whether it writes over a file."""

    line: str
    before: tuple[str, ...] = ()
    stdin: str = ""
    rows: bool = False
    every: int = 1
    over: bool = True


class Clean(NamedTuple):
    """What an undisturbed run leaves and prints, and what processor time it takes [s]."""

    files: dict[str, bytes]
    out: bytes
    seconds: float


COMMANDS = (
    Command("inspect IN/healthy.csv --init-plant plant.toml", over=False),
    Command("fit IN/plant.toml IN/healthy.csv --out m.fgm --report r.html"),
    Command("fit IN/plant.toml IN/healthy.csv --out m.fgm --refine --restarts 2"),
    Command("evaluate IN/model.fgm IN/other.csv --report r.html"),
    Command("calibrate model.fgm IN/other.csv --report r.html", ("model.fgm",), every=4),
    Command("calibrate IN/model.fgm IN/other.csv --observer eso --out m.fgm"),
    Command(
        "estimate IN/model.fgm IN/suspect.csv --out e.csv.gz --report r.html --evidence ev", every=4
    ),
    Command("estimate IN/model.fgm IN/suspect.csv --out e.csv --smooth --json", every=4),
    Command("estimate IN/model.fgm - --events events.ndjson", stdin="IN/suspect.csv", rows=True),
    Command("rehearse IN/gauge.fgm IN/other.csv --trials 4 --out r", every=4),
    Command("detectability IN/model.fgm IN/other.csv --report r.html"),
    Command("export IN/model.fgm --to c --out c"),
    Command("export IN/model.fgm --to fmu --out f"),
    Command("simulate IN/scenario.toml --out log.csv --report r.html"),
    Command("simulate IN/scenario.toml --realtime 20 --stream csv --out log.csv", rows=True),
    Command("check IN/healthy.csv IN/suspect.csv --plant IN/plant.toml --out c", every=4),
    Command("demo --out d", every=8),
)


def given(folder: Path) -> None:
    """The files that commands read."""
    folder.mkdir()
    (folder / "plant.toml").write_text(PLANT)
    (folder / "gauge.toml").write_text(PLANT + GAUGE)
    for name, seed, leak in (("healthy", 1, 0.0), ("other", 2, 0.0), ("suspect", 3, -0.3)):
        (folder / f"{name}.csv").write_text(rows(seed, ROWS, leak))
    (folder / "scenario.toml").write_text(SCENARIO.replace("PLANT", "model.fgm"))
    for line in (
        "fit plant.toml healthy.csv --out model.fgm",
        "calibrate model.fgm healthy.csv other.csv",
        "calibrate model.fgm healthy.csv --plant gauge.toml --out gauge.fgm",
    ):
        subprocess.run([*COMMAND, *line.split()], cwd=folder, check=True, capture_output=True)


class Ground:
    """Folders: `inputs`, `temporary` files, `at` where commands run; `cache` is of compiled
    programs."""

    def __init__(self, root: Path, cache: Path) -> None:
        self.inputs, self.at, self.temporary = root / "in", root / "at", root / "tmp"
        self.out, self.err = root / "out", root / "err"
        given(self.inputs)
        self.temporary.mkdir()
        self.environment = {
            **{name: value for name, value in os.environ.items() if name != "FAULTGAUGE_DATA"},
            "XDG_CACHE_HOME": str(cache.absolute()),
            "TMPDIR": str(self.temporary),
        }
        self.read = files_in(self.inputs)

    def begin(self, command: Command, before: dict[str, bytes]) -> subprocess.Popen[bytes]:
        """`command` in a folder that holds what was there `before`."""
        shutil.rmtree(self.at, ignore_errors=True)
        for name, data in before.items():
            (self.at / name).parent.mkdir(parents=True, exist_ok=True)
            (self.at / name).write_bytes(data)
        self.at.mkdir(exist_ok=True)
        stdin = self.at / command.stdin.replace("IN", "../in") if command.stdin else os.devnull
        with open(stdin, "rb") as source, open(self.out, "wb") as o, open(self.err, "wb") as e:
            return subprocess.Popen(
                [*AT_A_TERMINAL, *command.line.replace("IN/", "../in/").split()],
                cwd=self.at,
                env=self.environment,
                stdin=source,
                stdout=o,
                stderr=e,
            )

    def undisturbed(self, command: Command) -> Clean:
        """The second run, whose programs are compiled already."""
        seconds = 0.0
        for _ in range(2):
            before = _spent_by_children()
            code = self.begin(command, self.own(command)).wait()
            seconds = _spent_by_children() - before
            if code:
                sys.exit(f"{command.line}: {self.err.read_text()}")
        return Clean(files_in(self.at), self.out.read_bytes(), seconds)

    def own(self, command: Command) -> dict[str, bytes]:
        return {name: self.read[name] for name in command.before}


def _spent_by_children() -> float:
    found = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found.ru_utime + found.ru_stime


def files_in(folder: Path) -> dict[str, bytes]:
    """Bytes of every file in `folder` and below, by its name in it; measured times are left out."""
    return {
        str(path.relative_to(folder)): MEASURED.sub(b"", path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def killed(ground: Ground, command: Command, clean: Clean, after: float, sent: int) -> list[str]:
    """What is wrong once `command` was `sent` a signal `after` so many seconds of its own."""
    there = clean.files if command.over else ()
    before = dict.fromkeys(there, b"what was there before\n") | ground.own(command)
    with ground.begin(command, before) as running:
        while running.poll() is None and used(running.pid)[0] < after:
            time.sleep(POLLED)
        running.send_signal(sent)
    out = ground.out.read_bytes()
    wrong = list(_told(running.returncode, sent, ground.err.read_text(errors="replace")))
    found = {name: data for name, data in files_in(ground.at).items() if not is_draft(name)}
    if command.rows:
        wrong += _rows(found, before, clean, out, running.returncode, sent)
    else:
        wrong += _whole(found, before, clean, running.returncode)
    wrong += _left(ground, sent)
    if files_in(ground.inputs) != ground.read:
        wrong.append("an input was changed")
    return wrong


def is_json(line: bytes) -> bool:
    try:
        json.loads(line)
    except ValueError:
        return False
    return True


def is_draft(name: str) -> bool:
    return name.endswith(".draft")


def _told(code: int, sent: int, err: str) -> Iterator[str]:
    """Before the program has begun a signal does what it does to any."""
    if code not in (0, -sent, *([130] if sent != signal.SIGKILL else [])):
        yield f"exit code {code}"
    if "Traceback" in err or "Error" in err:
        yield f"printed {err!r}"
    if code == 130 and "interrupted" not in err:
        yield f"did not say that it was interrupted, but {err!r}"


def _whole(
    found: dict[str, bytes], before: dict[str, bytes], clean: Clean, code: int
) -> Iterator[str]:
    for name in sorted(found.keys() | before.keys() | (clean.files.keys() if code == 0 else set())):
        if name not in found:
            yield f"{name} is lost"
        elif found[name] not in (before.get(name), clean.files.get(name)):
            yield f"{name} is neither the old nor the new one"
        elif code == 0 and found[name] != clean.files[name]:
            yield f"{name} is not there, though it was said to be done"


def _rows(
    found: dict[str, bytes],
    before: dict[str, bytes],
    clean: Clean,
    out: bytes,
    code: int,
    sent: int,
) -> Iterator[str]:
    """Rows that were given out, and the files that hold what came so far."""
    if not clean.out.startswith(out):
        yield "what was printed is not how the undisturbed run begins"
    if sent != signal.SIGKILL and out and not out.endswith(b"\n"):
        yield "a row was printed in part"
    for name, data in found.items():
        if data == before.get(name):
            if name == "log.csv" and code in (0, 130) and out.count(b"\n") > 1:
                yield "rows were given out, and there is no log of them"
        elif name.endswith(".csv"):
            if not clean.files[name].startswith(data) or not data.endswith(b"\n"):
                yield f"{name} is not how the undisturbed log begins"
            if data.count(b"\n") < out.count(b"\n"):
                yield f"{name} has fewer rows than were given out"
        else:
            if data and not data.endswith(b"\n"):
                yield f"{name} ends within a line"
            if not all(map(is_json, data.splitlines())):
                yield f"{name} holds a line that is no JSON"


def _left(ground: Ground, sent: int) -> Iterator[str]:
    """Drafts that the next write leaves, and temporary files."""
    for folder in {ground.at, *(path.parent for path in ground.at.rglob("*.draft"))}:
        write_atomically(folder / "next", b"")
    for name in files_in(ground.at):
        if is_draft(name):
            yield f"{name} stays"
    left = [path for path in ground.temporary.iterdir() if path.name.startswith("faultgauge")]
    if sent != signal.SIGKILL and left:
        yield f"temporary files stay: {left}"
    for path in ground.temporary.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def turns() -> Iterator[Command]:
    """Commands, round by round."""
    for number in count():
        yield from (each for each in COMMANDS if number % each.every == 0)


def carried_out(kills: int, seed: int, cache: Path | None = None) -> int:
    """How many of so many `kills` went wrong; a line is printed of each that did, and of each
    command."""
    rng, wrong = random.Random(seed), 0
    with tempfile.TemporaryDirectory() as name:
        ground = Ground(Path(name), cache or Path(name) / "cache")
        clean: dict[Command, Clean] = {}
        for k, command in enumerate(islice(turns(), kills), 1):
            if command not in clean:
                found = clean[command] = ground.undisturbed(command)
                print(
                    f"{found.seconds:.1f} s: {command.line}: {', '.join(found.files)}", flush=True
                )
            undisturbed, sent = clean[command], rng.choice(SIGNALS)
            share = rng.uniform(LATE, ROOM) if rng.random() < 0.5 else rng.uniform(0, ROOM)
            said = killed(ground, command, undisturbed, share * undisturbed.seconds, sent)
            wrong += bool(said)
            print(f"{k} of {kills}, {wrong} wrong", file=sys.stderr, flush=True)
            for text in said:
                print(f"{command.line}\n  {sent.name} at {share:.2f}: {text}", flush=True)
    print(f"{kills} kills, {wrong} of them wrong")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path)
    arguments = parser.parse_args()
    sys.exit(1 if carried_out(arguments.kills, arguments.seed, arguments.cache) else 0)
