"""Formulas as text: parsed into a small checked grammar, never handed to the interpreter.

Numbers, names, ``+ − * / **`` (with a number as exponent), parentheses and the functions of
`FUNCTIONS`. Quantities are checked against each other: a sum of mm and °C is an error, and so is
the sine of a length. A bare number carries whatever unit its place asks for: ``X - 350`` and
``sin(2*pi*X/10)`` are right, ``X + T_a`` and ``sin(X)`` are not.
"""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.expressions.dimensions import Dimension
from abbe.compcore.errors import InputError

F64 = NDArray[np.float64]

NUMBER = Dimension()
BARE = Dimension(free=True)
ANGLE = Dimension.of("rad")

FUNCTIONS: dict[str, str] = {
    "sin": "sine of an angle or number",
    "cos": "cosine of an angle or number",
    "tan": "tangent of an angle or number",
    "exp": "exponential of a number",
    "log": "natural logarithm of a number",
    "sqrt": "square root",
    "abs": "absolute value",
    "sign": "−1, 0 or 1",
    "min": "least of two or more alike",
    "max": "greatest of two or more alike",
    "lag": "lag(signal, tau): the signal behind a first-order lag of tau s",
    "signal": "signal('name'): a signal whose name is no identifier",
}
"""Name → what it is."""

_LONGEST = 500
_DEEPEST = 40
_GREATEST_POWER = 8

_ONE: dict[str, Callable[[F64], F64]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
}
_OPERATORS: dict[type[ast.operator], Callable[[F64, F64], F64]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
}


class Values(Protocol):
    """The values of a formula's names, each of shape (n,)."""

    def variable(self, name: str) -> F64:
        """A variable."""

    def signal(self, name: str) -> F64:
        """A signal."""

    def lagged(self, name: str, tau: float) -> F64:
        """A signal behind a first-order lag of `tau` s."""


@dataclass(frozen=True, slots=True)
class FormulaNode:
    """A checked piece of a formula.

    Attributes
    ----------
    what
        ``number``, ``variable``, ``signal``, ``lag``, ``power``, ``negative``, an operator's class
        name or a function's name.
    dimension
        Of its value.
    parts
        What it is made of.
    name
        Of a variable, signal or lagged signal.
    number
        Value of a number, exponent of a power, time constant of a lag (s).
    """

    what: str
    dimension: Dimension
    parts: tuple[FormulaNode, ...] = ()
    name: str = ""
    number: float = 0.0

    def evaluate(self, values: Values) -> F64:
        """Its value on n rows, shape (n,) (or () for a constant)."""
        if self.what == "number":
            return np.asarray(self.number)
        if self.what == "variable":
            return values.variable(self.name)
        if self.what == "signal":
            return values.signal(self.name)
        if self.what == "lag":
            return values.lagged(self.name, self.number)
        parts = [part.evaluate(values) for part in self.parts]
        if self.what == "power":
            return np.asarray(parts[0] ** self.number)
        if self.what == "negative":
            return -parts[0]
        if self.what in _ONE:
            return _ONE[self.what](parts[0])
        if self.what in ("min", "max"):
            chosen = np.minimum if self.what == "min" else np.maximum
            result = parts[0]
            for part in parts[1:]:
                result = chosen(result, part)
            return result
        return _ARITHMETIC[self.what](parts[0], parts[1])

    def walk(self) -> Iterator[FormulaNode]:
        """This piece and all those inside it."""
        yield self
        for part in self.parts:
            yield from part.walk()

    def variables(self) -> tuple[str, ...]:
        """Variables that it reads, in order of first use."""
        return tuple(dict.fromkeys(n.name for n in self.walk() if n.what == "variable"))

    def signals(self) -> tuple[str, ...]:
        """Signals that it reads, lagged or not, in order of first use."""
        found = (n.name for n in self.walk() if n.what in ("signal", "lag"))
        return tuple(dict.fromkeys(found))


_ARITHMETIC = {kind.__name__: function for kind, function in _OPERATORS.items()}


