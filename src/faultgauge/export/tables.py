"""Constant arrays: a number where all are alike, an expression where they count, else a table."""

from collections.abc import Sequence

import numpy as np

from faultgauge.export.elementwise import Kind, literal, truth

__all__ = ["Tables"]

WIDTH = 92  # characters of a line of C


class Tables:
    """Every distinct table once; `name` begins the names of all."""

    def __init__(self, name: str, single: bool) -> None:
        self.name, self.single = name, single
        self.known: dict[tuple[str, bytes], str] = {}
        self.declared: list[tuple[str, Kind, list[str]]] = []

    def of(self, array: np.ndarray, kind: Kind) -> str:
        """The name of the table of these numbers."""
        flat = np.ascontiguousarray(array).ravel()
        key = (kind, flat.tobytes())
        if key not in self.known:
            name = f"{self.name}_c{len(self.known)}"
            self.known[key] = name
            numbers = [literal(each, kind, self.single) for each in flat.tolist()]
            self.declared.append((name, kind, numbers))
        return self.known[key]

    def types(self, kind: Kind) -> str:
        return truth(self.single) if kind == "bool" else kind

    @property
    def externals(self) -> list[str]:
        return [
            f"extern const {self.types(kind)} {name}[{len(numbers)}];"
            for name, kind, numbers in self.declared
        ]

    @property
    def definitions(self) -> list[str]:
        lines = []
        for name, kind, numbers in self.declared:
            lines += [f"const {self.types(kind)} {name}[{len(numbers)}] = {{"]
            lines += [*_wrapped(numbers), "};"]
        return lines


def _wrapped(words: Sequence[str]) -> list[str]:
    lines, line = [], "   "
    for word in words:
        if len(line) + len(word) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {word},"
    return [*lines, line]
