"""A damaged cache of compiled programs: one sentence, and the next run finds it whole."""

import os
import subprocess
import sys

CODE = """
from faultgauge.cli.cache import renew_when_damaged
from faultgauge.settings import set_for_commands
set_for_commands()
renew_when_damaged()
import jax
jax.jit(lambda x: 3 * x + 1)(2.0)
jax.jit(lambda x: 5 * x - 1)(2.0)
"""


def run_with(cache):
    keep = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        capture_output=True,
        text=True,
        check=True,
        env={**keep, "XDG_CACHE_HOME": str(cache)},
    )
    return done.stderr


def test_a_damaged_cache_is_made_anew_once(tmp_path):
    folder = tmp_path / "faultgauge" / "jax"
    assert run_with(tmp_path) == ""
    entries = list(folder.glob("*-cache"))
    assert entries
    for entry in entries:
        entry.write_bytes(entry.read_bytes()[:20])
    said = run_with(tmp_path)
    assert said == f"note: the compiled programs in {folder} were damaged and are made anew.\n"
    assert run_with(tmp_path) == ""


def test_a_cache_that_cannot_be_is_said_once(tmp_path):
    (tmp_path / "faultgauge").write_text("a file where a folder should be")
    said = run_with(tmp_path)
    assert said.startswith("note: compiled programs cannot be kept in ")
    assert said.count("\n") == 1
