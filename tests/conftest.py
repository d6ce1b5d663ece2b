"""Fixtures for every test. Types and shapes are checked while tests run (jaxtyping, beartype)."""

import os
from pathlib import Path

import jaxtyping
import pytest

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
