"""Fixtures for every test. Shapes are checked while tests run (jaxtyping, beartype)."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jaxtyping
import pytest

# Most tests run a program once: quick compiling beats quick code.
QUICK = "--xla_cpu_multi_thread_eigen=false --xla_cpu_use_fusion_emitters=false"
# All of a program as one module of LLVM: tests keep both cores busy without dividing it.
WHOLE = "--xla_cpu_parallel_codegen_split_count=1"
# By the time that they take: were one of these among the last, it would run on one core alone.
LONGEST = (
    "cli/test_commands.py",
    "test_docs.py",
    "export/test_watch.py",
    "detection/test_slow_sensors.py",
    "detection/test_noise_estimation.py",
    "detection/test_stream_bank.py",
    "rehearsal/test_rehearse.py",
    "detection/test_bank_calibration.py",
    "export/test_export.py",
    "detection/test_start.py",
    "detection/test_watch.py",
    "detection/test_envelope.py",
    "detection/test_coverage.py",
    "detection/test_decisions.py",
    "reporting/words/test_answer.py",
    "detection/test_retrospective.py",
    "observers/test_branching.py",
    "identification/test_sizes.py",
    "identification/equation/test_crowds.py",
    "identification/test_unseen.py",
    "identification/equation/test_weak_form.py",
    "identification/test_slow_sensors.py",
    "identification/simulation_error/test_hidden_states.py",
    "identification/simulation_error/test_outcome.py",
    "identification/simulation_error/test_bad_input.py",
    "identification/simulation_error/test_claims.py",
    "identification/test_command_checks.py",
    "fleet/test_fit.py",
    "foresight/test_sensors.py",
    "studies/test_accommodating.py",
)
# Files that share a model or a bank, and so what is compiled for it, run on one worker.
TOGETHER = {
    "tank": (  # tanks.py, scenes.py
        "tests/cli/",
        "tests/verbs/",
        "detection/test_scenes.py",
        "detection/test_one_source.py",
        "reporting/test_pages.py",
    ),
    "lag": (  # lags.py
        "detection/test_bank_calibration.py",
        "detection/test_start.py",
        "detection/test_event_sizes.py",
    ),
    "warm": ("detection/test_decisions.py", "detection/test_retrospective.py"),  # warm.py
}
# As the commands have it: one thread each; a program is compiled once for all workers.
for name, value in {
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": f"{QUICK} {WHOLE} --xla_backend_optimization_level=1",
    "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",
    "JAX_PLATFORMS": "cpu",
    "JAX_TRACEBACK_IN_LOCATIONS_LIMIT": "0",  # of a program's operations, which nobody reads here
    "JAX_COMPILATION_CACHE_DIR": str(Path(__file__).parents[1] / ".cache" / "jax"),
    "FAULTGAUGE_PROGRAMS": "",  # nothing is kept: types are checked where a program is traced
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    "JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES": "none",
}.items():
    os.environ.setdefault(name, value)
# Tests start Python some fifty times: what one of them has compiled of ours serves the others.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

gc.set_threshold(200_000)  # as the commands have it: tracing makes many objects and few cycles

import jax  # noqa: E402  (after what it is told above)
from jax._src.lax.lax import stage_p  # noqa: E402

import type_checks  # noqa: E402

jaxtyping.jaxtyped = type_checks.jaxtyped  # by which the hook has every function checked
jaxtyping.install_import_hook(("faultgauge", "faultgauge_studies"), None).__enter__()

jax.config.update("jax_enable_x64", True)
# `jnp.asarray` of an array of NumPy would compile a program that does nothing for every shape.
stage_p.def_impl(lambda x: x if isinstance(x, jax.Array) else jax.device_put(x))

MAPS = Path("/proc/self/maps")


def pytest_addoption(parser: pytest.Parser) -> None:
    text = "a folder for a picture of every report that tests/reporting/test_pages.py lays out"
    parser.addoption("--pictures", metavar="DIR", type=Path, help=text)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    from xdist.scheduler import LoadFileScheduling

    class Together(LoadFileScheduling):
        """A file to a worker, and every group of `TOGETHER`."""

        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::")[0]
            groups = (k for k, parts in TOGETHER.items() if any(each in file for each in parts))
            return next(groups, file)

    return Together(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {Path(__file__).parent / name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(LONGEST)))


def pytest_runtest_setup() -> None:
    """What is there before a test is not gone through by the collector of garbage, which it is
    not: every walk over millions of traced objects takes seconds."""
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish() -> None:
    gc.freeze()  # pytest collects five times at its end


@pytest.fixture(scope="module", autouse=True)
def few_programs() -> Iterator[None]:
    """Compiled programs go before there are too many: six mappings each, and Linux allows a
    process 65530, where one process alone runs every test."""
    yield
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > 45_000:
        gc.unfreeze()
        jax.clear_caches()
        gc.collect()


@pytest.fixture(scope="module")
def quick_code() -> Iterator[None]:
    """For modules that run what they compile for long. No program is shared with others: theirs
    may differ in the last bit."""
    jax.clear_caches()
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", True)
    jax.clear_caches()


@pytest.fixture
def noise_once() -> Iterator[None]:
    """For calibrations of which not the noise is asked for."""
    from once import looked_once

    with looked_once():
        yield


@pytest.fixture(scope="session")
def long_jobs() -> dict[str, str]:
    """Environment of processes that run what they compile for long."""
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return {
        **os.environ,
        "PATH": programs,
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "0",
    }


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with the public measured data sets, or a skip that says where it should be."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FAULTGAUGE_DATA", default))
    if not folder.is_dir():
        pytest.skip("measured data absent: set FAULTGAUGE_DATA to the folder that holds them")
    return folder
