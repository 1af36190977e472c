"""Beckhoff TwinCAT CNC and the ISG kernel: volumetric tables (ISG_CSV) or axis lists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import DEGREE, axis_numbers
from abbe.drivers.controllers.base import Confidence, Controller, ControllerOptions, PerAxis, Trust
from abbe.drivers.controllers.isg.axis_lists import ANGLE, LENGTH, axis_list, read_axis_list
from abbe.drivers.controllers.isg.volumetric import isg_csv, read_isg_csv


class TwinCatIsgOptions(ControllerOptions):
    """Options of `TwinCatIsg`."""

    form: Literal["volumetric", "axes"] = "volumetric"
    """volumetric: ISG_CSV and its list; axes: a compensation value list (achskw*.lis) an axis."""
    axes: PerAxis = Field(default_factory=dict)
    """Axis → logical axis number; none: X 1, Y 2, Z 3, then as the structure lists them."""
    folder: str = "C:\\vc"
    """Where the files will lie on the controller (volumetric)."""
    records: Annotated[int, Field(ge=10)] = 2000
    """vol_comp[0].max_records of the start-up list: rows in all (volumetric)."""
    filter_steps: Annotated[int, Field(ge=0)] = 20
    points: Annotated[int, Field(ge=2, le=1500)] = 1000
    """Most points of a list (kw.ssfk.max_points, kw.crosscomp.max_points)."""


class TwinCatIsg(Controller):
    """A true volumetric target, and lists for axes: leadscrew error and cross compensation.

    Axis lists: an axis's own table has two directions; as a slave it has one master axis only.
    """

    name: ClassVar[str] = "twincat-isg"
    title: ClassVar[str] = "Beckhoff TwinCAT CNC, ISG kernel: volumetric and axis compensation"
    sign: ClassVar[str] = (
        "error (actual − indicated): volumetric as ISO 230-1 names, mm and rad; axis lists whole "
        "0.1 µm "
        "or 0.0001°"
    )
    source: ClassVar[str] = (
        "ISG kernel documentation (Volumetric compensation; compensation value lists, with a "
        "worked "
        "example of kw.ssfk), Beckhoff TF5280 and TF5200"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "documented: kw.ssfk = actual − setpoint. Taken from it: kw.crosscomp. ISO 230 signs for "
        "the "
        "volumetric file; where an axis's levers begin in the kernel's kinematic model is not said",
    )
    Options: ClassVar[type[ControllerOptions]] = TwinCatIsgOptions
    options: TwinCatIsgOptions

    @property
    def capability(self) -> Capability:
        """L-VOL and R-VOL, or L-POS in two directions and one L-STR for each axis."""
        spacing = Spacing(least=0.1, unit=1e-3)
        turning = Spacing(least=0.01 * DEGREE, unit=1e-3 * DEGREE)
        if self.options.form == "volumetric":
            holds = Holds(
                "motions",
                ("L-VOL", "R-VOL"),
                points=self.options.records // len(self.machine.axes),
                spacing=spacing,
                rotary_spacing=turning,
                resolution=1e-7,
                rotary_resolution=1e-10,
            )
            return Capability((holds,), lookup="command", shared_nodes=True, knows_tool=True)
        axis = Holds(
            "axis",
            ("L-POS", "R-POS"),
            points=self.options.points,
            spacing=spacing,
            rotary_spacing=turning,
            directional=True,
            resolution=LENGTH,
            rotary_resolution=ANGLE,
        )
        cross = replace(
            axis, form="cross", types=("L-STR", "R-RAX"), directional=False, per_output=1
        )
        return Capability((axis, cross), lookup="command")

    def _numbers(self) -> dict[str, int]:
        return axis_numbers(self.machine, self.options.axes)

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        if self.options.form == "volumetric":
            return {"volcomp1.csv": isg_csv(tables), "volcomp1.lis": self._list()}
        numbers = self._numbers()
        lists = {f"achskw{n}.lis": axis_list(a, tables, numbers) for a, n in numbers.items()}
        return {name: text for name, text in lists.items() if text}

    def _list(self) -> str:
        numbers = self._numbers()
        rows = [
            ("workpiece_axes", str(len(self.machine.structure.workpiece_side))),
            *((axis, str(i)) for axis, i in numbers.items()),
            ("Interpolation", "GRID"),
            ("enable_splicing", "FALSE"),
            ("filter_steps", str(self.options.filter_steps)),
            ("manual_activation", "FALSE"),
            ("alternative_model", "FALSE"),
            ("associate_to_channel", "FALSE"),
            ("file[0]", f"{self.options.folder}\\volcomp1.csv"),
            ("file_format[0]", "ISG_CSV"),
        ]
        return "".join(f"{key:<24} {value}\n" for key, value in rows)

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        found: list[Table] = []
        for name, text in files.items():
            if name.endswith(".csv"):
                found += read_isg_csv(name, text, self.machine)
            elif name.startswith("achskw"):
                found += read_axis_list(name, text, self._numbers())
        return found

    def activation(self) -> tuple[str, ...]:
        """Start-up list, reload commands."""
        if self.options.form == "volumetric":
            return (
                f"Copy both files to {self.options.folder}; in the start-up list: "
                "vol_comp[0].file_name "
                f"{self.options.folder}\\volcomp1.lis, vol_comp[0].max_records "
                f"{self.options.records}.",
                "Reload: #VOLCOMP OFF [ID0], #VOLCOMP [ID0 UPDATE], #VOLCOMP ON [ID0]; or over "
                "ADS.",
                "Position only: the tool's orientation is not compensated.",
                "Check one point away from all axes' zeros with an indicator: it shows signs and "
                "levers "
                "at once; `negate` in the list turns single axes round.",
            )
        return (
            "Name the lists in the start-up list; switch on lr_param.ssfk (P-AXIS-00175) and "
            "lr_param.crosscomp (P-AXIS-00047) of each corrected axis.",
            "Lists are read at start-up, or reloaded; X[COMP ON LEAD CROSS] in the NC program "
            "where "
            "manual_activation is set.",
            "A cross list lies with the slave axis; newer kernels want it with the master.",
            "Check one point of a cross list with an indicator: its sign is taken from kw.ssfk.",
        )
