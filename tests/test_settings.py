"""Settings of the compiler: those of the commands for whoever imports faultgauge, unless hers."""

import os
import subprocess
import sys

import pytest

from faultgauge.settings import COMPILER

SAID = "import os; print(os.environ.get('XLA_FLAGS')); print(os.environ.get('FAULTGAUGE_PROGRAMS'))"


def said(code, cache, **given):
    """The compiler's settings and the folder of programs, as a process has them after `code`."""
    ours = ("XLA_FLAGS", "FAULTGAUGE_PROGRAMS")
    env = {name: value for name, value in os.environ.items() if name not in ours}
    env |= {"XDG_CACHE_HOME": str(cache), **given}
    command = [sys.executable, "-c", f"{code}\n{SAID}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    return done.stdout.splitlines()


def test_python_users_have_what_the_commands_have(tmp_path):
    assert said("import faultgauge", tmp_path) == [COMPILER, str(tmp_path / "faultgauge/programs")]


@pytest.mark.parametrize(
    ("code", "given", "expected"),
    [
        ("import faultgauge", {"XLA_FLAGS": "", "FAULTGAUGE_PROGRAMS": ""}, ["", ""]),
        ("import jax, faultgauge", {}, ["None", "None"]),
    ],
)
def test_what_she_set_or_loaded_stands(tmp_path, code, given, expected):
    assert said(code, tmp_path, **given) == expected


@pytest.mark.skipif(os.cpu_count() == 1, reason="one core alone takes one after another")
def test_independent_fits_take_every_core(tmp_path):
    """Which they do where programs have no threads of their own."""
    code = (
        "import faultgauge, threading\n"
        "from faultgauge.identification.optimise.cores import side_by_side\n"
        "two = threading.Barrier(2, timeout=20)\n"
        "side_by_side(lambda _: two.wait(), range(2))"
    )
    assert said(code, tmp_path)[0] == COMPILER
