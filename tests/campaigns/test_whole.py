"""Whole campaigns of a tank that is known exactly, and ten kills of one."""

import random
import shutil
import signal
import subprocess
import sys
import time

import pytest

from faultgauge.verbs.campaign import campaign

from .conftest import contents

pytest.importorskip("pyarrow", reason="needs the extra io.")
pytestmark = pytest.mark.study


def test_large_faults_are_named_and_sized_and_small_ones_missed(files, tmp_path):
    """A leak of 0.1 m/s is 50 times what shows, one of 0.001 m/s a fortieth of the noise."""
    done = campaign(files / "campaign.toml", tmp_path / "out")
    leak, gauge, silent = done.found.kinds
    assert (leak.runs, gauge.runs, silent.runs) == (4, 2, 2)
    small, *large = leak.faults.by_size
    assert (small.size, small.found.count) == (0.001, 0)
    for row in (*large, *gauge.faults.by_size):
        assert row.exact.count == row.trials == 2
        assert row.error_median is not None
        assert row.error_median < 0.05
    rows = done.columns()
    assert rows["kind"] == ["healthy"] + ["leak"] * 4 + ["gauge"] * 2 + ["silent"] * 2
    assert rows["answer"][-2:] == ["nothing", "nothing"]
    # the tank is healthy for 50 s, or for 100 s; ten samples to begin with are held back
    hours = sum(rows["healthy_hours"])
    assert hours == pytest.approx((100 + 8 * 50 - 9 * 5) / 3600, rel=0.02)
    # a dropout is nothing that could be told
    assert (done.found.separable.below, done.found.separable.exact.total) == (2, 4)


def test_ten_kills_at_random_moments_end_with_the_undisturbed_files(files, tmp_path, long_jobs):
    path = tmp_path / "campaign.toml"
    for name in ("tank.toml", "scenario.toml", "model.fgm"):
        shutil.copy(files / name, tmp_path)
    path.write_text((files / "campaign.toml").read_text().replace("seeds = 2", "seeds = 40"))
    call = [sys.executable, "-m", "faultgauge", "campaign", str(path), "--out"]
    begun = time.monotonic()
    subprocess.run([*call, str(tmp_path / "whole")], check=True, env=long_jobs)
    seconds = time.monotonic() - begun
    moments = random.Random(0)
    for _ in range(10):
        process = subprocess.Popen([*call, str(tmp_path / "killed")], env=long_jobs)
        try:
            process.wait(moments.uniform(0.2, 0.9) * seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
    subprocess.run([*call, str(tmp_path / "killed")], check=True, env=long_jobs)
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")
