"""Fixtures for every test. Types and shapes are checked while tests run (jaxtyping, beartype)."""

import os
from pathlib import Path

import jaxtyping
import pytest

# As the commands have it: one thread each; a program is compiled once for all workers.
for name, value in {
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "JAX_PLATFORMS": "cpu",
    "JAX_COMPILATION_CACHE_DIR": str(Path(__file__).parents[1] / ".cache" / "jax"),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    "JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES": "none",
}.items():
    os.environ.setdefault(name, value)

jaxtyping.install_import_hook("faultgauge", "beartype.beartype").__enter__()

import jax  # noqa: E402  (after the hook, so that nothing of ours is imported before it)

jax.config.update("jax_enable_x64", True)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with the public measured data sets, or a skip that says where it should be."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FAULTGAUGE_DATA", default))
    if not folder.is_dir():
        pytest.skip("measured data absent: set FAULTGAUGE_DATA to the folder that holds them")
    return folder
