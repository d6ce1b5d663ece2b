"""Statements as C functions of bounded length: compilers take far more than twice the time, and
give up optimising, over a function of twice the length."""

import re
from collections import Counter
from collections.abc import Callable, Sequence

from faultgauge.export.memory import Branch, CLoop, Node, Statement
from faultgauge.export.nests import flat

__all__ = ["Functions"]

LONG = 120  # lines
NAME = re.compile(r"\b[kx]\d+\b")
IDLE = re.compile(r"\s*(\S.*) = \1;$")
MADE = re.compile(r"\s*const \w+ ([kx]\d+) = ")


class Functions:
    """The text of the function `of` a step `name`, and of those that it calls: `parts`. `placed`
    puts arrays to where they lie, in a line."""

    def __init__(self, name: str, of: str, placed: Callable[[str], str]) -> None:
        self.name, self.of, self.placed = name, of, placed
        self.parts: list[str] = []

    def body(self, nodes: Sequence[Node]) -> str:
        return "".join(f"    {line}\n" for line in self._split(nodes))

    def _split(self, nodes: Sequence[Node]) -> list[str]:
        """Lines of which no more than a few are not in functions of their own."""
        lines: list[str] = []
        waiting: list[str] = []
        for each in nodes:
            own = self._lines([each])
            if isinstance(each, Branch) and len(own) > LONG:
                lines += [*self._called(waiting), *self._branch(each, self._split)]
                waiting = []
                continue
            waiting += own
            if len(waiting) > LONG:
                lines += self._called(waiting)
                waiting = []
        return [*lines, *waiting] if len(waiting) < LONG // 4 else [*lines, *self._called(waiting)]

    def _called(self, lines: Sequence[str]) -> list[str]:
        """The lines as a function, and the call of it."""
        if len(lines) < LONG // 4:
            return list(lines)
        text = "".join(f"    {line}\n" for line in lines)
        given = {
            "in": f"const {self.name}_input *in",
            "out": f"{self.name}_output *out",
            "state": f"{self.name}_state *state",
        }
        needed = [each for each in given if f"{each}->" in text]
        work = ""
        if "work->" in text:
            work = f"    struct {self.name}_work *const work = &state->work;\n"
            needed = [*(each for each in needed if each != "state"), "state"]
        name = f"{self.name}_{self.of}_{len(self.parts)}"
        arguments = ", ".join(given[each] for each in needed) or "void"
        self.parts.append(f"static void {name}({arguments})\n{{\n{work}{text}}}\n")
        return [f"{name}({', '.join(needed)});"]

    def _lines(self, nodes: Sequence[Node]) -> list[str]:
        lines: list[str] = []
        for each in nodes:
            if isinstance(each, Statement):
                own = [] if each.idle else flat(each.lines)
                lines += _changing([self.placed(line) for line in _read_ones(own)])
            elif isinstance(each, CLoop):
                lines += [each.head, *(f"    {line}" for line in self._lines(each.body)), "}"]
            else:
                lines += self._branch(each, self._lines)
        return lines

    def _branch(self, branch: Branch, inner: Callable[[Sequence[Node]], list[str]]) -> list[str]:
        lines: list[str] = []
        for turn, (condition, way) in enumerate(branch.ways):
            head = f"if ({self.placed(condition)}) {{" if condition else "{"
            lines.append(f"{'} else ' if turn else ''}{head}")
            lines += [f"    {line}" for line in inner(way)]
        return [*lines, "}"]


def _read_ones(lines: list[str]) -> list[str]:
    """The lines without constants that nobody reads."""
    while True:
        count = Counter(name for line in lines for name in NAME.findall(line))
        kept = [line for line in lines if not (made := MADE.match(line)) or count[made[1]] > 1]
        if len(kept) == len(lines):
            return lines
        lines = kept


def _changing(lines: list[str]) -> list[str]:
    """The lines without copies of an element onto itself, and without loops that are empty then."""
    kept: list[str] = []
    for line in lines:
        if line.strip() == "}" and kept and kept[-1].strip().startswith("for ("):
            kept.pop()
        elif not IDLE.match(line):
            kept.append(line)
    return kept
