"""Independent fits, one to a core: a compiled program lets go of Python's lock."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

__all__ = ["side_by_side"]

Given = TypeVar("Given")
Found = TypeVar("Found")


def side_by_side(function: Callable[[Given], Found], items: Iterable[Given]) -> list[Found]:
    """`function` of each of `items`, in their order.

    One after another where programs have threads of their own, which would wait for each other;
    ours have none (see `settings`).
    """
    alone = "--xla_cpu_multi_thread_eigen=false" not in os.environ.get("XLA_FLAGS", "")
    with ThreadPoolExecutor(1 if alone else os.cpu_count()) as pool:
        return list(pool.map(function, items))
