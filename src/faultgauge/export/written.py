"""Operations whose result is written part by part."""

from faultgauge.export.elementwise import FLOATS, LETTERS
from faultgauge.export.memory import Array
from faultgauge.export.places import Place, linear
from faultgauge.export.printing import Index, Printer, bare, refused
from faultgauge.export.program import Operation
from faultgauge.export.windows import Axes, place_of, window

__all__ = ["WRITTEN", "sort"]

UPDATES = {
    "scatter": "{0} = {1};",
    "scatter-add": "{0} += {1};",
    "scatter-mul": "{0} *= {1};",
    "scatter-min": "{0} = fg_min_{2}({0}, {1});",
    "scatter-max": "{0} = fg_max_{2}({0}, {1});",
}
RUNNING = {
    "cumsum": "{0} + {1}",
    "cumprod": "{0} * {1}",
    "cummax": "fg_max_{2}({0}, {1})",
    "cummin": "fg_min_{2}({0}, {1})",
}


def _joined(printer: Printer, each: Operation, into: Array) -> None:
    out, first = each.outputs[0], True
    stacked = each.name == "stack"
    axis = int(each.params["axis" if stacked else "dimension"]) % len(out.shape)
    at = 0
    for value in each.inputs:
        if value.size == 0:
            continue

        def one(index: Index, value=value, at=at) -> None:
            if stacked:
                to = (*index[:axis], Place(at), *index[axis:])
            else:
                to = (*index[:axis], index[axis] + at, *index[axis + 1 :])
            text = printer.at(value, index)
            printer.line(f"{printer.cell(into, printer.placed(into, to, out.shape))} = {text};")

        def write(value=value, one=one) -> None:
            order = [k for k in printer.order(into, out.shape) if not stacked or k != axis]
            order = [k - (stacked and k > axis) for k in order]
            printer.loops(value, value.shape, one, order=order)

        printer.statement(write, {into}, part=not first)
        first, at = False, at + (1 if stacked else value.shape[axis])


def _padded(printer: Printer, each: Operation, into: Array) -> None:
    value, fill = each.inputs
    out, config = each.outputs[0], each.params["padding_config"]
    if any(low < 0 or high < 0 for low, high, _ in config):
        raise refused(each)

    def empty(index: Index) -> None:
        cell = printer.cell(into, linear(index, out.shape))
        printer.line(f"{cell} = {printer.at(fill, ())};")

    def one(index: Index) -> None:
        to = [
            p * int(inner + 1) + int(low) for p, (low, _, inner) in zip(index, config, strict=True)
        ]
        text = printer.at(value, index)
        printer.line(f"{printer.cell(into, linear(to, out.shape))} = {text};")

    printer.statement(lambda: printer.loops(out, out.shape, empty), {into})
    printer.statement(lambda: printer.loops(value, value.shape, one), {into}, part=True)


def _updated(printer: Printer, each: Operation, into: Array) -> None:
    value, new, *starts = each.inputs
    printer.store(value, into, copy=True)

    def write() -> None:
        at = [
            place_of(printer, s, (), n - m)
            for s, n, m in zip(starts, value.shape, new.shape, strict=True)
        ]

        def one(index: Index) -> None:
            printer.to = linear([a + p for a, p in zip(at, index, strict=True)], value.shape)
            text = printer.at(new, index)
            printer.line(f"{printer.cell(into, printer.to)} = {text};")

        printer.loops(new, new.shape, one)

    printer.statement(write, {into}, part=True)


