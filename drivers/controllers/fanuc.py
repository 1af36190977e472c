"""Fanuc: stored pitch error compensation, incremental, as a parameter file. Experimental."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Capability, Holds, Increment, Spacing
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import (
    DEGREE,
    axis_numbers,
    equidistant,
    output_of,
    position_unit,
)
from abbe.drivers.controllers.base import (
    Cannot,
    Confidence,
    Controller,
    ControllerOptions,
    PerAxis,
    Trust,
)
from abbe.drivers.controllers.text import above_zero, numbered_lines, only_file
from abbe.drivers.controllers.text import number as to_number

F64 = NDArray[np.float64]

_FIRST = 10_000
"""Block numbers of pitch entries are 10000 + point number."""
_HIGHEST = 1023
_BLOCK = re.compile(r"N(\d{1,9})(?:Q(\d+))?((?:A\d{1,9}P[-+.\d]+)+|P[-+.\d]+);?")
_ITEM = re.compile(r"A(\d{1,9})P([-+.\d]+)")


class FanucOptions(ControllerOptions):
    """Options of `Fanuc`."""

    format: Literal["30i", "16i"] = "30i"
    """30i: blocks carry Q (1 parameter, 0 pitch) and the interval in mm; 16i: neither."""
    axes: PerAxis = Field(default_factory=dict)
    """Axis → controlled axis number; none: X 1, Y 2, Z 3, then as the structure lists them."""
    detection_um: Annotated[float, Field(gt=0.0)] = 1.0
    """Detection unit, µm (rotary: thousandths of a degree)."""
    limit: Annotated[int, Field(ge=1, le=127)] = 7
    """Largest entry; 7, or 127 with the extended range."""
    points: Annotated[int, Field(ge=2, le=1024)] = 128
    """Most points of an axis."""
    bidirectional: bool = False
    """A second table for the way down (parameter 3605 bit 0, an option of the control)."""
    first_point: Annotated[int, Field(ge=0, le=_HIGHEST)] = 0
    """Point number with which the first axis begins; the others follow on."""


class Fanuc(Controller):
    """Entries are added up from the reference point, where the compensation is 0, outwards.

    The entry of point n is what is output between the points n − 1 and n, in detection units times
    the magnification. Parameters 3620 (point of the reference position), 3621, 3622 (farthest
    points on the − and + side), 3623 (magnification), 3624 (interval), 3626 and 3627 (farthest
    point on the − side and value at the reference position of the second table).
    """

    name: ClassVar[str] = "fanuc"
    title: ClassVar[str] = "Fanuc 0i/16i/18i/30i, stored pitch error compensation (experimental)"
    sign: ClassVar[str] = (
        "compensation (−error) as steps from point to point, in detection units × magnification: "
        "pulses that are added to the command"
    )
    source: ClassVar[str] = (
        "Fanuc parameter manual B-63980EN p. 98-100 (entries, numbers), report A-77810E (two "
        "directions), 15i manual B-63330EN p. 25 and 30i manual B-63950EN p. 11-12 (file)"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.UNVERIFIED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "experimental: the block numbers of pitch entries (10000 + point) and the entries' limit "
        "are "
        "from memory, and no manual that was read says that a positive entry moves the axis in its "
        "positive direction",
    )
    cannot: ClassVar[tuple[Cannot, ...]] = (
        Cannot(
            "Fanuc straightness compensation",
            "no manual that was read gives the numbers of its parameters (moving axis, corrected "
            "axis, points, values) for one series, nor its sign",
        ),
        Cannot(
            "Fanuc three-dimensional error compensation (30i)",
            "report A-79351E gives the formula, trilinear between the corners of a box, not how "
            "the values are entered, their number or their order; grid-csv holds the same numbers",
        ),
    )
    Options: ClassVar[type[ControllerOptions]] = FanucOptions
    options: FanucOptions

    @property
    def capability(self) -> Capability:
        """L-POS and R-POS, increments of a few units, equidistant through the reference point."""
        unit = self.options.detection_um
        holds = Holds(
            "axis",
            ("L-POS", "R-POS"),
            points=self.options.points,
            spacing=Spacing("equidistant", least=0.01, unit=1e-3, through_zero=True),
            rotary_spacing=Spacing(
                "equidistant", least=0.1 * DEGREE, unit=1e-3 * DEGREE, through_zero=True
            ),
            directional=self.options.bidirectional,
            resolution=unit * 1e-3,
            rotary_resolution=unit * 1e-3 * DEGREE,
            increment=Increment(self.options.limit, tuple(range(1, 101))),
            zero_at="zero",
        )
        return Capability((holds,), lookup="command")

    def _unit(self, axis: str) -> tuple[float, float]:
        """Size of a position unit (mm or degree) and of a detection unit, mm or rad."""
        base = position_unit(axis)
        return base, self.options.detection_um * 1e-3 * base

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        numbers = axis_numbers(self.machine, self.options.axes)
        parameters: dict[int, dict[int, str]] = {}
        entries: dict[int, int] = {}
        start = self.options.first_point
        for table in tables:
            (axis,) = table.inputs
            base, unit = self._unit(axis)
            nodes = table.nodes[0]
            zero = int(np.abs(nodes).argmin())
            counts = [np.rint(-v / unit).astype(int) for v in (table.forward, table.downward)]
            if not table.directional:
                counts = counts[:1]
            size = _magnification(counts, zero, self.options.limit)
            interval = round(float(nodes[1] - nodes[0]) / base, 3)
            reference = start + zero
            stated: dict[int, str] = {
                3620: str(reference),
                3621: str(start + 1),
                3622: str(start + len(nodes) - 1),
                3623: str(size),
                3624: f"{interval:.3f}"
                if self.options.format == "30i"
                else f"{interval * 1e3:.0f}",
            }
            start = _put(entries, counts[0], size, start)
            if table.directional:
                stated[3626] = str(start + 1)
                stated[3627] = str(int(counts[1][zero]) // size)
                start = _put(entries, counts[1], size, start)
            for parameter, value in stated.items():
                parameters.setdefault(parameter, {})[numbers[axis]] = value
        if start - 1 > _HIGHEST:
            raise InputError(
                "the control has no more points",
                field="points",
                found=start,
                expected=f"at most {_HIGHEST + 1} for all axes; use fewer with --points",
            )
        with_q = self.options.format == "30i"
        lines = ["%"]
        for parameter, values in sorted(parameters.items()):
            items = "".join(f"A{a}P{v}" for a, v in sorted(values.items()))
            lines.append(f"N{parameter:05d}{'Q1' if with_q else ''}{items}")
        for point, entry in sorted(entries.items()):
            lines.append(f"N{_FIRST + point}{'Q0' if with_q else ''}P{entry}")
        return {"pitch.txt": "\n".join([*lines, "%", ""])}

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        name, text = only_file(files)
        parameters: dict[tuple[int, int], float] = {}
        entries: dict[int, int] = {}
        for line, number, items in _blocks(text, name):
            if number >= _FIRST:
                entries[number - _FIRST] = _entry(items, name, line)
            else:
                for axis, value in items.items():
                    parameters[number, axis] = value
        axes = {
            number: axis for axis, number in axis_numbers(self.machine, self.options.axes).items()
        }
        found = []
        for number in sorted({a for _, a in parameters}):
            if number not in axes:
                raise InputError(
                    "an axis number that the machine has no axis for",
                    file=name,
                    field=f"A{number}",
                    expected="one of " + ", ".join(f"A{n} ({a})" for n, a in axes.items()),
                )
            found.append(self._axis_table(axes[number], number, parameters, entries, name))
        return found

    def _axis_table(
        self,
        axis: str,
        number: int,
        parameters: Mapping[tuple[int, int], float],
        entries: Mapping[int, int],
        file: str,
    ) -> Table:
        def parameter(which: int) -> float:
            if (which, number) not in parameters:
                raise InputError(
                    "a parameter is missing", file=file, field=f"N{which:05d} A{number}"
                )
            return parameters[which, number]

        base, unit = self._unit(axis)
        reference, first, last = (int(parameter(p)) for p in (3620, 3621, 3622))
        size = int(above_zero(parameter(3623), file, None, f"N03623 A{number}"))
        interval = above_zero(parameter(3624), file, None, f"N03624 A{number}")
        interval *= 1.0 if self.options.format == "30i" else 1e-3
        count = last - first + 2
        zero = reference - first + 1
        if not (0 <= first <= last <= _HIGHEST and 0 <= zero < count):
            raise InputError(
                "numbers of points that do not go together", file=file,
                field=f"N03620 to N03622 A{number}", found=f"{reference}, {first}, {last}",
                expected=f"first ≤ last ≤ {_HIGHEST}, the reference point at one of them",
            )  # fmt: skip
        nodes = equidistant(-zero * interval * base, interval * base, count)
        forward = _added_up(entries, first, count, zero, 0)
        backward = None
        if (3626, number) in parameters:
            other = int(parameters[3626, number])
            at = int(parameters.get((3627, number), 0.0))
            backward = _added_up(entries, other, count, zero, at) * (-unit * size)
        return Table(output_of(axis), (axis,), (nodes,), forward * (-unit * size), backward)

    def activation(self) -> tuple[str, ...]:
        """Parameter input, power cycle, reference return."""
        return (
            "Save the present parameters and pitch data first.",
            "Read the file in as parameters (MDI, parameter write enabled), or send it over RS-232 "
            "(the control asks for data with DC1 and pauses it with DC3).",
            *(
                ("Set parameter 3605 bit 0 of each axis for the second direction.",)
                if self.options.bidirectional
                else ()
            ),
            "The interval must be at least the greatest feed rate in mm/min divided by 7500.",
            *(
                (
                    "Of a rotary axis that turns on and on, the entries over a turn must add up to "
                    "0, and whole intervals make 360 degrees: look at both, rounding may have "
                    "spoilt them.",
                )
                if self.machine.structure.rotary
                else ()
            ),
            "Switch the control off and on, and return to the reference position.",
            "Check one point with an indicator before cutting: neither the sign nor the block "
            "numbers "
            "have been tried.",
        )


def _magnification(counts: Sequence[NDArray[np.int_]], zero: int, limit: int) -> int:
    """The smallest factor in which all steps are whole and small enough."""
    steps = np.concatenate([np.diff(c) for c in counts])
    others = np.array([int(c[zero]) for c in counts])
    for size in range(1, 101):
        fits = (np.abs(steps) <= limit * size).all()
        if fits and not (steps % size).any() and not (others % size).any():
            return size
    raise ValueError(f"steps up to {np.abs(steps).max()} do not fit ±{limit}")


def _put(entries: dict[int, int], counts: NDArray[np.int_], size: int, start: int) -> int:
    """Number the steps from `start` + 1; returns the next axis's start."""
    for i, step in enumerate(np.diff(counts), start=1):
        entries[start + i] = int(step) // size
    return start + len(counts)


