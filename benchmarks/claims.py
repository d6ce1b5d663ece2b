"""Rerun rows of CLAIMS.md and compare what they print with the figure that stands there.

    python benchmarks/claims.py [--match TEXT] [--list]

Without `--match` the rows whose commands take a minute or two and print the same anywhere; with it
those whose row holds TEXT. A number of the row is found again where the command prints one that
rounds to it; of a test, that it passes is all that is compared. Exit code 1 where a row has moved.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
CHEAP = (
    "pytest tests/identification/equation/test_simulated_instruments.py",
    "pytest tests/export/test_watch.py",
    "python benchmarks/instrument.py --seeds 20",
    "python benchmarks/constants.py --case equal",
)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class Claim(NamedTuple):
    """A row of the table: what is claimed, the command that prints it, and the figure."""

    what: str
    command: str
    figure: str


def rows() -> list[Claim]:
    """The rows of CLAIMS.md; the command is empty where none prints the figure."""
    found = list[Claim]()
    for line in (ROOT / "CLAIMS.md").read_text().splitlines():
        cells = [each.strip() for each in line.strip("|").split(" | ")]
        if not line.startswith("| ") or len(cells) != 3 or cells[0].endswith("Claim"):
            continue
        command = re.search(r"`((?:python|pytest|faultgauge) [^`]*)`", cells[1])
        said = command[1] if command else ""
        if cells[1].startswith("the same") and found:
            said = found[-1].command
        found.append(Claim(cells[0].strip("| "), said, cells[2].strip("| ")))
    return found


def run(command: str) -> subprocess.CompletedProcess[str]:
    """The command with this interpreter, in the root of the repository."""
    program, *words = shlex.split(command)
    here = [sys.executable]
    if program == "pytest":
        here += ["-m", "pytest", "-q"]
    elif program == "faultgauge":
        here = [str(Path(sys.executable).with_name("faultgauge"))]
    environment = {**os.environ, "COLUMNS": "200"}
    return subprocess.run(
        [*here, *words], cwd=ROOT, capture_output=True, text=True, env=environment, check=False
    )


def missing(figure: str, printed: str) -> list[str]:
    """The numbers of `figure` that nothing in `printed` rounds to."""
    there = [float(each) for each in NUMBER.findall(printed)]
    return [
        text
        for text in NUMBER.findall(figure)
        if not any(abs(float(text) - each) <= half_of_last_digit(text) for each in there)
    ]


def half_of_last_digit(text: str) -> float:
    """What a number as written may be off by."""
    digits, _, power = text.partition("e")
    return 0.501 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--match", help="rows that hold this text, cheap or not")
    parser.add_argument("--list", action="store_true", help="print the rows, run nothing")
    given = parser.parse_args()
    asked = [
        each
        for each in rows()
        if each.command
        and (given.match in " ".join(each) if given.match else each.command in CHEAP)
    ]
    moved, printed = 0, dict[str, subprocess.CompletedProcess[str]]()
    for claim in asked:
        print(f"{claim.command}: {claim.what}")
        if given.list:
            continue
        if claim.command not in printed:
            printed[claim.command] = run(claim.command)
        ended = printed[claim.command]
        lost = []
        if not claim.command.startswith("pytest"):
            lost = missing(claim.figure, ended.stdout + ended.stderr)
        if ended.returncode or lost:
            moved += 1
            print(f"  MOVED: exit code {ended.returncode}; not printed: {', '.join(lost) or '-'}")
            print(f"  it says {claim.figure}")
        else:
            print("  holds")
    print(f"{len(asked) - moved} of {len(asked)} rows hold" if not given.list else len(asked))
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main())
