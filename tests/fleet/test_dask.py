"""Fleets on Dask: the same bits as here, whatever becomes of a worker."""

import os
import signal
import socket
from importlib.util import find_spec

import pytest

from faultgauge.crew import dask_crew
from faultgauge.crew.crew import crew
from faultgauge.errors import InputError
from faultgauge.fleet.fit import fit_fleet

from .conftest import PLANT, drawn, write_log

pytestmark = [
    pytest.mark.study,
    pytest.mark.skipif(not find_spec("distributed"), reason="needs the extra dask."),
    pytest.mark.filterwarnings("default"),  # those of a package that is not ours
]
UNITS = 24


@pytest.fixture(scope="module")
def cluster():
    import distributed

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, memory_limit=0, silence_logs=50) as found:
        yield found


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """Logs, and the folder that this process alone fills."""
    folder = tmp_path_factory.mktemp("here")
    for k in range(UNITS):
        write_log(folder / "logs" / f"tank{k:02d}.csv", k, *drawn(k))
    fit_fleet(PLANT, [folder / "logs"], folder / "out")
    return folder


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_worker_that_is_killed_half_way_changes_nothing(cluster, here, tmp_path):
    """Every result once, equal to those of one process to the bit."""
    import distributed

    said = []
    with distributed.Client(cluster) as client:
        doomed = next(iter(client.run(os.getpid).values()))

    def progress(text):
        said.append(text)
        if text.startswith(f"fitting: {UNITS // 2} of"):
            os.kill(doomed, signal.SIGKILL)

    found = fit_fleet(
        PLANT,
        [here / "logs"],
        tmp_path / "out",
        scheduler=cluster.scheduler_address,
        progress=progress,
    )
    assert not found.failed
    assert sum(each.startswith("fitting: ") for each in said) == UNITS
    assert contents(tmp_path / "out") == contents(here / "out")


def test_a_scheduler_that_does_not_answer():
    """A port that nobody reads from."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(InputError, match="does not answer"), crew(address, print):
            pass


@pytest.mark.parametrize("address", ["nowhere", "tcp://", "tcp://127.0.0.1:1"])
def test_no_scheduler_at_all(address):
    with pytest.raises(InputError, match="does not answer"), crew(address, print):
        pass


def test_a_worker_of_another_version_is_refused(cluster, monkeypatch):
    ours = dask_crew.versions()
    monkeypatch.setattr(dask_crew, "versions", lambda: ours | {"faultgauge": "0.0.1"})
    with (
        pytest.raises(InputError, match=r"has faultgauge .*, and here it is 0\.0\.1"),
        crew(cluster.scheduler_address, print),
    ):
        pass
