"""Formula effects: an effect that is not in the catalogue, written as a formula."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field, field_validator

from abbe.compcore.effects.base import (
    F64,
    FUNCTIONAL_POINT,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.expressions.dimensions import Dimension
from abbe.compcore.effects.expressions.expression import AnyName, FormulaNode, parse_expression
from abbe.compcore.effects.registry import register
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.typical import typical

_CHANNEL = re.compile(
    r"(?:d(?P<shift>[XYZ])|E_(?P<component>[XYZABC])(?P<axis>[XYZUVWRABC][0-9]?))"
)
_AXIS = re.compile(r"[XYZUVWRABC][0-9]?")
_DIRECTION = re.compile(r"([XYZUVWRABC][0-9]?)_dir")
_SPACE = re.compile(r"('[^']*'|\"[^\"]*\")|\s+")
_BENT = ("abs", "sign", "min", "max")
"""Functions whose slope jumps."""


def _split(value: object) -> object:
    """Terms of a command line: split at the commas that stand in no parentheses."""
    if not isinstance(value, str):
        return value
    terms, depth, start = [], 0, 0
    for i, letter in enumerate(value):
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            terms.append(value[start:i])
            start = i + 1
    return (*terms, value[start:])


def _without_spaces(text: str) -> str:
    return _SPACE.sub(lambda match: match[1] or "", text)


MOST_TERMS = 50
Terms = Annotated[
    tuple[str, ...], BeforeValidator(_split), Field(min_length=1, max_length=MOST_TERMS)
]


def _is_variable(name: str) -> bool:
    return name in ("t", "T0") or bool(_AXIS.fullmatch(name) or _DIRECTION.fullmatch(name))


@lru_cache(maxsize=512)
def _parsed(
    text: str,
    variables: tuple[tuple[str, Dimension], ...],
    signals: tuple[tuple[str, Dimension], ...],
) -> FormulaNode:
    return parse_expression(text, dict(variables), dict(signals))


@register
class Formula(Effect):
    """An effect that is in no catalogue, as a sum of terms with one coefficient each.

    Written in the model file or given to ``abbe add``. It is read by a small grammar of its own and
    checked; nothing of it is ever run as a program.

    Formula
        ``channel = Σ c_i·term_i``. The ``channel`` is an error motion of an axis, E_XX, E_ZY, E_BC,
        or a shift dX, dY, dZ of the functional point. The ``terms`` are expressions over positions
        X, Y, … (mm; rotary axes rad; held at the ends of the travel), approach directions X_dir, …
        (1, −1, 0), signals by their names, t (s), T0 (the reference temperature), pi, numbers,
        ``+ − * / **``, parentheses, sin cos tan exp log sqrt abs sign min max, lag(signal, tau)
        with tau in s, and signal('name') for a signal whose name is no identifier.
    Parameters
    ----------
        c1, c2, … one for each term, in the channel's unit by the term's. Plausible is what moves
        the channel by up to ±0.2 mm (±500 µrad) over the machine's travel and usual signals.
        Quantities are checked: a sum of mm and °C, or the sine of a length, is an error. A bare
        number takes the unit that its place asks for, so that X − 350 and sin(2*pi*X/10) are right.
    Signals
        Those that it names.
    Typical causes
        Whatever the catalogue lacks; what diagnosis offers as empirical.
    Cure
        Find the physics behind it, and make it an effect of its own (CONTRIBUTING.md).
    Source
        Yours.
    """

    kind = "formula"
    channel: str
    terms: Terms

    @field_validator("channel")
    @classmethod
    def _channel_is_known(cls, value: str) -> str:
        if _CHANNEL.fullmatch(value) is None:
            raise InputError(
                "not an error motion",
                field="channel",
                found=value,
                expected="dX, dY, dZ or E_XX, E_ZY, E_BC, … (component, then axis)",
            )
        return value

    @field_validator("terms")
    @classmethod
    def _terms_can_be_read(cls, terms: tuple[str, ...]) -> tuple[str, ...]:
        for text in terms:
            _free(text)
        return tuple(_without_spaces(text) for text in terms)

    def target(self) -> ErrorMotion:
        """The error motion that `channel` names; raises `InputError` where it names none."""
        match = _CHANNEL.fullmatch(self.channel)
        if match is None:
            raise InputError("not an error motion", field="channel", found=self.channel)
        component: Component = match["shift"] or match["component"]  # type: ignore[assignment]
        return ErrorMotion(match["axis"] or FUNCTIONAL_POINT, component)

    def check(self, machine: Machine) -> None:
        """An axis that exists; names and dimensions of the terms."""
        place = self.target().place
        if place != FUNCTIONAL_POINT:
            machine.axis(place, "channel")
        for text in self.terms:
            try:
                self._node(machine, text)
            except InputError as error:
                raise error.at(field="terms") from None
        super().check(machine)

    def _node(self, machine: Machine, text: str) -> FormulaNode:
        variables = {a: Dimension.of(_unit(machine, a)) for a in machine.structure.axes}
        variables |= {f"{a}_dir": Dimension() for a in machine.structure.axes}
        variables |= {"t": Dimension.of("s"), "T0": Dimension.of("K")}
        signals = {s.name: Dimension.of(s.unit) for s in machine.signals.values()}
        return _parsed(text, tuple(variables.items()), tuple(signals.items()))

    def signals_needed(self) -> tuple[str, ...]:
        """The signals that the terms name."""
        return tuple(dict.fromkeys(s for text in self.terms for s in _free(text).signals()))

    def reads_time(self) -> bool:
        """Whether a term names t."""
        return "t" in self._variables()

    def _variables(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(v for text in self.terms for v in _free(text).variables()))

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The axes whose positions the terms name."""
        return tuple(v for v in self._variables() if v in machine.structure.axes)

    def directions_used(self) -> tuple[str, ...]:
        """The axes whose directions the terms name."""
        return tuple(m[1] for v in self._variables() if (m := _DIRECTION.fullmatch(v)))

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """One coefficient a term."""
        channel = self.target()
        most = 5e-4 if channel.rotation else 0.2
        found = []
        for i, text in enumerate(self.terms, start=1):
            node = self._node(machine, text)
            size = _size(node, machine)
            unit = str(Dimension.of(channel.unit).times(node.dimension, -1))
            found.append(Parameter(f"c{i}", unit, (-most / size, most / size), f"of {text}"))
        return tuple(found)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The terms on the channel.

        Raises
        ------
        InputError
            When a term has no value somewhere (a root of a negative number, a division by zero).
        """
        values = _Recorded(machine, conditions)
        columns = np.empty((conditions.n, len(self.terms)))
        for i, text in enumerate(self.terms):
            with np.errstate(all="ignore"):
                columns[:, i] = self._node(machine, text).evaluate(values)
            bad = np.flatnonzero(~np.isfinite(columns[:, i]))
            if bad.size:
                at = ", ".join(f"{a} = {q[bad[0]]:g}" for a, q in conditions.positions.items())
                raise InputError(f"formula {text!r} has no value at {at}", field="terms")
        return (Motion(self.target(), columns),)

    def expressions(
        self, machine: Machine, coefficients: F64
    ) -> tuple[tuple[float, FormulaNode], ...]:
        """Its terms."""
        nodes = [self._node(machine, text) for text in self.terms]
        return tuple(zip(map(float, coefficients), nodes, strict=True))

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travels, and where abs, sign, min and max of one position turn."""
        found = {}
        for axis in self.positions_used(machine):
            bends: list[float] = list(machine.axis(axis).travel)
            jumps: list[float] = []
            for text in self.terms:
                for where, turning, jump in _turning(self._node(machine, text)):
                    if where == axis:
                        (jumps if jump else bends).extend(_roots(turning, machine, axis, jump))
            found[axis] = tuple(sorted({*_apart(bends, machine.axis(axis)), *jumps}))
        return found

    def kinks_move(self, machine: Machine) -> bool:
        """Where abs, sign, min or max compares a position with anything that is not constant."""
        axes = set(machine.structure.axes)
        pieces = [p for text in self.terms for p in self._node(machine, text).walk()]
        return any(
            bool(axes & set(p.variables())) and (bool(p.signals()) or len(p.variables()) > 1)
            for p in pieces
            if p.what in _BENT
        )


