"""The expression language of plant files and of `--map`.

Numbers, declared names, ``+ - * / **``, parentheses, ``d(state)``, declared networks and the
functions in `FUNCTIONS`. Text is parsed by Python's `ast`, checked node by node against a
whitelist and turned into a small tree of our own; it is never evaluated as Python, so a
stranger's file cannot run code.
"""

import ast
import difflib
import math
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from faultgauge.errors import InputError

__all__ = [
    "FUNCTIONS",
    "MAX_CHARACTERS",
    "MAX_DEPTH",
    "Binary",
    "Call",
    "Expression",
    "Name",
    "Negative",
    "Node",
    "Number",
    "Opaque",
    "Scope",
    "derivatives_used",
    "evaluate",
    "is_state",
    "names_used",
    "networks_used",
    "parse",
    "unknown",
    "walk",
]

MAX_CHARACTERS = 2000  # of one expression
MAX_NODES = 400  # numbers, names and operations in one
MAX_WHOLE = 4000  # of one in which every term is written out
MAX_DEPTH = 40  # of its parentheses, well below Python's own limit

# name -> (fewest arguments, most arguments)
FUNCTIONS: dict[str, tuple[int, int]] = {
    "abs": (1, 1),
    "sign": (1, 1),
    "sqrt": (1, 1),
    "exp": (1, 1),
    "log": (1, 1),
    "sin": (1, 1),
    "cos": (1, 1),
    "tanh": (1, 1),
    "min": (2, 8),
    "max": (2, 8),
    "clip": (3, 3),  # clip(x, low, high): saturation
    "overflow": (2, 2),  # overflow(x, rim) = max(x - rim, 0)
    "deadzone": (2, 2),  # deadzone(x, width) = x - clip(x, -width, width)
}

OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}


@dataclass(frozen=True)
class Number:
    """A number as written."""

    value: float


@dataclass(frozen=True)
class Name:
    """A state, an input or a parameter, by its value."""

    name: str


@dataclass(frozen=True)
class Negative:
    """Minus its operand."""

    operand: "Node"


@dataclass(frozen=True)
class Binary:
    """`left` and `right` under one of `OPERATORS`."""

    operator: str
    left: "Node"
    right: "Node"


@dataclass(frozen=True)
class Call:
    """A function of `FUNCTIONS`, a declared network, or ``d`` of one state."""

    function: str
    arguments: tuple["Node", ...]


@dataclass(frozen=True)
class Opaque:
    """Arithmetic that is written in Python: all that is known of it is what it reads."""

    arguments: tuple["Node", ...]


Node = Number | Name | Negative | Binary | Call | Opaque


@dataclass(frozen=True)
class Expression:
    """A parsed expression: the text as the user wrote it and its tree (hashable)."""

    text: str
    tree: Node


@dataclass(frozen=True)
class Scope:
    """What an expression may refer to."""

    names: Collection[str]
    states: Collection[str] = ()
    networks: Collection[str] = ()
    terms: Mapping[str, "Node"] = field(default_factory=dict)  # names that stand for formulas


def parse(text: str, where: str, scope: Scope) -> Expression:
    """Parse `text`; `where` ("plant.toml, [states.h] derivative") leads every message.

    Raises `InputError` that names the column (from 1) and what is legal there.
    """
    return Expression(text, _Parser(text, where, scope).parse())


