"""Branches and loops of a program: `cond`, `switch` and `scan`."""

from collections import Counter
from collections.abc import Sequence

from faultgauge.export.memory import Branch, CLoop, Node, Statement
from faultgauge.export.places import Place
from faultgauge.export.printing import Printer
from faultgauge.export.program import Operation, Value
from faultgauge.export.written import sort

__all__ = ["CONTROL"]


def _cond(printer: Printer, each: Operation) -> None:
    choice = printer.held[id(each.inputs[0])]
    text = printer.cell(choice, Place())
    for out in each.outputs:
        printer.held[id(out)] = printer.array(out)
    ways: list[tuple[str, list[Node]]] = []
    counts: list[Counter[str]] = []
    order = [1, 0] if len(each.blocks) == 2 else list(range(len(each.blocks)))
    before = printer.operations.copy()
    outside = printer.nodes
    for turn, k in enumerate(order):
        printer.nodes, printer.operations = [], Counter()
        block = each.blocks[k]
        printer.block(block)
        for out, value in zip(each.outputs, block.outputs, strict=True):
            printer.store(value, printer.held[id(out)], copy=True)
        last = turn == len(order) - 1
        head = "" if last else f"{text} == {k}" if len(order) > 2 else f"{text} != 0"
        if len(order) > 2 and k == 0:
            head = f"{text} <= 0"
        ways.append((head, printer.nodes))
        counts.append(printer.operations)
    printer.nodes = outside
    printer.nodes.append(Branch(ways, {choice}))
    most = max(counts, key=lambda c: sum(c.values()))
    printer.operations = before + most


def _scan(printer: Printer, each: Operation) -> None:
    body, length = each.blocks[0], each.params["length"]
    carries, ys = each.outputs[: len(body.carries)], each.outputs[len(body.carries) :]
    for start, carry, out in zip(each.inputs, body.carries, carries, strict=True):
        array = printer.held[id(carry)] = printer.held[id(out)] = printer.array(carry)
        printer.store(start, array, copy=True)
    for y in ys:
        array = printer.held[id(y)] = printer.array(y)
        printer.nodes.append(Statement([], {array}))  # it begins here
    turn = printer.name("n")
    printer.depth[turn] = 0
    place = Place.variable(turn)
    if each.params["reverse"]:
        place = place * -1 + (length - 1)
    each.params["turn"].params["place"] = place
    outside, printer.nodes = printer.nodes, []
    printer.turns *= length
    printer.block(body)
    new, slices = body.outputs[: len(carries)], body.outputs[len(carries) :]
    for y, value in zip(ys, slices, strict=True):
        printer.store(value, printer.held[id(y)], head=place * value.size, part=True)
    _turned(printer, body.carries, new)
    printer.turns //= length
    head = f"for (int32_t {turn} = 0; {turn} < {length}; {turn}++) {{"
    inside, printer.nodes = printer.nodes, outside
    printer.nodes.append(CLoop(head, inside))


def _turned(printer: Printer, carries: Sequence[Value], new: Sequence[Value]) -> None:
    """The new carries in the place of the old: all are read before one is overwritten."""
    moved = {id(v) for v in carries}
    copies = {
        id(carry): printer.copied(value)
        for carry, value in zip(carries, new, strict=True)
        if value is not carry and id(value) in moved
    }
    for carry, value in zip(carries, new, strict=True):
        if id(carry) in copies:
            printer.move(copies[id(carry)], printer.held[id(carry)])
        elif value is not carry:
            printer.store(value, printer.held[id(carry)], copy=True)


CONTROL = {"cond": _cond, "scan": _scan, "sort": sort}