def _unit(machine: Machine, axis: str) -> str:
    return "rad" if machine.axis(axis).rotary else "mm"


@lru_cache(maxsize=4096)
def _free(text: str) -> FormulaNode:
    """A formula read before the machine is known: grammar and functions are checked."""
    variables = AnyName(lambda name: not _is_variable(name))
    return parse_expression(text, variables, AnyName(_is_variable))


class _Recorded:
    """The values of a formula's names on recorded conditions."""

    def __init__(self, machine: Machine, conditions: Conditions) -> None:
        self._machine, self._conditions = machine, conditions

    def variable(self, name: str) -> F64:
        if name == "t":
            return self._conditions.time
        if name == "T0":
            return np.asarray(self._machine.reference_temperature)
        if match := _DIRECTION.fullmatch(name):
            return self._conditions.direction(match[1])
        return self._machine.axis(name).clamp(self._conditions.position(name))

    def signal(self, name: str) -> F64:
        return self._conditions.signal(name)

    def lagged(self, name: str, tau: float) -> F64:
        return self._conditions.lag(name, tau)


class _Sample:
    """Plausible values of all names, or of one position alone."""

    def __init__(self, machine: Machine, only: str | None = None, at: F64 | None = None) -> None:
        self._machine, self._only, self._at = machine, only, at
        self._random = np.random.default_rng(1905)

    def variable(self, name: str) -> F64:
        if self._at is not None and name == self._only:
            return self._at
        if name == "t":
            return self._random.uniform(0.0, 1e4, 64)
        if name == "T0":
            return np.asarray(self._machine.reference_temperature)
        if _DIRECTION.fullmatch(name):
            return self._random.choice([-1.0, 1.0], 64)
        return self._random.uniform(*self._machine.axis(name).travel, 64)

    def signal(self, name: str) -> F64:
        signal = self._machine.signals[name]
        middle = self._machine.reference_temperature if signal.temperature else 0.0
        return middle + self._random.uniform(-1.0, 1.0, 64) * typical(signal).change

    def lagged(self, name: str, tau: float) -> F64:
        return self.signal(name)


