"""docs/accommodation.md: its commands run, and do what the page says."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from faultgauge.telemetry import read_telemetry

pytestmark = pytest.mark.study

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "accommodation.md").read_text()
LEVELS = {"h1": 12.4, "h2": 12.7}  # cm, where the scenarios hold them


@pytest.fixture(scope="module")
def logs(tmp_path_factory, long_jobs):
    """(accommodated, left alone): the runs that the page's commands write."""
    folder = tmp_path_factory.mktemp("page")
    for path in (ROOT / "examples" / "four_tanks").glob("*.toml"):
        shutil.copy(path, folder)
    for text in re.findall(r"^```bash\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL):
        done = subprocess.run(
            ["bash", "-euc", text],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            env=long_jobs,
        )
        assert done.returncode == 0, done.stderr
    return [read_telemetry(folder / name)[0] for name in ("faulty.csv", "left_alone.csv")]


def test_both_faults_are_named_and_no_other(logs):
    for run in logs:
        late = run.t > 1200
        for name, acted in (("pump1", 1), ("leak2", 1), ("pump2", 0), ("leak1", 0)):
            assert np.all(run.columns[f"acted_{name}"][late] == acted), name
        assert not any(
            run.columns[f"acted_{name}"][run.t < 1000].any() for name in ("pump1", "leak2")
        )


def test_their_sizes_are_found_by_the_learned_model(logs):
    for run in logs:
        late = run.t > 1200
        # a tenth: what the learned outlets are off by where the faults have taken the tanks
        assert run.columns["fhat_pump1"][late].mean() == pytest.approx(0.3, rel=0.1)
        assert run.columns["fhat_leak2"][late].mean() == pytest.approx(-0.05, rel=0.1)


def test_the_levels_are_held_better_than_by_the_controller_alone(logs):
    def off(run, name):
        return np.sqrt(np.mean((run.columns[name][run.t > 1000] - LEVELS[name]) ** 2))

    accommodated, alone = logs
    for name in LEVELS:
        # the integral takes 500 s, the policy about 100 s: well below the square root of that
        assert off(accommodated, name) < 0.7 * off(alone, name), name
