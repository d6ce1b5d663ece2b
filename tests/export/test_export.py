"""`faultgauge export`: what it writes, that it builds and agrees, and what it refuses."""

import hashlib
import io
import json
import platform
import re
import shutil
import subprocess
from collections import OrderedDict
from contextlib import redirect_stdout
from pathlib import Path

import jax.numpy as jnp
import pytest

from drawn_models import calibrated
from faultgauge.cli.app import run
from faultgauge.export.c_project import c_project
from faultgauge.export.compile import ExportedStep
from faultgauge.export.request import Request
from faultgauge.export.targets import TARGETS
from faultgauge.plants.model import save_model

WRAPPERS = Path(__file__).parents[2] / "examples" / "wrappers"
FILES = {
    "CMakeLists.txt", "Makefile", "README.md", "tank.c", "tank.h", "tank_tables.c", "tank_test.c",
}  # fmt: skip


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """A folder with a model file and its export."""
    folder = tmp_path_factory.mktemp("shop")
    save_model(calibrated("tank"), folder / "tank.fgm")
    command = ["export", str(folder / "tank.fgm"), "--to", "c", "--out", str(folder / "c")]
    with redirect_stdout(io.StringIO()) as said:
        assert run([*command, "--json"]) == 0
    (folder / "said.json").write_text(said.getvalue())
    return folder


def test_the_files_are_there_and_name_their_model(shop):
    assert {each.name for each in (shop / "c").iterdir()} == FILES
    assert set(json.loads((shop / "said.json").read_text())["files"]) == FILES
    digest = hashlib.sha256((shop / "tank.fgm").read_bytes()).hexdigest()
    for name in ("tank.h", "tank.c", "tank_tables.c", "README.md"):
        text = (shop / "c" / name).read_text()
        assert digest in text
        assert "faultgauge 0." in text
    header = (shop / "c" / "tank.h").read_text()
    for word in (
        "f_leak;",
        "f_leak_lo;",
        "p_leak;",
        "p_healthy;",
        "status;",
        "TANK_FAULT = 1",
        "event_leak;",
        "event_unknown;",
        "unnamed_event;",
        "TANK_EVENT_BEGINS = 1",
    ):
        assert word in header
    assert "[m/s]" in header
    assert "not WCET" not in (shop / "c" / "README.md").read_text()
    readme = (shop / "c" / "README.md").read_text()
    assert re.search(
        rf"\d+ us, measured on .+, {platform.system()} on {platform.machine()}", readme
    )
    for quantity in ("what lasts from step to step", "working memory", "operations of one step"):
        assert re.search(rf"\| {quantity}.* \| \d[\d,]* ", readme)


@pytest.mark.study  # that a step gives the same bytes, test_watch.py asks
def test_the_same_model_gives_the_same_code(shop, tmp_path, capsys):
    command = ["export", str(shop / "tank.fgm"), "--to", "c", "--out", str(tmp_path / "again")]
    assert run([*command, "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["files"]) == FILES
    for name in FILES - {"README.md"}:  # which says how long a step took
        assert (tmp_path / "again" / name).read_bytes() == (shop / "c" / name).read_bytes()


@pytest.mark.parametrize(
    ("source", "compilers", "flags"),
    [
        ("cfs/fault_app.c", ("cc", "gcc", "clang"), ["-std=c99", "-Wconversion"]),
        ("fprime/FaultGauge.cpp", ("c++", "g++", "clang++"), ["-std=c++11"]),
        ("arduino/arduino.ino", ("c++", "g++", "clang++"),
         ["-x", "c++", "-std=c++11", "-include", "Arduino.h"]),
    ],
)  # fmt: skip
def test_the_wrappers_compile_around_it(shop, source, compilers, flags):
    """Against just as much of their frameworks as they call."""
    cc = next(filter(None, map(shutil.which, compilers)), None)
    if cc is None:
        pytest.skip(f"none of {', '.join(compilers)} is installed")
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror", "-fsyntax-only"]
    folders = [f"-I{shop / 'c'}", f"-I{WRAPPERS / 'stubs'}"]
    command = [cc, *flags, *strict, *folders, str(WRAPPERS / source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]


@pytest.mark.study
def test_its_own_test_builds_runs_and_notices_a_changed_number(cc, shop, tmp_path):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    folder = tmp_path / "c"
    shutil.copytree(shop / "c", folder)
    built = subprocess.run(
        ["make", "-C", str(folder), "test", "CFLAGS=-O1 -Wall -Wextra -Wconversion -Werror"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr[:2000]
    assert "agrees" in built.stdout
    source = (folder / "tank.c").read_text()
    head, body = source.split("static void tank_step_0(", 1)
    # the plant is half as fast
    assert " / 6.0" in body
    (folder / "tank.c").write_text(
        f"{head}static void tank_step_0({body.replace(' / 6.0', ' / 12.0')}"
    )
    changed = subprocess.run(["make", "-C", str(folder), "test"], capture_output=True, check=False)
    assert changed.returncode != 0


def test_names_with_accents_are_names_of_c_without_them(cc, tmp_path):
    """And what it writes agrees with Python by its own test; two names that become one stay two."""

    def step(state, sample):
        low, high = sample["Füllstand"], sample["Fullstand"]
        return state + low, OrderedDict([("état", state + high), ("Ω", low - high)])

    def examples(count, rng):
        return {name: rng.standard_normal(count) for name in ("Füllstand", "Fullstand")}

    sample = OrderedDict([("Füllstand", jnp.zeros(())), ("Fullstand", jnp.zeros(()))])
    exported = ExportedStep(step, jnp.zeros(()), sample, {}, examples)
    files = c_project(Request(exported, 1.0, "all", "Tank für Öl", "", "", False, False))
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    header = files["all.h"].decode()
    for name in ("Fullstand", "Fullstand_", "etat"):
        assert re.search(rf"\b{name};", header)
    sources = [str(tmp_path / f"all{end}.c") for end in ("", "_tables", "_test")]
    program = str(tmp_path / "test")
    subprocess.run([cc, "-std=c99", *sources, "-o", program, "-lm"], check=True)
    assert subprocess.run([program], check=False).returncode == 0


@pytest.mark.parametrize(
    ("judging", "options", "said"),
    [
        (True, ["--to", "rust"], "--to rust: no such target; legal is c"),
        (True, ["--to", "c", "--name", "2 tanks"], "--name 2 tanks"),
        (False, ["--to", "c"], "not calibrated for the bank"),
    ],
)
def test_what_cannot_be_exported_is_refused_before_a_byte_is_written(
    judging, options, said, tmp_path, capsys
):
    model = calibrated("tank") if judging else calibrated("tank").with_calibration(None)
    save_model(model, tmp_path / "tank.fgm")
    command = ["export", str(tmp_path / "tank.fgm"), "--out", str(tmp_path / "c"), *options]
    assert run(command) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


def test_every_target_is_in_the_help(capsys):
    assert run(["export", "--help"]) == 0
    said = capsys.readouterr().out
    assert all(f"{name}:" in said for name in TARGETS)
