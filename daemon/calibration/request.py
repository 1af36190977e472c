"""What a calibration is asked for, and where its files are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.files.gauge_file import read_gauge
from abbe.compcore.machine.machine import Machine
from abbe.daemon.config import Configuration

_FEED = 3000.0
"""Of a program of which nobody says how fast, mm/min."""
POINTS = ("laser-tracker", "tracker")
"""Instruments of points in space, whose files are matched at machines that joints move."""
IN_FILES = ("laser", "straightness", "angle", "level", "indicator", "rotary-calibrator")
"""The plan's instruments whose files can be matched with targets: lines along one axis."""
_OWN = {"L-POS", "R-POS"}
"""Types of tables over an axis's own position (ISO/TR 16907, 8.2)."""


@dataclass(frozen=True)
class CalibrationRequest:
    """A calibration as it was asked for.

    Attributes
    ----------
    configuration
        The machine, its links and instruments.
    folder
        Where the files go.
    time, check_time
        For the measurement, and for the lines that verify it: ``4h``.
    tools
        ``NAME=x,y,z``, mm.
    controller
        Dialect of the program; empty: no program.
    tables
        Dialect of the tables; empty: the machine is corrected live.
    yes
        Whether nobody is asked.
    by
        Who has it done, for the state; may be empty.
    as_json
        Whether measuring tells JSON objects, a line each.
    feed, stands
        Of the programs, mm/min, and how long they stand at a target, s; `stands` None: as the
        instrument needs; `feed` None: both as the program was made that is there.
    at
        Conditions that the tables are for.
    tolerances, mpe
        What is stated for the check, as `abbe verify` takes it; `tolerances` None: both as they
        were stated last.
    language
        Of the certificate.
    """

    configuration: Configuration
    folder: Path
    time: str
    check_time: str
    tools: tuple[str, ...]
    controller: str
    tables: str
    yes: bool
    by: str = ""
    as_json: bool = False
    feed: float | None = None
    stands: float | None = None
    at: tuple[str, ...] = ("reference",)
    tolerances: tuple[str, ...] | None = None
    mpe: str = ""
    language: str | None = None

    @property
    def config(self) -> Path:
        """The configuration's file."""
        return self.configuration.path

    @property
    def model(self) -> Path:
        """The model that the configuration names."""
        return self.configuration.model_path

    def program_settings(self, recorded: Mapping[str, str] | None) -> dict[str, str]:
        """How a program is made.

        Parameters
        ----------
        recorded
            How the one was made that is there; None: there is none.
        """
        if self.feed is None and recorded:
            return {**recorded, "controller": self.controller}
        feed = _FEED if self.feed is None else self.feed
        stands = "" if self.stands is None else f"{self.stands:g}"
        return {"controller": self.controller, "feed": f"{feed:g}", "stands": stands}

    def stated(self, recorded: Mapping[str, str] | None) -> dict[str, str]:
        """What the check has to keep: tolerances, and the limit of lengths; and its language.

        Parameters
        ----------
        recorded
            What was stated for the one that is there; None: there is none.
        """
        if self.tolerances is None:
            return dict(recorded or {})
        both = {"tolerance": " ".join(self.tolerances), "mpe": self.mpe}
        # one that is not typed is that of the page which is there
        language = self.language or (recorded or {}).get("language", "en")
        both["language"] = "" if language == "en" else language
        return {key: value for key, value in both.items() if value}

    @property
    def instruments(self) -> str:
        """The plan's instruments that lead through it, comma-separated: those that are linked."""
        if self.touches:
            return self.touches
        names: dict[str, None] = {}
        for name, section in self.configuration.file.instrument.items():
            if section.linked != self.by_file:
                names |= dict.fromkeys(section.measures or (name,))
        return ",".join(n for n in names if not self.by_file or n in self._in_files)

    @property
    def _in_files(self) -> tuple[str, ...]:
        """Instruments whose files are matched: at an arm also those of a tracker."""
        sections = self.configuration.file.instrument.items()
        if not set(POINTS) & {n for name, s in sections for n in s.measures or (name,)}:
            return IN_FILES
        return IN_FILES + (POINTS if reaches_by_joints(self.configuration.model.machine) else ())

    @property
    def along_axes(self) -> bool:
        """Whether only set-ups are planned in which one axis moves, as files of lines have them."""
        return self.by_file and not set(self.instruments.split(",")) & set(POINTS)

    @property
    def by_file(self) -> bool:
        """Whether all instruments write files: readings are matched with the targets afterwards.

        Beside one that is linked those that are not are left out.
        """
        sections = self.configuration.file.instrument.values()
        return bool(sections) and not any(section.linked for section in sections)

    @property
    def touches(self) -> str:
        """The plan's instrument whose artefact the machine touches by itself; or empty.

        Only where nothing else measures: a plate before a gauge before a sphere.
        """
        section = self.configuration.file.probing
        if section is None or self.configuration.file.instrument:
            return ""
        if section.plate is not None:
            return "ball-plate"
        return self._gauge_kind or "sphere"

    @property
    def plate(self) -> Path | None:
        """Certificate of the plate that the machine touches in the plan."""
        section = self.configuration.file.probing
        named = section.plate if section is not None and self.touches else None
        return None if named is None else self.config.parent / named

    @property
    def radii(self) -> tuple[float, float]:
        """What must not meet where a sphere is touched: the table's and the tool's radius, mm."""
        section = self.configuration.file.probing
        if section is None or self.touches != "sphere":
            return 0.0, 0.0
        return section.table_radius, section.tool_radius

    @property
    def gauge(self) -> Path | None:
        """Certificate of the gauge that it touches in the plan or in the check plan."""
        section = self.configuration.file.probing
        touches = section is not None and not self.configuration.file.instrument
        named = section.gauge if section is not None and touches else None
        return None if named is None else self.config.parent / named

    @property
    def checked_by(self) -> str:
        """The check plan's instruments; empty where there is none that a check can be made by.

        Of what is touched a gauge first: it has lengths to judge; else what was fitted, elsewhere.
        """
        from abbe.compcore.planning.check_lines import CHECKED_BY

        if self.touches:
            return self._gauge_kind or self.touches
        own = [name for name in self.instruments.split(",") if name in CHECKED_BY]
        return ",".join(own)

    @property
    def _gauge_kind(self) -> str:
        if self.gauge is None:
            return ""
        return "gauge-block" if len(read_gauge(self.gauge).faces) == 2 else "step-gauge"

    @property
    def offsets(self) -> dict[str, tuple[float, float, float]]:
        """Name → offset of each tool, mm."""
        from abbe.daemon.arguments.plan_arguments import tools_of

        return dict(tools_of(self.tools))

    @property
    def uploads(self) -> bool:
        """Whether tables are made and there is a controller that takes them."""
        return bool(self.tables) and self.configuration.upload is not None

    @property
    def corrected_live(self) -> bool:
        """Whether ``abbe run`` can correct the machine: X, Y or Z carries the correction."""
        return bool(self.configuration.model.machine.structure.carrying)

    @property
    def table_options(self) -> list[str]:
        """Options of the tables' dialect as ``abbe table --set`` takes them: those of [upload]."""
        if self.configuration.upload is None:
            return []
        return [f"{k}={_as_typed(v)}" for k, v in self.configuration.upload.section.options.items()]

    def holds_positioning_only(self, machine: Machine) -> bool:
        """Whether the tables hold nothing but each axis's own positioning."""
        from abbe.drivers.controllers import make_controller

        if not self.tables:
            return False
        options = dict(text.split("=", 1) for text in self.table_options)
        capability = make_controller(self.tables, machine, options).capability
        return set(capability.types) <= _OWN

    def file(self, name: str) -> Path:
        """A file of the calibration."""
        return self.folder / name


def require_measured_with(configuration: Configuration) -> None:
    """Refuse a configuration that has nothing to measure with; raises `InputError`."""
    if not configuration.file.instrument and configuration.file.probing is None:
        raise InputError(
            "no instrument to measure with",
            file=configuration.path,
            field="instrument",
            expected="a section [instrument.laser], …, or [probing] (docs/measure.md)",
        )
    instruments = configuration.file.instrument
    if instruments and not any(section.linked for section in instruments.values()):
        named = {n for name, s in instruments.items() for n in s.measures or (name,)}
        by_joints = reaches_by_joints(configuration.model.machine)
        if not named & {*IN_FILES, *(POINTS if by_joints else ())}:
            raise InputError(
                "their files cannot be matched with targets along one axis",
                file=configuration.path,
                field="instrument",
                found=", ".join(f'{name} with reads = "file"' for name in instruments),
                expected="one of " + ", ".join(IN_FILES) + ", or one that is linked",
            )


def _as_typed(value: object) -> str:
    """A value of an option as it is typed: ``true``, ``X:1,Y:2``."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return ",".join(f"{k}:{_as_typed(v)}" for k, v in value.items())
    return str(value)
