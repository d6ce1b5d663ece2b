"""Write docs/cli.md from the commands' own help; `--check` fails where it is out of date."""

import os
import subprocess
import sys
from pathlib import Path

# a source tree that is not installed
WHERE = {name: os.environ[name] for name in ("PYTHONPATH",) if name in os.environ}
PAGE = Path(__file__).with_name("cli.md")
COMMANDS = (
    "demo",
    "check",
    "inspect",
    "presets",
    "fit",
    "evaluate",
    "calibrate",
    "estimate",
    "rehearse",
    "detectability",
    "campaign",
    "export",
    "simulate",
    "reproduce",
    "benchmark",
)


def page() -> str:
    program = Path(sys.executable).with_name("faultgauge")
    parts = ["# Commands\n\nWritten by `make docs` from the program's own help.\n"]
    for command in ((), *((name,) for name in COMMANDS)):
        text = subprocess.run(
            [program, *command, "--help"],
            capture_output=True,
            text=True,
            check=True,
            env={"COLUMNS": "96", "TERM": "dumb", "PATH": "", **WHERE},
        ).stdout
        body = "\n".join(line.rstrip() for line in text.strip().splitlines())
        parts.append(f"## {' '.join(('faultgauge', *command))}\n\n```text\n{body}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    if "--check" in sys.argv:
        if PAGE.read_text() != page():
            sys.exit("docs/cli.md is out of date: run `make docs`")
    else:
        PAGE.write_text(page())
