"""Where arrays lie: which may share memory, and what a copy need not do.

Two arrays are in each other's way if one is written while the other is still to be read (liveness
over the statements, branch by branch). Arrays that are not share memory; first of all a copy and
its original, and an array and the one that an elementwise loop makes of it.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from faultgauge.export.nests import Nest

__all__ = ["Array", "Branch", "CLoop", "Node", "Statement", "place"]


@dataclass(eq=False)
class Array:
    """`fixed` names the place of one that is not in the workspace, as a member of the state, which
    may be a `scalar`; `offset` is its place in the workspace of its `kind`. With `longest_last` the
    longest axis runs fastest, which loops are then made of, else the last one."""

    size: int
    kind: str
    fixed: str | None = None
    scalar: bool = False
    offset: int = 0
    shared: "Array | None" = None
    longest_last: bool = False

    @property
    def home(self) -> "Array":
        return self if self.shared is None else self.shared.home


@dataclass(eq=False)
class Statement:
    """Lines of C. Of what it reads, `there` is read at the very place that is then written, or at
    one that is written later; `part` says that other parts of what is written stay as they are."""

    lines: list[str | Nest]
    writes: set[Array] = field(default_factory=set)
    reads: set[Array] = field(default_factory=set)
    there: set[Array] = field(default_factory=set)
    part: bool = False
    copy: bool = False

    @property
    def idle(self) -> bool:
        """Whether it copies an array onto itself."""
        homes = {each.home for each in (*self.writes, *self.there)}
        return self.copy and len(homes) == 1 and not self.reads


@dataclass(eq=False)
class Branch:
    """An `if` of as many ways as there are `ways`, each a condition, which `reads` arrays, and what
    is then done."""

    ways: "list[tuple[str, list[Node]]]"
    reads: set[Array] = field(default_factory=set)


@dataclass(eq=False)
class CLoop:
    """A loop: its `head` in C, and what it repeats."""

    head: str
    body: "list[Node]"


Node = Statement | Branch | CLoop


def place(nodes: Sequence[Node], arrays: Sequence[Array], lasting: set[Array]) -> dict[str, int]:
    """Places all `arrays`; `lasting` are read after the last statement. How much of each kind the
    workspace holds."""
    number = {each: k for k, each in enumerate(arrays)}
    apart: dict[Array, set[Array]] = defaultdict(set)
    _live(nodes, set(lasting), apart)
    for statement in sorted(_statements(nodes), key=lambda each: not each.copy):
        for new in statement.writes:
            for old in sorted(statement.there, key=number.__getitem__):
                _share(new.home, old.home, apart)
    own = [each for each in arrays if each.shared is None and each.fixed is None]
    placed: dict[str, list[Array]] = defaultdict(list)
    for each in sorted(own, key=lambda a: (-a.size, number[a])):
        taken = [o for o in placed[each.kind] if o in apart[each]]
        each.offset = _lowest(each.size, taken)
        placed[each.kind].append(each)
    return {k: max(a.offset + a.size for a in those) for k, those in sorted(placed.items())}


def _lowest(size: int, taken: Sequence[Array]) -> int:
    at = 0
    for each in sorted(taken, key=lambda a: a.offset):
        if each.offset >= at + size:
            break
        at = max(at, each.offset + each.size)
    return at


def _statements(nodes: Sequence[Node]) -> list[Statement]:
    found: list[Statement] = []
    for each in nodes:
        if isinstance(each, Statement):
            found.append(each)
        elif isinstance(each, CLoop):
            found += _statements(each.body)
        else:
            for _, way in each.ways:
                found += _statements(way)
    return found


def _live(nodes: Sequence[Node], after: set[Array], apart: dict[Array, set[Array]]) -> set[Array]:
    """What is read later than before `nodes`, where `after` is read behind them."""
    live = after
    for each in reversed(nodes):
        if isinstance(each, Statement):
            # a copy and its original may stay one for as long as neither changes
            alike = each.there if each.copy else set()
            for new in each.writes:
                for other in (live | each.reads | each.writes) - {new} - alike:
                    apart[new].add(other)
                    apart[other].add(new)
            live = (live if each.part else live - each.writes) | each.reads | each.there
        elif isinstance(each, CLoop):
            while True:  # what a turn reads, the turn before must leave
                grown = live | _live(each.body, live, apart)
                if grown == live:
                    break
                live = grown
        else:
            live = each.reads.union(*(_live(way, live, apart) for _, way in each.ways))
    return live


def _share(new: Array, old: Array, apart: dict[Array, set[Array]]) -> None:
    alike = new.size == old.size and new.kind == old.kind and new is not old
    if not alike or old in apart[new] or (new.fixed and old.fixed):
        return
    keep, gone = (new, old) if new.fixed else (old, new)
    gone.shared = keep
    for other in apart.pop(gone, set()):
        apart[other].discard(gone)
        apart[other].add(keep)
        apart[keep].add(other)
