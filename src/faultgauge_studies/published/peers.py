"""The peer beside us: jax-sysid on the same splits, started in an environment of its own."""

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge_studies.published.benchmark import Benchmark, Records, Split
from faultgauge_studies.published.spread import spread

__all__ = ["fitted_on", "interpreter", "jax_sysid"]

SCRIPT = Path(__file__).with_name("jax_sysid_peer.py")
PATIENCE = 1200.0  # s per seed; a fit takes two to three minutes on one core
ABSENT = (
    "skipped: jax-sysid needs an environment of its own; make it with `make peers`, or set "
    "FAULTGAUGE_PEERS_PYTHON to the Python that has it."
)


def _candidates(**settings: Sequence[Any]) -> list[dict[str, Any]]:
    """Every combination of the settings given as lists."""
    found: list[dict[str, Any]] = [{}]
    for key, values in settings.items():
        found = [{**each, key: value} for each in found for value in values]
    return found


# Candidates per benchmark: the sizes and weights of jax-sysid's examples around the order that the
# physics suggests, as many as two to three minutes allow. `longest`: first samples of a training
# run, where all would take hours; `every`: every so many samples, where the motion is slow.
SETTINGS: dict[str, dict[str, Any]] = {
    "emps": {
        "every": 5,
        "starts": 2,
        "candidates": _candidates(
            states=[2, 3], hidden=[8], rho=[1e-6, 1e-4], input=["plain"], first_pole=[0.98],
            adam_epochs=[1000], lbfgs_epochs=[2000], linear_epochs=[500],
        ),
    },
    "cascaded_tanks": {
        "every": 1,
        "starts": 3,
        "candidates": _candidates(
            states=[2, 3], hidden=[5], rho=[1e-4, 1e-3], input=["plain"],
            first_pole=[0.5], adam_epochs=[1000], lbfgs_epochs=[2000], linear_epochs=[500],
        ),
    },
    "silverbox": {
        "every": 1,
        "starts": 1,
        "longest": 20000,
        "candidates": _candidates(
            states=[2, 3], hidden=[10], rho=[1e-8], input=["plain"], first_pole=[0.5],
            adam_epochs=[500], lbfgs_epochs=[4000], linear_epochs=[300],
        ),
    },
    "wiener_hammerstein_2009": {
        "every": 1,
        "starts": 1,
        "skipped": 5200,  # silence
        "longest": 20000,
        "candidates": _candidates(
            states=[6], hidden=[15], rho=[1e-8], input=["plain"], first_pole=[0.5],
            adam_epochs=[500], lbfgs_epochs=[3000], linear_epochs=[300],
        ),
    },
    "quarter_drone": {
        "every": 4,
        "starts": 1,
        "candidates": _candidates(
            states=[2, 3], hidden=[8], rho=[1e-4, 1e-2], input=["plain", "signed square"],
            first_pole=[0.5], adam_epochs=[1000], lbfgs_epochs=[2000], linear_epochs=[500],
        ),
    },
}  # fmt: skip


def fitted_on(name: str) -> str:
    """What jax-sysid gets of the training runs of a benchmark, as a sentence."""
    settings = SETTINGS[name]
    if "longest" in settings:
        return f"jax-sysid is fitted on {settings['longest']} samples of the training run."
    if settings["every"] > 1:
        return f"jax-sysid is fitted on every {settings['every']}th sample of the training runs."
    return "jax-sysid is fitted on the whole training run."


def interpreter() -> Path | None:
    """The Python that has jax-sysid, or None."""
    named = os.environ.get("FAULTGAUGE_PEERS_PYTHON")
    path = Path(named) if named else Path(".venv-peers") / "bin" / "python"
    return path.absolute() if path.is_file() else None


def jax_sysid(
    chosen: Benchmark,
    records: Records,
    seeds: Sequence[int],
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any] | str:
    """`{"splits": {SPLIT: {"rmse"}}, "fit_s", "seeds"}` of jax-sysid, or a sentence why not.

    The same score as ours: pure simulation, the first samples of a test run for its initial
    state alone, RMSE over the rest in the benchmark's unit.
    """
    python = interpreter()
    if python is None:
        return ABSENT
    errors: dict[str, list[float]] = {split.name: [] for split in records.splits}
    times = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_task(folder, chosen, records)
        for seed in seeds:
            progress(f"{chosen.title}: jax-sysid, seed {seed}")
            failure = _run(python, folder, seed)
            if failure is not None:
                return failure
            times.append(float(json.loads((folder / f"seed_{seed}.json").read_text())["fit_s"]))
            with np.load(folder / f"seed_{seed}.npz") as predicted:
                for split in records.splits:
                    errors[split.name].append(_rmse(chosen, split, predicted[split.name]))
    return {
        "splits": {name: {"rmse": spread(values)} for name, values in errors.items()},
        "fit_s": spread(times),
        "seeds": len(seeds),
    }


def _write_task(folder: Path, chosen: Benchmark, records: Records) -> None:
    settings = SETTINGS[chosen.name]
    first = settings.get("skipped", 0)
    part = slice(first, first + settings["longest"] if "longest" in settings else None)
    arrays = {}
    for k, run in enumerate(records.train):
        arrays[f"u{k}"] = run.columns["u"][part]
        arrays[f"y{k}"] = run.columns[chosen.output][part]
    for split in records.splits:
        arrays[f"u_{split.name}"] = split.test.columns["u"]
        # no more of the test outputs leaves this process than finds the initial state
        arrays[f"y_{split.name}"] = split.test.columns[chosen.output][: split.window]
    np.savez(folder / "data.npz", **arrays)
    task = {
        "runs": len(records.train),
        "tests": {split.name: split.window for split in records.splits},
        "every": settings["every"],
        "starts": settings["starts"],
        "candidates": settings["candidates"],
    }
    (folder / "task.json").write_text(json.dumps(task))


def _run(python: Path, folder: Path, seed: int) -> str | None:
    """One seed; None, or what went wrong."""
    # settings of our JAX may be unknown to the peer's
    ours = ("JAX_", "XLA_")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(ours)}
    try:
        done = subprocess.run(
            [str(python), str(SCRIPT), str(folder), str(seed)],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=PATIENCE,
            env={**kept, "JAX_PLATFORMS": "cpu"},
        )
    except subprocess.TimeoutExpired:
        return f"skipped: jax-sysid took longer than {PATIENCE:g} s with seed {seed}."
    except OSError as failure:
        return f"skipped: {python} cannot be started ({failure.strerror})."
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1][:200]
        return f"skipped: jax-sysid failed with seed {seed} ({last}); `make peers` makes it anew."
    return None


def _rmse(chosen: Benchmark, split: Split, predicted: np.ndarray) -> float:
    error = (predicted - split.test.columns[chosen.output])[split.window :]
    return float(chosen.scale * np.sqrt(np.mean(error**2)))