def _added_up(entries: Mapping[int, int], first: int, count: int, zero: int, at: int) -> F64:
    steps = np.array([entries.get(first + i, 0) for i in range(count - 1)], dtype=np.float64)
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(sums - sums[zero] + at)


def _blocks(text: str, file: str) -> Iterator[tuple[int, int, dict[int, float]]]:
    """Line, block number, axis (0: none) → value."""
    framed = [(i, line) for i, line in numbered_lines(text) if line]
    if len(framed) < 2 or framed[0][1] != "%" or framed[-1][1] != "%":
        raise InputError("the file does not begin and end with %", file=file, expected="%")
    for i, line in framed[1:-1]:
        match = _BLOCK.fullmatch(line)
        if match is None:
            raise InputError(
                "not a parameter or pitch block", file=file, line=i, found=line,
                expected="N…P… or N…A…P…",
            )  # fmt: skip
        items = {int(a): to_number(v, file, i, f"A{a}") for a, v in _ITEM.findall(match[3])}
        yield i, int(match[1]), items or {0: to_number(match[3][1:], file, i, "P")}


def _entry(items: Mapping[int, float], file: str, line: int) -> int:
    value = items.get(0)
    if value is None:
        raise InputError("a pitch block is of no axis", file=file, line=line, expected="N…P…")
    if value != int(value):
        raise InputError("a pitch entry is a whole number", file=file, line=line, found=value)
    return int(value)