def _scattered(printer: Printer, each: Operation, into: Array) -> None:
    value, starts, new = each.inputs
    numbers, kind = each.params["dimension_numbers"], printer.kind(value)
    printer.store(value, into, copy=True)
    dropped = numbers.inserted_window_dims
    batched = numbers.operand_batching_dims
    sizes = [1] * len(value.shape)
    windows = [d for d in range(len(value.shape)) if d not in (*dropped, *batched)]
    for d, k in zip(windows, numbers.update_window_dims, strict=True):
        sizes[d] = new.shape[k]
    checked = "CLIP" not in str(each.params["mode"])
    axes = Axes.of(
        numbers.scatter_dims_to_operand_dims,
        dropped,
        batched,
        numbers.scatter_indices_batching_dims,
    )

    def one(index: Index) -> None:
        batch = [p for d, p in enumerate(index) if d not in numbers.update_window_dims]
        inner = [index[d] for d in numbers.update_window_dims]
        at, inside = window(printer, value, starts, batch, inner, sizes, checked, axes)
        text = printer.at(new, index)
        cell = printer.cell(into, linear(at, value.shape))
        line = UPDATES[each.name].format(cell, bare(text), LETTERS[kind])
        printer.need(line[line.find("=") + 2 :])
        printer.done("add")
        if inside:
            printer.line(f"if ({' && '.join(inside)}) {{")
            printer.line(f"    {line}")
            printer.line("}")
        else:
            printer.line(line)

    printer.statement(lambda: printer.loops(new, new.shape, one), {into}, part=True)


def _running(printer: Printer, each: Operation, into: Array) -> None:
    value, kind = each.inputs[0], printer.kind(each.inputs[0])
    axis, back = int(each.params["axis"]), each.params["reverse"]
    length = value.shape[axis]
    rest = [1 if k == axis else n for k, n in enumerate(value.shape)]

    def outer(index: Index) -> None:
        name = printer.name("s")

        def place(p: Place) -> Index:
            along = p * -1 + (length - 1) if back else p
            return tuple(along if k == axis else q for k, q in enumerate(index))

        def cell(at: Index) -> str:
            return printer.cell(into, linear(at, value.shape))

        def one(inner: Index) -> None:
            at = place(inner[0] + 1)
            text = RUNNING[each.name].format(name, printer.at(value, at), LETTERS[kind])
            printer.need(text)
            printer.done("add")
            printer.line(f"{name} = {text};")
            printer.line(f"{cell(at)} = {name};")

        first = place(Place())
        printer.line(f"{printer.declared(kind)} {name} = {printer.at(value, first)};")
        printer.line(f"{cell(first)} = {name};")
        if length > 1:
            printer.loops(each, [length - 1], one)

    printer.statement(lambda: printer.loops(value, rest, outer), {into})


def sort(printer: Printer, each: Operation) -> None:
    """By insertion, row by row: what is equal stays in order, what is no number comes last."""
    if each.params["num_keys"] != 1:
        raise refused(each)
    arrays = []
    for value, out in zip(each.inputs, each.outputs, strict=True):
        array = printer.array(out)
        printer.store(value, array, copy=True)
        printer.held[id(out)] = array
        arrays.append(array)
    shape, axis = each.outputs[0].shape, int(each.params["dimension"])
    kinds = [printer.kind(v) for v in each.inputs]
    rest = [1 if k == axis else n for k, n in enumerate(shape)]
    if shape[axis] < 2:
        return

    def outer(index: Index) -> None:
        def cell(array: Array, p: Place) -> str:
            at = tuple(p if k == axis else q for k, q in enumerate(index))
            return printer.cell(array, linear(at, shape))

        def one(inner: Index) -> None:
            (step,) = inner
            own = [
                printer.named(cell(array, step + 1), kind)
                for array, kind in zip(arrays, kinds, strict=True)
            ]
            j = printer.name("j")
            printer.line(f"int32_t {j} = {step.text};")
            now, key = cell(arrays[0], Place.variable(j)), own[0]
            last = f" || ({now} != {now} && {key} == {key})" if kinds[0] in FLOATS else ""
            printer.done("max", shape[axis])
            printer.line(f"while ({j} >= 0 && ({now} > {key}{last})) {{")
            for array in arrays:
                here, up = (cell(array, Place.variable(j) + k) for k in (0, 1))
                printer.line(f"    {up} = {here};")
            printer.line(f"    {j}--;")
            printer.line("}")
            for name, array in zip(own, arrays, strict=True):
                printer.line(f"{cell(array, Place.variable(j) + 1)} = {name};")

        printer.loops(each, [shape[axis] - 1], one)

    printer.statement(lambda: printer.loops(arrays, rest, outer), set(arrays), part=True)


WRITTEN = {
    "concatenate": _joined,
    "stack": _joined,
    "pad": _padded,
    "dynamic_update_slice": _updated,
    **dict.fromkeys(UPDATES, _scattered),
    **dict.fromkeys(RUNNING, _running),
}