class _Parser:
    def __init__(self, text: str, where: str, scope: Scope) -> None:
        self.text, self.where, self.scope = text, where, scope
        self.nodes = self.whole = 0

    def parse(self) -> Node:
        if not self.text.strip():
            raise self.error(0, "the expression is empty; write a number or a formula")
        if len(self.text) > MAX_CHARACTERS:
            raise self.error(
                MAX_CHARACTERS, f"the expression is longer than {MAX_CHARACTERS} characters"
            )
        # CPython's own parser has limits that surface as MemoryError: count brackets first.
        depth = 0
        for column, character in enumerate(self.text):
            depth += (character in "([{") - (character in ")]}")
            if depth > MAX_DEPTH:
                raise self.error(column, f"more than {MAX_DEPTH} nested parentheses")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # Python's advice on text that is refused below
                tree = ast.parse("\n".join(self.lines), mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError) as failure:
            line, column = 1, 1
            if isinstance(failure, SyntaxError):
                line, column = failure.lineno or 1, failure.offset or 1
            raise self.error(
                self.position(line, column - 1),
                "this is not a formula; check operators and parentheses",
            ) from None
        return self.convert(tree, 0)

    @property
    def lines(self) -> list[str]:
        return self.text.strip().replace("\r", " ").split("\n")

    def position(self, line: int, column: int) -> int:
        """Index into the text of a column (from 0) of a line (from 1) of the stripped text."""
        indent = len(self.text) - len(self.text.lstrip())
        return indent + sum(len(above) + 1 for above in self.lines[: line - 1]) + column

    def error(self, column: int, message: str) -> InputError:
        return InputError(f"{self.where}: column {column + 1} of {self.text[:80]!r}: {message}.")

    def refuse(self, node: ast.expr, message: str) -> InputError:
        line = self.lines[node.lineno - 1].encode()  # ast counts bytes, the user characters
        column = len(line[: node.col_offset].decode())
        return self.error(self.position(node.lineno, column), message)

    def convert(self, node: ast.expr, depth: int) -> Node:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise self.refuse(
                node, f"the expression has more than {MAX_NODES} numbers, names and operations"
            )
        if depth > MAX_DEPTH:
            raise self.refuse(node, f"the expression is nested deeper than {MAX_DEPTH}")
        match node:
            case ast.Constant():
                return self.number(node)
            case ast.Name():
                return self.name(node, depth)
            case ast.UnaryOp(op=ast.USub()):
                operand = self.convert(node.operand, depth + 1)
                return Number(-operand.value) if isinstance(operand, Number) else Negative(operand)
            case ast.UnaryOp(op=ast.UAdd()):
                return self.convert(node.operand, depth + 1)
            case ast.BinOp() if type(node.op) in OPERATORS:
                left, right = (self.convert(side, depth + 1) for side in (node.left, node.right))
                return self.fold(node, Binary(OPERATORS[type(node.op)], left, right))
            case ast.Call(func=ast.Name(), keywords=[]):
                return self.call(node, depth)
            case _:
                raise self.refuse(
                    node,
                    "only numbers, names, + - * / **, parentheses and the functions "
                    f"{', '.join(FUNCTIONS)} are allowed",
                )

    def number(self, node: ast.Constant) -> Number:
        if type(node.value) not in (int, float):
            raise self.refuse(node, f"{node.value!r} is not a number")
        try:
            value = float(node.value)  # type: ignore[arg-type]
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self.refuse(node, "the number is too large")
        return Number(value)

    def fold(self, node: ast.expr, pair: Binary) -> Node:
        """Fold constants, so that 1/0 or 9**999 is found here and not as a NaN later."""
        if not (isinstance(pair.left, Number) and isinstance(pair.right, Number)):
            return pair
        try:
            value = _binary(pair.operator, pair.left.value, pair.right.value)
        except (ZeroDivisionError, OverflowError):
            value = math.inf
        if not isinstance(value, float) or not math.isfinite(value):
            raise self.refuse(node, "this constant is not a finite real number")
        return Number(value)

    def name(self, node: ast.Name, depth: int) -> Node:
        if node.id in self.scope.names:
            return Name(node.id)
        if node.id in self.scope.terms:
            return self.term(node, self.scope.terms[node.id], depth)
        if node.id in self.scope.networks or node.id in FUNCTIONS or node.id == "d":
            raise self.refuse(node, f"{node.id!r} must be called with arguments in parentheses")
        legal = [*self.scope.names, *self.scope.terms]
        raise self.refuse(node, unknown("name", node.id, legal))

    def term(self, node: ast.Name, tree: Node, depth: int) -> Node:
        """What the name stands for, as if it were written here in parentheses."""
        self.whole += sum(1 for _ in walk(tree))
        if self.whole > MAX_WHOLE:
            raise self.refuse(
                node,
                f"with every term written out the expression has more than {MAX_WHOLE} numbers, "
                "names and operations",
            )
        if depth + _depth(tree) > MAX_DEPTH:
            raise self.refuse(
                node,
                f"with every term written out the expression is nested deeper than {MAX_DEPTH}",
            )
        return tree

    def call(self, node: ast.Call, depth: int) -> Call:
        assert isinstance(node.func, ast.Name)  # the match above saw to it
        function = node.func.id
        if function == "d" and self.scope.states:
            return self.derivative(node)
        arguments = tuple(self.convert(argument, depth + 1) for argument in node.args)
        if function in self.scope.networks:
            if not arguments:
                raise self.refuse(node, f"network {function!r} needs at least one argument")
        elif function in FUNCTIONS:
            fewest, most = FUNCTIONS[function]
            if not fewest <= len(arguments) <= most:
                wanted = str(fewest) if fewest == most else f"{fewest} to {most}"
                raise self.refuse(
                    node, f"{function}() takes {wanted} argument(s), not {len(arguments)}"
                )
        else:
            legal = [*FUNCTIONS, *self.scope.networks, *(["d"] if self.scope.states else [])]
            raise self.refuse(node, unknown("function or network", function, legal))
        return Call(function, arguments)

    def derivative(self, node: ast.Call) -> Call:
        states = self.scope.states
        if len(node.args) != 1 or not isinstance(node.args[0], ast.Name):
            raise self.refuse(node, "d() takes the name of one state, as in d(h)")
        state = node.args[0].id
        if state not in states:
            raise self.refuse(node.args[0], unknown("state in d()", state, states))
        return Call("d", (Name(state),))


