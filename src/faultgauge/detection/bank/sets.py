"""Which faults may be present together."""

from collections.abc import Sequence
from itertools import combinations

__all__ = ["Set", "fault_sets"]

Set = tuple[int, ...]


def fault_sets(faults: Sequence[int], most: int) -> tuple[Set, ...]:
    """Healthy, singles, pairs, and so on to sets of `most`."""
    sizes = range(min(most, len(faults)) + 1)
    return tuple(each for size in sizes for each in combinations(faults, size))
