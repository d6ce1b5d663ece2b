"""Operations on elements that are no single operator or function of C."""

import re

from faultgauge.export.elementwise import FLOATS, LETTERS, literal
from faultgauge.export.printing import Index, Printer, bare, simple
from faultgauge.export.program import Operation

__all__ = ["FORMULAS"]

# tests of what is no number, as they are printed
NONE = re.compile(r"\((.+) != \1\)")
IS_FINITE = re.compile(r"\(isfinite\((.+)\) != 0\)")
INFINITE = re.compile(r"\((.+) == (-?)INFINITY\)")
LARGEST = re.compile(r"-?(1\.7976931348623157e\+308|3\.4028235e\+38f)")


def _select(printer: Printer, each: Operation, index: Index) -> str:
    which, *cases = each.inputs
    choice = printer.at(which, index if which.shape else ())
    texts = [printer.at(v, index if v.shape else ()) for v in cases]
    # elements are read whichever is chosen: a vector has both
    texts = [
        printer.named(text, printer.kind(v)) if text.startswith("@") else text
        for text, v in zip(texts, cases, strict=True)
    ]
    printer.done("select")
    if len(cases) == 2:
        test = choice if printer.kind(which) == "bool" else f"{choice} != 0"
        other, chosen = (_under(text, test, k) for k, text in enumerate(texts))
        kinds = {printer.kind(v) for v in (*cases, each.outputs[0])}
        guard = _guard(test, chosen, other) if len(kinds) == 1 and kinds <= {*FLOATS} else None
        if guard is None:
            return f"({test} ? {chosen} : {other})"
        name, arguments = guard
        printer.helpers.add(f"{name}_{LETTERS[kinds.pop()]}")
        return f"{name}_{LETTERS[printer.kind(each.outputs[0])]}({', '.join(arguments)})"
    found = texts[-1]
    for k in range(len(texts) - 2, -1, -1):
        found = f"({choice} <= {k} ? {texts[k]} : {found})"
    return found


def _under(text: str, test: str, side: int) -> str:
    """`text`, which is read only where `test` is true (`side` 1) or false (0), without choices by
    the same test: their other way could not be taken."""
    start = text.find(f"({test} ? ")
    if start < 0 or not simple(test):
        return text
    depth, parts, last = 0, [], start + len(f"({test} ? ")
    for k in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[k], 0)
        if depth == 1 and text.startswith(" : ", k):
            parts.append(text[last:k])
            last = k + 3
        if depth == 0:
            kept = [text[last:k], *parts][side]
            return _under(f"{text[:start]}{kept}{text[k + 1 :]}", test, side)
    return text


def _guard(test: str, chosen: str, other: str) -> tuple[str, list[str]] | None:
    """(the helper, its arguments) of a choice that only replaces what is no number, or infinite:
    what is done about that is decided there, once."""
    found = [each.fullmatch(test) for each in (NONE, IS_FINITE, INFINITE)]
    tested = next((each[1] for each in found if each), None)
    if tested is None or bare(f"({tested})") != tested or "/" in chosen + other:
        return None  # none, or more than one test; of a quotient both ways would be computed
    if found[0]:
        return "fg_number", [tested, other, chosen]
    if found[1] and tested == chosen:
        return "fg_finite", [chosen, other]
    if found[2] and tested == other and LARGEST.fullmatch(chosen):
        return ("fg_atleast" if found[2][2] else "fg_atmost"), [other, chosen]
    return None


def _clamp(printer: Printer, each: Operation, index: Index) -> str:
    low, value, high = (printer.at(v, index if v.shape else ()) for v in each.inputs)
    kind = printer.kind(each.outputs[0])
    inner = printer.function("max", [value, low], kind)
    return printer.function("min", [inner, high], kind)


def _converted(printer: Printer, each: Operation, index: Index) -> str:
    before, after = printer.kind(each.inputs[0]), printer.kind(each.outputs[0])
    text = printer.at(each.inputs[0], index)
    if after == "bool":
        return text if before == "bool" else f"({text} != 0)"
    if before == after or {before, after} == {*FLOATS}:
        return text
    if before == "bool":
        one, none = (literal(k, after, printer.single) for k in (1, 0))
        return f"({text} ? {one} : {none})"
    if before in FLOATS:
        name = f"fg_int_{LETTERS[after]}"
        printer.helpers.add(name)
        return f"{name}((real){text})" if before == "wide" else f"{name}({text})"
    return f"(({after}){text})"


def _powered(printer: Printer, each: Operation, index: Index) -> str:
    y, kind = each.params["y"], printer.kind(each.inputs[0])
    text = printer.at(each.inputs[0], index)
    if not simple(text):
        text = printer.named(text, kind)
    printer.done("mul", max(abs(y) - 1, 1))
    # by squares, as XLA does it
    power, found = text, ""
    n = abs(y)
    while n:
        if n & 1:
            found = f"{found} * {power}" if found else power
        n >>= 1
        if n:
            power = printer.named(f"{power} * {power}", kind)
    found = f"({found})" if y != 0 else literal(1, kind, printer.single)
    if y >= 0:
        return found
    printer.done("div")
    return f"({literal(1, kind, printer.single)} / {found})"


def _rounded(printer: Printer, each: Operation, index: Index) -> str:
    even = "EVEN" in str(each.params["rounding_method"])
    name = "rint" if even else "round"
    printer.done("round")
    return f"{name}{printer.suffix}({printer.at(each.inputs[0], index)})"


def _inverse(printer: Printer, each: Operation, index: Index) -> str:
    printer.done("erf_inv", 4)
    printer.helpers.add("fg_erf_inv")
    return f"fg_erf_inv({printer.at(each.inputs[0], index)})"


FORMULAS = {
    "select_n": _select,
    "clamp": _clamp,
    "convert_element_type": _converted,
    "integer_pow": _powered,
    "round": _rounded,
    "erf_inv": _inverse,
}
