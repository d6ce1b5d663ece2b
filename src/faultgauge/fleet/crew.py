"""Who does the work: a job for every unit, here one after another, or in chunks on Dask.

A job is a picklable callable that gives the files of one unit as bytes. Whoever asked for them
writes them: wherever a unit was done, its results land once.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeAlias

from faultgauge.errors import InputError
from faultgauge.fleet.units import Unit

__all__ = ["Crew", "Done", "Failed", "Job", "Outcome", "attempt", "crew"]


@dataclass(frozen=True)
class Done:
    """What became of a unit: its `files` by name, in the order in which they are to be written."""

    unit: str
    files: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Failed:
    """A unit that cannot be done, and why, in a sentence."""

    unit: str
    why: str


Outcome: TypeAlias = Done | Failed
Job: TypeAlias = Callable[[Unit], Done]
# every unit's outcome, once, as they are ready
Crew: TypeAlias = Callable[[Job, Iterable[Unit]], Iterator[Outcome]]


def attempt(job: Job, unit: Unit) -> Outcome:
    """`job` for `unit`, whose failure is that of no other."""
    try:
        return job(unit)
    except InputError as wrong:
        return Failed(unit.name, str(wrong))
    except Exception as fault:  # noqa: BLE001  (ours, and no reason to lose the others)
        text = " ".join(str(fault).split())[:300]
        return Failed(unit.name, f"internal error ({type(fault).__name__}: {text}).")


@contextmanager
def crew(scheduler: str | None, progress: Callable[[str], None]) -> Iterator[Crew]:
    """Who does jobs: without a `scheduler` this process, unit after unit; `local` starts one with
    workers on this machine, any other is the address of one.

    Raises `InputError` for a scheduler that does not answer, or whose workers are of another
    version.
    """
    if scheduler is None:
        yield lambda job, units: (attempt(job, unit) for unit in units)
        return
    from faultgauge.fleet.dask_crew import on_dask

    with on_dask(scheduler, progress) as workers:
        yield workers
