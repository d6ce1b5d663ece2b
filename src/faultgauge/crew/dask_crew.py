"""The same on Dask: chunks of portions, each an importable function of bytes, on whatever workers a
scheduler has. A worker may die: its chunks are computed again elsewhere."""

import asyncio
import logging
import os
import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from importlib import import_module, metadata
from itertools import islice
from typing import Any

from faultgauge.crew.chunk import VERSIONS, do_chunk, other_version, versions
from faultgauge.crew.crew import Crew, Failed, Job, Outcome, Portion
from faultgauge.errors import InputError

__all__ = ["on_dask"]

AHEAD = 2  # chunks per worker that are out, so that none waits and memory stays flat
ANSWERS = 8.0  # s, within which a scheduler does
SETTINGS = ("FAULTGAUGE_PROGRAMS", "JAX_", "XLA_", "OPENBLAS_", "OMP_", "MKL_", "TF_CPP_")


@contextmanager
def on_dask(scheduler: str, progress: Callable[[str], None], together: int) -> Iterator[Crew]:
    """The workers of a scheduler; as `crew.crew`."""
    try:
        distributed = import_module("distributed")
    except ImportError:
        raise InputError(
            "--scheduler needs an extra package: pip install faultgauge[dask]; or leave it out."
        ) from None
    with ExitStack() as stack:
        client = stack.enter_context(_client(distributed, scheduler, stack))
        progress("waiting for a worker")
        client.wait_for_workers(1)
        _check_versions(client)

        def crew(job: Job, portions: Iterable[Portion]) -> Iterator[Outcome]:
            return _outcomes(distributed, client, scheduler, job, iter(portions), together)

        yield crew


def _outcomes(
    distributed: Any,
    client: Any,
    scheduler: str,
    job: Job,
    portions: Iterator[Portion],
    together: int,
) -> Iterator[Outcome]:
    settings = {k: v for k, v in os.environ.items() if k.startswith(SETTINGS)}
    wanted = versions()
    out: dict[Any, list[str]] = {}
    ready = distributed.as_completed()

    def send() -> None:
        if chunk := list(islice(portions, together)):
            work = pickle.dumps((job, chunk))
            future = client.submit(do_chunk, settings, wanted, work, pure=False)
            out[future] = [portion.name for portion in chunk]
            ready.add(future)

    for _ in range(AHEAD * len(client.scheduler_info()["workers"])):
        send()
    for future in ready:
        names = out.pop(future)
        try:
            yield from future.result()
        except distributed.KilledWorker as killed:
            why = f"its worker died, {killed.allowed_failures + 1} times over."
            yield from (Failed(name, why) for name in names)
        except (distributed.CancelledError, OSError):
            raise InputError(
                f"--scheduler {scheduler}: went away; what was done is kept, so start it anew "
                "and give the same command again."
            ) from None
        send()


def _client(distributed: Any, scheduler: str, stack: ExitStack) -> Any:
    if scheduler == "local":
        cluster = distributed.LocalCluster(
            n_workers=os.cpu_count(),
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        )
        return distributed.Client(stack.enter_context(cluster))
    try:
        with ThreadPoolExecutor(1) as own_loop:  # in a notebook this thread runs one already
            own_loop.submit(asyncio.run, _answer(distributed, scheduler)).result()
        return distributed.Client(scheduler, timeout=ANSWERS)
    except (OSError, TimeoutError, ValueError, TypeError) as failure:
        text = " ".join(str(failure).split())[:200] or f"not within {ANSWERS:g} s"
        raise InputError(
            f"--scheduler {scheduler}: does not answer ({text}); start one with `dask scheduler`, "
            "check its address, tcp://HOST:PORT, or give local."
        ) from None


async def _answer(distributed: Any, scheduler: str) -> None:
    """Something may listen there and never say a word, for which a client would wait for ever."""
    async with asyncio.timeout(ANSWERS), distributed.rpc(scheduler) as there:
        await there.identity()


def _check_versions(client: Any) -> None:
    """Raises `InputError` for a worker of another version; those that come later check their own.

    By a function of Python itself, which a worker without faultgauge has, too."""
    wanted = versions()
    for name in VERSIONS:
        for worker, found in client.run(metadata.version, name, on_error="return").items():
            if found != wanted[name]:
                there = {} if isinstance(found, Exception) else {name: found}
                raise InputError(other_version(f"worker {worker}", there, {name: wanted[name]}))