def parse_expression(
    text: str, variables: Mapping[str, Dimension], signals: Mapping[str, Dimension]
) -> FormulaNode:
    """Read and check a formula.

    Parameters
    ----------
    text
        The formula.
    variables
        Names that it may use → their dimensions: positions, directions, time.
    signals
        Recorded signals alike; where a name is among the variables too, that one is meant.

    Raises
    ------
    InputError
        For anything that is not in the grammar, a name that does not exist (lists those that do), a
        wrong number of arguments, quantities that cannot be added or have no sine.
    """
    return _FormulaReader(text, variables, signals).read()


class AnyName(Mapping[str, Dimension]):
    """Every name there could be, of any dimension: to check a formula before the machine is known.

    Only the names that `taken` holds are not among them.
    """

    def __init__(self, taken: Callable[[str], bool]) -> None:
        self._taken = taken

    def __getitem__(self, name: str) -> Dimension:
        if self._taken(name):
            raise KeyError(name)
        return BARE

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


class _FormulaReader:
    def __init__(
        self, text: str, variables: Mapping[str, Dimension], signals: Mapping[str, Dimension]
    ) -> None:
        self.text, self.variables, self.signals = text, variables, signals

    def wrong(self, problem: str, node: ast.expr | None, expected: str | None = None) -> InputError:
        found = self.text if node is None else ast.get_source_segment(self.text, node) or self.text
        return InputError(f"formula {self.text!r}: {problem}", found=found, expected=expected)

    def read(self) -> FormulaNode:
        if len(self.text) > _LONGEST:
            raise InputError("formula too long", found=f"{len(self.text)} characters")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                tree = ast.parse(self.text.strip(), mode="eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise self.wrong("cannot be read", None, "an expression such as X*(T_a - T0)") from None
        self.text = self.text.strip()
        return self.node(tree.body, 0)

    def node(self, node: ast.expr, depth: int) -> FormulaNode:
        if depth > _DEEPEST:
            raise self.wrong("too deeply nested", None)
        if isinstance(node, ast.Constant):
            return self.number(node)
        if isinstance(node, ast.Name):
            return self.variable(node.id, node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            inner = self.node(node.operand, depth + 1)
            if isinstance(node.op, ast.UAdd):
                return inner
            return FormulaNode("negative", inner.dimension, (inner,))
        if isinstance(node, ast.BinOp):
            return self.binary(node, depth)
        if isinstance(node, ast.Call):
            return self.call(node, depth)
        raise self.wrong(
            "not allowed here", node, "numbers, names, + - * / **, parentheses and functions"
        )

    def number(self, node: ast.Constant) -> FormulaNode:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.wrong("not a number", node)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.wrong("not a finite number", node)
        return FormulaNode("number", BARE, number=number)

    def variable(self, name: str, node: ast.expr) -> FormulaNode:
        if name == "pi":
            return FormulaNode("number", NUMBER, number=math.pi)
        if name in self.variables:
            return FormulaNode("variable", self.variables[name], name=name)
        if name in self.signals:
            return FormulaNode("signal", self.signals[name], name=name)
        raise self.wrong("unknown name", node, self.known())

    def known(self) -> str:
        parts = [", ".join(self.variables)]
        parts.append("signals " + (", ".join(self.signals) or "(none declared)"))
        parts.append("pi, functions " + ", ".join(FUNCTIONS))
        return "one of " + "; ".join(parts)

    def known_signals(self) -> str | None:
        if isinstance(self.signals, AnyName):
            return None
        return "one of " + (", ".join(self.signals) or "(none declared)")

    def binary(self, node: ast.BinOp, depth: int) -> FormulaNode:
        left = self.node(node.left, depth + 1)
        if isinstance(node.op, ast.Pow):
            return self.power(node, left, depth)
        if type(node.op) not in _OPERATORS:
            raise self.wrong("operator not allowed", node, "+ - * / **")
        right = self.node(node.right, depth + 1)
        what = type(node.op).__name__
        if what in ("Add", "Sub"):
            dimension = self.same((left, right), node)
        else:
            dimension = left.dimension.times(right.dimension, 1 if what == "Mult" else -1)
        return FormulaNode(what, dimension, (left, right))

    def power(self, node: ast.BinOp, base: FormulaNode, depth: int) -> FormulaNode:
        exponent = self.constant(node.right, depth)
        if exponent is None or abs(exponent) > _GREATEST_POWER:
            raise self.wrong(
                "an exponent must be a number", node, f"a number within ±{_GREATEST_POWER}"
            )
        raised = base.dimension.to_the(Fraction(exponent).limit_denominator(12))
        return FormulaNode("power", raised, (base,), number=exponent)

    def constant(self, node: ast.expr, depth: int) -> float | None:
        """The value of a piece without variables, else None."""
        piece = self.node(node, depth + 1)
        if piece.variables() or piece.signals():
            return None
        with np.errstate(all="ignore"):
            value = float(piece.evaluate(_NOTHING))
        return value if math.isfinite(value) else None

    def same(self, parts: tuple[FormulaNode, ...], node: ast.expr) -> Dimension:
        total = parts[0].dimension
        for part in parts[1:]:
            joined = total.joined(part.dimension)
            if joined is None:
                raise self.wrong(
                    f"{total} and {part.dimension} cannot be added or compared", node, self.units()
                )
            total = joined
        return total

    def units(self) -> str:
        known = {**self.signals, **self.variables}
        return "quantities of one unit; " + ", ".join(f"{k} [{d}]" for k, d in known.items())

    def call(self, node: ast.Call, depth: int) -> FormulaNode:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS or node.keywords:
            raise self.wrong("unknown function", node, "one of " + ", ".join(FUNCTIONS))
        wanted = 2 if name in ("lag", "min", "max") else 1
        given = len(node.args)
        if given != wanted and not (given > wanted and name in ("min", "max")):
            raise self.wrong(f"{name} takes {wanted} argument(s), not {given}", node)
        if name in ("lag", "signal"):
            return self.of_signal(name, node, depth)
        parts = tuple(self.node(argument, depth + 1) for argument in node.args)
        if name in ("min", "max"):
            return FormulaNode(name, self.same(parts, node), parts)
        inner = parts[0].dimension
        if name in ("abs", "sign", "sqrt"):
            half = inner.to_the(Fraction(1, 2))
            return FormulaNode(name, {"abs": inner, "sign": NUMBER, "sqrt": half}[name], parts)
        angle = name in ("sin", "cos", "tan")
        if not inner.pure and not (angle and inner.powers == ANGLE.powers):
            raise self.wrong(
                f"{name} of a quantity in {inner}",
                node,
                "an angle or a number: divide by a number, as in sin(2*pi*X/10)"
                if angle
                else "a number: divide by one, as in exp(-t/600)",
            )
        return FormulaNode(name, NUMBER, parts)

    def of_signal(self, name: str, node: ast.Call, depth: int) -> FormulaNode:
        first = node.args[0]
        which = ""
        if isinstance(first, ast.Name):
            which = first.id
        elif isinstance(first, ast.Constant) and isinstance(first.value, str):
            which = first.value
        if which not in self.signals:
            raise self.wrong(
                f"{name} needs the name of a signal",
                first,
                self.known_signals(),
            )
        if name == "signal":
            return FormulaNode("signal", self.signals[which], name=which)
        tau = self.constant(node.args[1], depth)
        if tau is None or not tau > 0.0:
            raise self.wrong("the time constant of a lag is a number above 0, in s", node.args[1])
        return FormulaNode("lag", self.signals[which], name=which, number=tau)


class _Nothing:
    """A formula without variables asks for none."""

    def variable(self, name: str) -> F64:
        raise KeyError(name)

    def signal(self, name: str) -> F64:
        raise KeyError(name)

    def lagged(self, name: str, tau: float) -> F64:
        raise KeyError(name)


_NOTHING = _Nothing()
