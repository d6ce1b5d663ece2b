"""What is refused: exit code, processor time and memory of each, whole processes.

    python benchmarks/refusals.py

Files that hold far more than their size says, plant files of many names, numbers that are none,
names that no folder takes. Each must end by 2 and one sentence; time and memory of a refusal that
costs nothing, that of a missing log, stand first; memory is at least what this program holds. Exit
code 1 where one ends otherwise.
"""

import gzip
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from stream_speed import COMMAND, PLANT, rows

SHORT = 5000  # letters of a message, at most
STATE = '[states.s{k}]\nderivative = "d(s{after})"\n'
SCENARIO = """plant = "plant.toml"
seconds = 60
step = 0.1
[inputs.u]
source = "noise"
sigma = 0.5
low = 0.01
high = 1
"""


class Case(NamedTuple):
    """Arguments, the files that they name, and whether standard input is closed."""

    name: str
    arguments: tuple[str, ...]
    closed: bool = False


def chain(count: int) -> str:
    """A plant of so many states, each of which reads the derivative of the next."""
    states = "".join(STATE.format(k=k, after=k + 1) for k in range(count - 1))
    last = f'[states.s{count - 1}]\nderivative = "-s{count - 1}"\n'
    return f'name = "chain"\n{states}{last}[outputs.y]\nvalue = "s0"\n'


def plants() -> dict[str, str]:
    """Plant files by what is wrong with them."""
    return {
        "1,500 states in a chain, and no log": chain(1500),
        "20,000 states": chain(20_000),
        "a key of 100,000 parts": 'name = "x"\n' + "a." * 100_000 + "b = 1\n",
        "20,000 dotted keys": PLANT + "".join(f"a.b{k}.c = 1\n" for k in range(20_000)),
        "a name of 900,000 letters": PLANT + f'[states.{"a" * 900_000}]\nderivative = "q"\n',
        "a whole number of 3,600 hex digits": PLANT.replace("value = 1", "value = 0x" + "f" * 3600),
        "sigma = 1e-300": PLANT.replace("[outputs.lower]\n", "[outputs.lower]\nsigma = 1e-300\n"),
        "a fault up to 1e300": PLANT + "max = 1e300\n",
    }


def written(folder: Path) -> list[Case]:
    """The cases, whose files are in `folder`."""
    (folder / "plant.toml").write_text(PLANT)
    (folder / "scenario.toml").write_text('name = "s"\n' + SCENARIO)
    (folder / "log.csv").write_text(rows(1, 600))
    cases = [Case("a missing log", ("fit", "plant.toml", "none.csv", "--out", "m.fgm"))]
    for k, (name, text) in enumerate(plants().items()):
        (folder / f"{k}.toml").write_text(text)
        cases.append(Case(name, ("fit", f"{k}.toml", "none.csv", "--out", "m.fgm")))
    (folder / "wide.csv").write_text(
        "t," + ",".join(f"c{k}" for k in range(10**6)) + "\n0" + ",1" * 10**6 + "\n"
    )
    with open(folder / "large.csv.gz", "wb") as file:
        file.write(gzip.compress(b"t,u,upper,lower\n"))
        part = gzip.compress(b"0,1,2,3\n" * 12_500_000)
        file.write(part * 100)
    (folder / "zero.csv").symlink_to("/dev/zero")
    os.mkfifo(folder / "pipe.csv")
    long = "x" * 300
    return [
        *cases,
        Case("a log of a million columns", ("inspect", "wide.csv")),
        Case("10 GB of text in a small .csv.gz", ("inspect", "large.csv.gz")),
        Case("a device for a log", ("inspect", "zero.csv")),
        Case("a pipe for a log", ("inspect", "pipe.csv")),
        Case("a device for a plant file", ("fit", "/dev/zero", "log.csv", "--out", "m.fgm")),
        Case("a device for a model", ("evaluate", "/dev/zero", "log.csv")),
        Case("a log's name of 300 letters", ("inspect", f"{long}.csv")),
        Case("a file to write of 300", ("fit", "plant.toml", "log.csv", "--out", f"{long}.fgm")),
        Case("a closed standard input", ("estimate", "m.fgm", "-"), closed=True),
        Case(
            "--realtime 1e-300",
            ("simulate", "scenario.toml", "--realtime", "1e-300", "--out", "l.csv"),
        ),
    ]


def ended(case: Case, folder: Path) -> bool:
    """Whether `case` ends as it should; a row of the table is printed."""
    shut = ["sh", "-c", 'exec "$@" <&-', "sh"] if case.closed else []
    with open(folder / "err", "wb") as err:
        running = subprocess.Popen(
            [*shut, *COMMAND, *case.arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=err,
        )
        _, status, used = os.wait4(running.pid, 0)
    running.returncode = code = os.waitstatus_to_exitcode(status)
    said = (folder / "err").read_text(errors="replace")
    well = code == 2 and said.startswith("faultgauge: ") and said.count("\n") == 1
    well &= len(said) < SHORT
    seconds, memory = used.ru_utime + used.ru_stime, used.ru_maxrss / 1000
    print(f"| {case.name} | {code} | {seconds:.1f} s | {memory:.0f} MB | {len(said)} |", flush=True)
    if not well:
        print(f"{case.name}: {said[:SHORT]}", file=sys.stderr)
    return well


def main() -> int:
    print("| refused | exit code | processor time | memory | letters said |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        well = [ended(case, Path(name)) for case in written(Path(name))]
    return 0 if all(well) else 1


if __name__ == "__main__":
    sys.exit(main())
