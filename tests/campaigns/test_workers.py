"""Campaigns and rehearsals on Dask: the same bits as here, whatever becomes of a worker."""

import os
import shutil
import signal
from importlib.util import find_spec
from pathlib import Path

import pytest

from faultgauge.campaigns import read_campaign
from faultgauge.campaigns.runs import healthy_run
from faultgauge.errors import InputError
from faultgauge.rehearsal.rehearse import rehearse
from faultgauge.verbs.campaign import campaign

from .conftest import CAMPAIGN, contents, judging

pytestmark = [
    pytest.mark.study,
    pytest.mark.skipif(not find_spec("distributed"), reason="needs the extra dask."),
    pytest.mark.filterwarnings("default"),  # those of a package that is not ours
]


@pytest.fixture(scope="module")
def cluster():
    import distributed

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, memory_limit=0, silence_logs=50) as found:
        yield found


@pytest.fixture
def folder(files, tmp_path):
    """All that the campaign file names, to be changed."""
    return Path(shutil.copytree(files, tmp_path / "files"))


def killing(cluster, word):
    """Progress that kills a worker when it tells of `word` for the third time; what it was told."""
    import distributed

    with distributed.Client(cluster) as client:
        doomed = next(iter(client.run(os.getpid).values()))
    said = []

    def progress(text):
        if word in text:
            said.append(str(text))
            if len(said) == 3:
                os.kill(doomed, signal.SIGKILL)

    return progress, said


def test_a_campaign_of_which_a_worker_dies_ends_with_the_same_files(cluster, folder, tmp_path):
    plan = folder / "campaign.toml"
    plan.write_text(CAMPAIGN.replace("seeds = 2", "seeds = 12"))
    campaign(plan, tmp_path / "here")
    progress, said = killing(cluster, " runs")
    campaign(plan, tmp_path / "there", scheduler=cluster.scheduler_address, progress=progress)
    assert len(said) > 3
    assert contents(tmp_path / "there") == contents(tmp_path / "here")


def test_a_rehearsal_of_which_a_worker_dies_says_the_same(cluster, folder):
    plan = read_campaign(folder / "campaign.toml")
    runs = [healthy_run(plan, seed, f"run{seed}") for seed in (50, 51)]
    here = rehearse(judging(), runs, trials=40)
    progress, said = killing(cluster, "judged")
    there = rehearse(
        judging(), runs, trials=40, scheduler=cluster.scheduler_address, progress=progress
    )
    assert len(said) > 3
    assert there.as_dict() == here.as_dict()


def test_what_fails_there_is_told_here(cluster, folder, tmp_path):
    """A run that leaves all bounds, as in one process."""
    scenario = folder / "scenario.toml"
    scenario.write_text(scenario.read_text().replace("offset = 1", "offset = 1e300"))
    refused = []
    for scheduler in (None, cluster.scheduler_address):
        with pytest.raises(InputError) as wrong:
            campaign(folder / "campaign.toml", tmp_path / str(bool(scheduler)), scheduler=scheduler)
        refused.append(str(wrong.value))
    assert refused[0] == refused[1]