def unknown(kind: str, name: str, legal: Collection[str]) -> str:
    """ "unknown name 'vv' (did you mean 'v'?); legal: u, v" """
    close = difflib.get_close_matches(name, list(legal), n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return f"unknown {kind} {name!r}{hint}; legal here: {', '.join(legal) or 'none'}"


def walk(node: Node) -> Iterator[Node]:
    """`node` and everything below it."""
    yield node
    match node:
        case Negative():
            yield from walk(node.operand)
        case Binary():
            yield from walk(node.left)
            yield from walk(node.right)
        case Call() | Opaque():
            for argument in node.arguments:
                yield from walk(argument)


def _depth(node: Node) -> int:
    match node:
        case Negative():
            below = [node.operand]
        case Binary():
            below = [node.left, node.right]
        case Call() | Opaque():
            below = [*node.arguments]
        case _:
            below = []
    return 1 + max(map(_depth, below), default=-1)


def derivatives_used(expression: Expression) -> frozenset[str]:
    """States whose derivative d(state) the expression reads."""
    return frozenset(
        node.arguments[0].name
        for node in walk(expression.tree)
        if isinstance(node, Call) and node.function == "d" and isinstance(node.arguments[0], Name)
    )


def names_used(expression: Expression) -> frozenset[str]:
    """Names that the expression reads by value (a state inside d() is not one)."""

    def names(node: Node) -> Iterator[str]:
        match node:
            case Name():
                yield node.name
            case Negative():
                yield from names(node.operand)
            case Binary():
                yield from names(node.left)
                yield from names(node.right)
            case Call(function="d"):
                return
            case Call() | Opaque():
                for argument in node.arguments:
                    yield from names(argument)

    return frozenset(names(expression.tree))


def is_state(node: Node, states: Collection[str]) -> bool:
    """Whether an expression is one state and nothing else."""
    return isinstance(node, Name) and node.name in states


def networks_used(expression: Expression) -> dict[str, list[tuple[Node, ...]]]:
    """Networks called, with the arguments of each call."""
    calls: dict[str, list[tuple[Node, ...]]] = {}
    for node in walk(expression.tree):
        if isinstance(node, Call) and node.function not in FUNCTIONS and node.function != "d":
            calls.setdefault(node.function, []).append(node.arguments)
    return calls


def evaluate(
    node: Node,
    values: Mapping[str, Any],
    xp: Any,
    *,
    derivatives: Mapping[str, Any] | None = None,
    networks: Mapping[str, Callable[..., Any]] | None = None,
) -> Any:
    """Value of `node` with `xp` = numpy or jax.numpy.

    `values` maps names to arrays that broadcast; `derivatives` maps a state to d(state);
    `networks` maps a network to a function of its arguments.
    """

    def value(node: Node) -> Any:
        match node:
            case Number():
                return node.value
            case Name():
                return values[node.name]
            case Negative():
                return -value(node.operand)
            case Binary(operator="**", right=Number(value=whole)) if whole.is_integer():
                # products, where a power of real numbers is a call that takes one at a time
                return value(node.left) ** int(whole)
            case Binary():
                return _binary(node.operator, value(node.left), value(node.right))
            case Call(function="d", arguments=(Name() as state,)) if derivatives is not None:
                return derivatives[state.name]
            case Call() if networks is not None and node.function in networks:
                return networks[node.function](*map(value, node.arguments))
            case Call():
                return _function(node.function, [value(item) for item in node.arguments], xp)

    return value(node)


def _binary(operator: str, left: Any, right: Any) -> Any:
    match operator:
        case "+":
            return left + right
        case "-":
            return left - right
        case "*":
            return left * right
        case "/":
            return left / right
        case _:
            return left**right


def _function(function: str, arguments: list[Any], xp: Any) -> Any:
    match function:
        case "min" | "max":
            pairwise = xp.minimum if function == "min" else xp.maximum
            result = arguments[0]
            for argument in arguments[1:]:
                result = pairwise(result, argument)
            return result
        case "clip":
            return xp.minimum(xp.maximum(arguments[0], arguments[1]), arguments[2])
        case "overflow":
            return xp.maximum(arguments[0] - arguments[1], 0)
        case "deadzone":
            x, width = arguments
            return x - xp.minimum(xp.maximum(x, -width), width)
        case "sqrt" if xp.__name__ == "jax.numpy":
            from faultgauge.plants.square_root import square_root  # who maps columns has no JAX

            return square_root(xp.asarray(*arguments, float))
        case _:
            return getattr(xp, function)(*arguments)
