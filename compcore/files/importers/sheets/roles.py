"""Columns of a foreign table by what they hold; what has no column may stand at its top."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.sheets.words import Sheet, as_number, number, split_unit
from abbe.compcore.machine.plausible import TOOL, Range

Words = Mapping[str, tuple[str, ...]]
"""Role → headings that name it, in small letters."""

_ANYTHING = Range(-1e15, 1e15, "")
_REMARKS = ("remark", "remarks", "comment", "comments", "operator")


@dataclass(frozen=True, eq=False)
class RoleColumns:
    """A sheet whose columns have roles.

    Attributes
    ----------
    sheet
        The rows.
    where
        Role → column.
    units
        Role → the unit in its heading, where there is one.
    others
        Heading → column, of those without a role.
    """

    sheet: Sheet
    where: Mapping[str, int]
    units: Mapping[str, str]
    others: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, sheet: Sheet, words: Words) -> RoleColumns:
        """Give each column its role.

        Raises
        ------
        InputError
            When two columns have one role.
        """
        line, cells = sheet.rows[0]
        where: dict[str, int] = {}
        units: dict[str, str] = {}
        others: dict[str, int] = {}
        for i, cell in enumerate(cells):
            name, unit = split_unit(cell)
            role = next((r for r, known in words.items() if name in known), None)
            if role is None:
                if name and name not in _REMARKS:
                    others[cell.strip()] = i
                continue
            if role in where:
                raise InputError(
                    "the same column twice", file=sheet.file, line=line, field=cell, found=role
                )
            where[role] = i
            if unit:
                units[role] = unit
        return cls(sheet, where, units, others)

    def states(self, role: str) -> bool:
        """Whether the file says it, in a column or at its top."""
        return role in self.where or role in self.sheet.comments

    def text(self, cells: list[str], role: str, default: str) -> str:
        """A cell as it stands, else what the top says, else a default."""
        if role in self.where:
            return cells[self.where[role]]
        return self.sheet.comments.get(role, default)

    def number(
        self, line: int, cells: list[str], role: str, allowed: Range, default: float | None = None
    ) -> float:
        """A number of a row, else of the file's top, else a default.

        Raises
        ------
        InputError
            For what is no number or not believable, and for what is not there without a default.
        """
        if role in self.where:
            at = self.where[role]
            if default is not None and not cells[at]:
                return default
            return self.cell(line, cells, at, role, allowed)
        if role in self.sheet.comments:
            value = as_number(self.sheet.comments[role])
            if value is None or not allowed.holds(value):
                raise InputError(
                    "not believable", file=self.sheet.file, field=role,
                    found=self.sheet.comments[role], expected=str(allowed),
                )  # fmt: skip
            return value
        if default is None:
            raise InputError(
                "a column is missing", file=self.sheet.file, line=self.sheet.rows[0][0],
                field=role, found=", ".join(self.sheet.rows[0][1]), expected=f"a column {role!r}",
            )  # fmt: skip
        return default

    def cell(
        self,
        line: int,
        cells: list[str],
        at: int,
        field_name: str,
        allowed: Range = _ANYTHING,
        per_unit: float = 1.0,
    ) -> float:
        """A number of a cell times a factor; `allowed` bounds it thereafter.

        Raises
        ------
        InputError
            Naming the place.
        """
        value = number(cells[at], self.sheet, line, field_name) * per_unit
        if not allowed.holds(value):
            raise InputError(
                "not believable", file=self.sheet.file, line=line, field=field_name,
                found=cells[at], expected=str(allowed),
            )  # fmt: skip
        return value

    def signals(self, line: int, cells: list[str]) -> dict[str, float]:
        """Every column without a role, by its heading."""
        return {name: self.cell(line, cells, i, name) for name, i in self.others.items()}

    def tool(
        self, line: int, cells: list[str], otherwise: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """The tool's offset: columns tool_x … tool_z, ``# tool = x, y, z``, or what was given, mm.

        Raises
        ------
        InputError
            For what is no offset.
        """
        text = self.sheet.comments.get("tool")
        if text is not None:
            parts = [as_number(p) for p in text.strip("[]()").split(",")]
            found = [p for p in parts if p is not None and TOOL.holds(p)]
            if len(parts) != 3 or len(found) != 3:
                raise InputError(
                    "not a tool's offset", file=self.sheet.file, field="tool", found=text,
                    expected="three numbers in mm: # tool = 0, 0, -120",
                )  # fmt: skip
            otherwise = (found[0], found[1], found[2])
        x, y, z = (
            self.number(line, cells, f"tool_{k}", TOOL, v)
            for k, v in zip("xyz", otherwise, strict=True)
        )
        return x, y, z


TOOL_WORDS: Words = {f"tool_{k}": (f"tool_{k}",) for k in "xyz"}
STANDARD_WORDS: Words = {
    "sd": ("sd", "u_cal"),
    "expanded": ("expanded", "u95", "expanded uncertainty"),
    "expansion": ("expansion", "alpha", "cte"),
    "expansion_sd": ("expansion_sd",),
    "temperature": ("temperature", "t_part", "t_workpiece", "t_material"),
    "temperature_sd": ("temperature_sd",),
}
"""What is said of a material standard: uncertainty (µm), expansion (ppm/K), temperature (°C)."""
SD = Range(0.0, 1e4, "um")
EXPANSION = Range(-20.0, 100.0, "ppm/K")
STANDARD_TEMPERATURE = Range(-30.0, 100.0, "degC")
STANDARD_TEMPERATURE_SD = Range(0.0, 50.0, "K")


def calibration_sd(columns: RoleColumns, line: int, cells: list[str]) -> float:
    """Standard uncertainty of a calibration: `sd` (k = 1) or half of `expanded` (k = 2), mm."""
    sd = columns.number(line, cells, "sd", SD, 0.0)
    return 1e-3 * (sd or 0.5 * columns.number(line, cells, "expanded", SD, 0.0))
