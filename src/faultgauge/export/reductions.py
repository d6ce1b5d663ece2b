"""Operations of which an element reads many: sums, products of matrices, extremes."""

from math import prod

import numpy as np

from faultgauge.export.elementwise import FLOATS, LETTERS, literal, truth
from faultgauge.export.places import Place
from faultgauge.export.printing import Index, Printer, bare, refused
from faultgauge.export.program import Operation

__all__ = ["REDUCTIONS"]

REDUCED = {  # the start, and what an element does to it
    "reduce_sum": (0.0, "{0} += {1};"),
    "reduce_prod": (1.0, "{0} *= {1};"),
    "reduce_max": (-np.inf, "{0} = fg_max_{2}({0}, {1});"),
    "reduce_min": (np.inf, "{0} = fg_min_{2}({0}, {1});"),
    "reduce_and": (True, "{0} &= {1};"),
    "reduce_or": (False, "{0} |= {1};"),
}
TOGETHER = {"reduce_sum": "+", "reduce_max": "fg_most", "reduce_min": "fg_least"}  # in OpenMP


def _reduced(printer: Printer, each: Operation, index: Index) -> str:
    value, kind = each.inputs[0], printer.kind(each.outputs[0])
    axes = [int(a) for a in each.params["axes"]]
    start, update = REDUCED[each.name]
    name = printer.name("s")
    if kind not in (*FLOATS, "bool") and np.isinf(start):
        bits = 63 if kind == "int64_t" else 31
        start = 2**bits - 1 if start > 0 else -(2**bits) + 1
    declared = truth(printer.single) if kind == "bool" else kind
    printer.line(f"{declared} {name} = {literal(start, kind, printer.single)};")

    def one(inner: Index) -> None:
        outer, more = iter(index), dict(zip(axes, inner, strict=True))
        at = tuple(more[k] if k in more else next(outer) for k in range(len(value.shape)))
        text = update.format(name, printer.at(value, at), LETTERS[kind])
        printer.done("add")
        printer.need(text[text.find("=") + 2 :])
        printer.line(text)

    pragma = ""
    if printer.inline and kind == "real" and each.name in TOGETHER:
        pragma = f"#pragma omp simd reduction({TOGETHER[each.name]}:{name})"
        printer.helpers.add(f"{each.name}_together")
    printer.loops(each, [value.shape[a] for a in axes], one, pragma)
    return name


def _dot(printer: Printer, each: Operation, index: Index) -> str:
    (lhs_sum, rhs_sum), (lhs_batch, rhs_batch) = each.params["dimension_numbers"]
    lhs, rhs = each.inputs
    kind = printer.kind(each.outputs[0])
    if kind == "bool":
        raise refused(each)
    lhs_free = [k for k in range(len(lhs.shape)) if k not in (*lhs_sum, *lhs_batch)]
    rhs_free = [k for k in range(len(rhs.shape)) if k not in (*rhs_sum, *rhs_batch)]
    batch = index[: len(lhs_batch)]
    left = index[len(batch) : len(batch) + len(lhs_free)]
    right = index[len(batch) + len(lhs_free) :]
    lengths = [lhs.shape[k] for k in lhs_sum]
    none = literal(0, kind, printer.single)

    def product(inner: Index) -> str:
        a, b = {}, {}
        for where, groups in (
            (a, ((lhs_batch, batch), (lhs_free, left), (lhs_sum, inner))),
            (b, ((rhs_batch, batch), (rhs_free, right), (rhs_sum, inner))),
        ):
            for axes, places in groups:
                where |= dict(zip(map(int, axes), places, strict=True))
        one = printer.at(lhs, tuple(a[k] for k in range(len(lhs.shape))))
        other = printer.at(rhs, tuple(b[k] for k in range(len(rhs.shape))))
        if none in (one, other):  # a block of a matrix that is 0
            return none
        return printer.function("mul", [one, other], kind)

    if prod(lengths) == 1:
        return product((Place(),) * len(lengths))
    name = printer.name("s")
    printer.line(f"{printer.declared(kind)} {name} = {none};")

    def one(inner: Index) -> None:
        text = product(inner)
        if text != none:
            printer.done("add")
            printer.line(f"{name} += {bare(text)};")

    printer.loops(each, lengths, one)
    return name


def _extreme(printer: Printer, each: Operation, index: Index) -> str:
    """The first of the largest (smallest) elements, or of those that are no number."""
    value = each.inputs[0]
    (axis,) = (int(a) for a in each.params["axes"])
    sign, kind = (">" if each.name == "argmax" else "<"), printer.kind(value)
    into = printer.kind(each.outputs[0])
    place, best, real = printer.name("s"), printer.name("s"), printer.declared(kind)
    first = printer.at(value, (*index[:axis], Place(), *index[axis:]))
    printer.line(f"{into} {place} = 0;")
    lines = printer.scopes[-1].body
    here = len(lines)
    printer.line(f"{real} {best} = {first};")

    def one(inner: Index) -> None:
        step = inner[0] + 1
        now = printer.at(value, (*index[:axis], step, *index[axis:]))
        if now == ("-INFINITY" if sign == ">" else "INFINITY"):
            return  # never further out than what is there
        now = printer.named(now, kind)
        test = f"{now} {sign} {best}"
        if kind in FLOATS:
            helper = f"fg_{'above' if sign == '>' else 'below'}_{LETTERS[kind]}"
            test = f"{helper}({now}, {best})"
            printer.helpers.add(helper)
        printer.done("max")
        printer.line(f"if ({test}) {{")
        printer.line(f"    {best} = {now};")
        printer.line(f"    {place} = {step.text};")
        printer.line("}")

    printer.loops(each, [value.shape[axis] - 1], one)
    if all(isinstance(line, str) and best not in line for line in lines[here + 1 :]):
        del lines[here]  # nothing was compared
    return place


REDUCTIONS = {
    "dot_general": _dot,
    "argmax": _extreme,
    "argmin": _extreme,
    **dict.fromkeys(REDUCED, _reduced),
}
