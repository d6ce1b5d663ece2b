"""Nested loops of C before they are text, and how nests become fewer and longer loops."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from faultgauge.export.places import ELEMENT, Place

__all__ = ["Nest", "flat", "merged"]

VECTOR = 16  # turns of a sum from which on it is worth being several
VARIABLE = re.compile(r"\bi\d+\b")


@dataclass(eq=False)
class Nest:
    """A loop of `length` turns over the variable `name`; a `pragma` tells compilers what they
    cannot see."""

    name: str
    length: int
    body: "list[str | Nest]"
    pragma: str = ""


def merged(body: "Sequence[str | Nest]") -> "list[str | Nest]":
    """Two loops around one body become one where every element that the body touches lies as if
    they were one: compilers make vectors of the innermost loop only, and it is often short."""
    found: list[str | Nest] = []
    for each in body:
        if isinstance(each, Nest):
            each = replace(each, body=merged(each.body))
            inner = each.body[0]
            if len(each.body) == 1 and isinstance(inner, Nest):
                together = _together(each, inner)
                if together is not None:
                    length = each.length * inner.length
                    each = Nest(inner.name, length, together, inner.pragma)
        found.append(each)
    return found


def _together(outer: Nest, inner: Nest) -> "list[str | Nest] | None":
    """The body of both as one loop over the inner variable, if there is one."""
    for line in _lines(inner.body):
        if VARIABLE.search(ELEMENT.sub("", line)):
            named = VARIABLE.findall(ELEMENT.sub("", line))
            if outer.name in named or inner.name in named:
                return None
        for _, place in ELEMENT.findall(line):
            factors = dict(Place.parsed(place).terms)
            if factors.get(outer.name, 0) != inner.length * factors.get(inner.name, 0):
                return None
    return _without(outer.name, inner.body)


def _lines(body: "Sequence[str | Nest]") -> Iterator[str]:
    for each in body:
        if isinstance(each, str):
            yield each
        else:
            yield from _lines(each.body)


def _without(name: str, body: "Sequence[str | Nest]") -> "list[str | Nest]":
    def dropped(found: re.Match[str]) -> str:
        place = Place.parsed(found[2])
        kept = tuple(term for term in place.terms if term[0] != name)
        return f"@{found[1]}:{Place(place.offset, kept).coded}@"

    return [
        ELEMENT.sub(dropped, each)
        if isinstance(each, str)
        else replace(each, body=_without(name, each.body))
        for each in body
    ]


def flat(body: "Sequence[str | Nest]") -> list[str]:
    """As lines of C, indented."""
    lines: list[str] = []
    for each in body:
        if isinstance(each, str):
            lines.append(each)
            continue
        name = each.name
        if each.pragma and each.length >= VECTOR:
            lines.append(each.pragma)
        lines.append(f"for (int32_t {name} = 0; {name} < {each.length}; {name}++) {{")
        lines += [*(f"    {line}" for line in flat(each.body)), "}"]
    return lines
