"""Print every number that was set by hand, by layer: its value, what it means, where it stands."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1] / "src" / "faultgauge"


class Constant(NamedTuple):
    """`meaning` is the comment on its lines, or else the one above them; empty where is none."""

    layer: str
    name: str
    value: str
    meaning: str
    where: str


def _is_number(node: ast.expr) -> bool:
    match node:
        case ast.Constant(value=int() | float() as value):
            return not isinstance(value, bool)
        case ast.UnaryOp():
            return _is_number(node.operand)
        case ast.BinOp():
            return _is_number(node.left) and _is_number(node.right)
        case ast.Tuple():
            return bool(node.elts) and all(map(_is_number, node.elts))
    return False


def _meaning(lines: list[str], first: int, last: int) -> str:
    beside = [line.partition("#")[2].strip() for line in lines[first:last] if "#" in line]
    above: list[str] = []
    while not beside and first > 0 and lines[first - 1].startswith("#"):
        first -= 1
        above.insert(0, lines[first].strip("# "))
    return " ".join(beside or above)


def hand_set() -> Iterator[Constant]:
    """The numbers that modules name, layer by layer."""
    for path in sorted(ROOT.rglob("*.py")):
        where, text = path.relative_to(ROOT), path.read_text()
        for node in ast.parse(text).body:
            if isinstance(node, ast.Assign) and _is_number(node.value):
                meaning = _meaning(text.splitlines(), node.lineno - 1, node.end_lineno or 0)
                names = ast.unparse(node.targets[0]).strip("()")
                value = ast.unparse(node.value)
                yield Constant(where.parts[0], names, value, meaning, f"{where}:{node.lineno}")


if __name__ == "__main__":
    layer = ""
    for each in hand_set():
        if each.layer != layer:
            layer = each.layer
            print(f"\n{layer}")
        print(f"  {each.name} = {each.value}  ({each.where})\n      {each.meaning}")
