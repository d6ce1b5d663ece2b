"""What a worker of Dask does: a chunk of portions, with settings and version of who asks."""

import os
import pickle
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from faultgauge.errors import InputError

__all__ = ["VERSIONS", "do_chunk", "other_version", "versions"]

VERSIONS = ("faultgauge", "jax", "numpy")  # another of these may give other bits


def versions() -> dict[str, str]:
    """Of the packages on which bits depend, as they are installed here."""
    return {name: metadata.version(name) for name in VERSIONS}


def do_chunk(settings: Mapping[str, str], wanted: Mapping[str, str], work: bytes) -> list[Any]:
    """The outcomes of pickled (job, portions), in their order. `settings` of the environment stand
    before a numeric library is loaded, which unpickling does."""
    if versions() != wanted:
        raise InputError(other_version("a worker", versions(), wanted))
    for name, value in settings.items():
        os.environ.setdefault(name, value)
    from faultgauge.crew.crew import attempt

    job, portions = pickle.loads(work)
    return [attempt(job, portion) for portion in portions]


def other_version(who: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> str:
    """The refusal of a worker, `who`, that has `found` where `wanted` is needed."""
    name = next(each for each in wanted if found.get(each) != wanted[each])
    return (
        f"--scheduler: {who} has {name} {found.get(name, 'not at all')}, and here it is "
        f"{wanted[name]}, so that results would differ; install the same version there."
    )
