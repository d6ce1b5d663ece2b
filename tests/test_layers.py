"""Imports only point down the list of layers, and no function is too long to take in."""

import ast
from pathlib import Path

import pytest

import faultgauge

ROOT = Path(faultgauge.__file__).parent
LAYERS = (
    "cli",
    "fleet",
    "verbs",
    "studies",
    "reporting",
    "campaigns",
    "accommodation",
    "rehearsal",
    "foresight",
    "export",
    "detection",
    "observers",
    "identification",
    "simulation",
    "excitation",
    "telemetry",
    "plants",
)
LONGEST = 60  # lines of a function, its arguments and docstring among them
BELOW_ALL = {"errors", "files", "progress"}


def imported(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name.split(".")[1] for name in found if name.startswith("faultgauge.")}


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_imports_only_what_is_below_it(layer):
    legal = {*LAYERS[LAYERS.index(layer) :], *BELOW_ALL}
    files = sorted((ROOT / layer).rglob("*.py"))
    assert files
    for path in files:
        assert imported(path) <= legal, path


def test_every_folder_is_a_layer():
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert folders == set(LAYERS)


def test_no_function_is_longer_than_a_screen():
    # how many ways lead through one, Ruff counts (C901)
    long = [
        f"{path.relative_to(ROOT)}: {node.name} has {node.end_lineno - node.lineno + 1} lines"
        for path in sorted(ROOT.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno - node.lineno >= LONGEST
    ]
    assert not long
