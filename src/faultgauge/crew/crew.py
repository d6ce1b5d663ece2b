"""Who does the work: a job for every portion, here one after another, or in chunks on Dask.

A job is a picklable callable that gives the files of one portion as bytes: of a unit of a fleet,
of some runs of a campaign. Whoever asked for them writes them: wherever a portion was done, its
results land once.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias, runtime_checkable

from faultgauge.errors import InputError

__all__ = ["Crew", "Done", "Failed", "Job", "Outcome", "Portion", "attempt", "crew", "done"]


@runtime_checkable
class Portion(Protocol):
    """What is done at once, and can be pickled."""

    @property
    def name(self) -> str: ...


@dataclass(frozen=True)
class Done:
    """What became of a portion: its `files` by name, in the order in which they are written."""

    name: str
    files: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Failed:
    """A portion that cannot be done, and why, in a sentence; `ours` where that is no fault of the
    input."""

    name: str
    why: str
    ours: bool = False


Outcome: TypeAlias = Done | Failed
Job: TypeAlias = Callable[[Any], Done]
# every portion's outcome, once, as they are ready
Crew: TypeAlias = Callable[[Job, Iterable[Portion]], Iterator[Outcome]]


def attempt(job: Job, portion: Portion) -> Outcome:
    """`job` for `portion`, whose failure is that of no other."""
    try:
        return job(portion)
    except InputError as wrong:
        return Failed(portion.name, str(wrong))
    except Exception as fault:  # noqa: BLE001  (ours, and no reason to lose the others)
        text = " ".join(str(fault).split())[:300]
        return Failed(portion.name, f"internal error ({type(fault).__name__}: {text}).", ours=True)


def done(
    scheduler: str | None,
    job: Job,
    portions: Iterable[Portion],
    progress: Callable[[str], None],
) -> Iterator[Done]:
    """`job` for every portion, as they are ready, of which none may fail: what fails here raises as
    it did, and what fails elsewhere `InputError`, or `RuntimeError` where it is our own fault."""
    if scheduler is None:
        yield from map(job, portions)
        return
    with crew(scheduler, progress, together=1) as workers:
        for outcome in workers(job, portions):
            if isinstance(outcome, Failed):
                raise (RuntimeError if outcome.ours else InputError)(outcome.why)
            yield outcome


@contextmanager
def crew(
    scheduler: str | None, progress: Callable[[str], None], together: int = 4
) -> Iterator[Crew]:
    """Who does jobs: without a `scheduler` this process, one portion after another; `local` starts
    one with workers on this machine, any other is the address of one, whose workers take so many
    portions `together`.

    Raises `InputError` for a scheduler that does not answer, or whose workers are of another
    version.
    """
    if scheduler is None:
        yield lambda job, portions: (attempt(job, portion) for portion in portions)
        return
    from faultgauge.crew.dask_crew import on_dask

    with on_dask(scheduler, progress, together) as workers:
        yield workers
