"""What became of a claim."""

from typing import NamedTuple

__all__ = ["Verdict"]


class Verdict(NamedTuple):
    """The claim in a few words, what was found in one sentence, and whether the claim stands."""

    claim: str
    found: str
    holds: bool
