"""Imports only point down the list of layers, and no function is too long to take in."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import faultgauge
import faultgauge_studies

ROOT = Path(faultgauge.__file__).parent
STUDIES = Path(faultgauge_studies.__file__).parent
LAYERS = (
    "cli",
    "fleet",
    "verbs",
    "reporting",
    "campaigns",
    "accommodation",
    "rehearsal",
    "crew",
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
INSIDE = {  # folders and files of a layer, likewise
    "reporting": (
        *("decision_chapter", "evidence_chapter"),
        *("campaign_chapter", "chapters", "model_chapter", "run_overview"),
        *("calibration_chapter", "detectability_chapter", "refinement_chapter"),
        *("rehearsal_chapter", "retrospective_chapter", "simulation_chapter"),
        *("validation_chapter", "glance", "network_curves", "report"),
        *("campaign_figures", "detectability_figures", "model_figures", "rehearsal_figures"),
        *("relations", "time_figures", "validation_figures", "marks"),
        *("clock_axis", "coverage", "scales", "style", "svg", "thinning", "words"),
    ),
    "detection": (
        *("stream", "calibration", "onset", "answer", "decisions", "watch", "posterior"),
        *("bank", "rows", "remember", "words"),
    ),
    "identification": (
        *("fit", "unseen", "fit_record", "simulation_error", "equation", "validation"),
        *("command_checks", "log_checks", "row_order", "noise_floor", "population"),
        *("between_runs",),
        *("constants", "model_error", "holdout", "optimise", "sizes", "unknowns", "samples"),
    ),
    "telemetry": (
        *("stream", "inspection", "reading", "logs", "readers", "skeleton", "where"),
        *("oversampling", "resampling", "rates", "timing", "other_clock", "other_range"),
        *("dead_time", "statistics", "stuck", "writing", "runs", "mapping", "headers"),
        *("anti_alias", "derivatives", "clock", "summer_time", "table"),
    ),
    "plants": (
        *("settings", "disturbed", "written", "model", "record", "gray_box"),
        *("network", "reached", "plant", "settle", "plant_file", "units", "spec", "schema"),
        *("toml_file", "expression", "dimensions", "shape", "signals", "square_root", "toml_text"),
    ),
}
LONGEST = 60  # lines of a function, its arguments and docstring among them
BELOW_ALL = {"errors", "files", "phases", "products", "programs", "progress", "settings"}
RUN_STUDIES = {"cli/benchmark.py", "cli/demo.py", "cli/reproduce.py"}


def modules(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def imported(path: Path) -> set[str]:
    return {name.split(".")[1] for name in modules(path) if name.startswith("faultgauge.")}


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_imports_only_what_is_below_it(layer):
    legal = {*LAYERS[LAYERS.index(layer) :], *BELOW_ALL}
    files = sorted((ROOT / layer).rglob("*.py"))
    assert files
    for path in files:
        assert imported(path) <= legal, path


@pytest.mark.parametrize("layer", INSIDE)
def test_inside_a_layer_imports_point_down_as_well(layer):
    order = INSIDE[layer]
    homes = {path.relative_to(ROOT / layer).parts[0] for path in (ROOT / layer).rglob("*.py")}
    assert {Path(home).stem for home in homes if not home.startswith("_")} == {*order}
    for path in sorted((ROOT / layer).rglob("*.py")):
        own = path.relative_to(ROOT / layer).with_suffix("").parts[0]
        taken = {
            name.split(".")[2] for name in modules(path) if name.startswith(f"faultgauge.{layer}.")
        }
        if own in order:
            assert taken <= {*order[order.index(own) :]}, path


def test_studies_import_no_command():
    for path in sorted(STUDIES.rglob("*.py")):
        assert imported(path) <= {*LAYERS[LAYERS.index("verbs") :], *BELOW_ALL}, path


def test_only_the_commands_that_run_studies_know_them():
    knowing = {
        str(path.relative_to(ROOT))
        for path in ROOT.rglob("*.py")
        if any(name.split(".")[0] == "faultgauge_studies" for name in modules(path))
    }
    assert knowing == RUN_STUDIES
    for name in RUN_STUDIES:  # and no sooner than they run
        at_import = ast.parse((ROOT / name).read_text()).body
        loaded = {node.module for node in at_import if isinstance(node, ast.ImportFrom)}
        assert not any(module.startswith("faultgauge_studies") for module in loaded if module)


def offered(tree: ast.Module) -> set[str]:
    """What a module's `__all__` names."""
    lists = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
    ]
    return set(ast.literal_eval(lists[0])) if lists else set()


def test_a_module_takes_from_another_only_what_that_one_offers():
    trees = {}
    for path in [*ROOT.rglob("*.py"), *STUDIES.rglob("*.py")]:
        name = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
        trees[name.removesuffix(".__init__")] = ast.parse(path.read_text())
    offers = {name: offered(tree) for name, tree in trees.items()}
    taken = [
        f"{name} takes {alias.name} from {node.module}"
        for name, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module in trees
        for alias in node.names
        if f"{node.module}.{alias.name}" not in trees and alias.name not in offers[node.module]
    ]
    assert not taken


def test_a_public_class_has_a_name_of_its_own():
    """Within the product; two classes of one name are two ideas with one word."""
    homes: dict[str, list[str]] = {}
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert not {name: where for name, where in homes.items() if len(where) > 1}


def test_every_folder_is_a_layer():
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert folders == set(LAYERS)


def test_no_function_is_longer_than_a_screen():
    long = [
        f"{path}: {node.name} has {node.end_lineno - node.lineno + 1} lines"
        for path in sorted([*ROOT.rglob("*.py"), *STUDIES.rglob("*.py")])
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno - node.lineno >= LONGEST
    ]
    assert not long


def test_no_function_has_more_than_fifteen_ways_through_it():
    # as pyproject.toml has it; no comment in the code lets one pass
    rule = ["check", "--no-cache", "--select", "C901", "--ignore-noqa", "--quiet"]
    ruff = [sys.executable, "-m", "ruff", *rule, str(ROOT), str(STUDIES)]
    found = subprocess.run(ruff, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