def _size(node: FormulaNode, machine: Machine) -> float:
    """How large a term typically gets."""
    with np.errstate(all="ignore"):
        value = np.abs(np.atleast_1d(node.evaluate(_Sample(machine))))
    value = value[np.isfinite(value)]
    largest = float(value.max(initial=0.0))
    return largest if largest > 0.0 else 1.0


def _turning(node: FormulaNode) -> Iterator[tuple[str, Callable[[_Sample], F64], bool]]:
    """Each bend that one position alone makes: axis, what changes its sign there, a jump or not."""
    for piece in node.walk():
        if piece.what not in _BENT or piece.signals() or len(piece.variables()) != 1:
            continue
        axis = piece.variables()[0]
        if piece.what in ("abs", "sign"):
            yield axis, piece.parts[0].evaluate, piece.what == "sign"
            continue
        for i, one in enumerate(piece.parts):
            for two in piece.parts[i + 1 :]:
                yield axis, _difference(one, two), False


def _difference(one: FormulaNode, two: FormulaNode) -> Callable[[_Sample], F64]:
    return lambda sample: one.evaluate(sample) - two.evaluate(sample)


def _roots(
    turning: Callable[[_Sample], F64], machine: Machine, axis: str, jump: bool
) -> list[float]:
    """Positions in the travel where `turning` changes its sign; of a jump both sides of it."""

    def sign(position: F64) -> F64:
        with np.errstate(all="ignore"):
            value = turning(_Sample(machine, axis, position))
        return np.sign(np.broadcast_to(value, position.shape))

    grid = np.linspace(*machine.axis(axis).travel, 2001)
    found = sign(grid)
    change = np.flatnonzero(found[:-1] != found[1:])
    left, right, before = grid[change], grid[change + 1], found[change]
    for _ in range(60 if change.size else 0):
        middle = 0.5 * (left + right)
        same = sign(middle) == before
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    if jump:
        return [*left.tolist(), *right.tolist()]
    return [float(position) for position in right]


def _apart(positions: list[float], axis: Axis) -> list[float]:
    """Positions without those that differ by rounding only."""
    ordered = np.sort(positions)
    apart = np.diff(ordered, prepend=-np.inf) > 1e-9 * axis.half_travel
    return [float(position) for position in ordered[apart]]
