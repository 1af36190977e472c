"""The upload plan: a folder that ``abbe table`` wrote, matched with the configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from abbe.compcore.campaign.measuring_conditions import STATED
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.model_toml.campaign_record import conditions_of
from abbe.compcore.files.table_set import RECORD_NAME, TableSet, read_text, sha256
from abbe.compcore.tables.record import unit_of_entries
from abbe.compcore.tables.table import Table
from abbe.compcore.units import in_digits
from abbe.daemon.config import Configuration
from abbe.daemon.config.sections.upload import UploadSetup
from abbe.daemon.upload.history import backups
from abbe.daemon.upload.history.content import Content
from abbe.drivers.controllers import Controller
from abbe.drivers.controllers.base import with_options

_ROUNDED = 0.2
"""µm or µrad by which a dialect's rounding may change the largest entry."""


@dataclass(frozen=True, eq=False)
class UploadPlan:
    """The tables that shall become active.

    Attributes
    ----------
    source
        The folder.
    content
        Its files.
    tables
        What they hold, as errors.
    record
        What goes with them (ISO/TR 16907, 9.1).
    tool
        Tool offset for which they were made, mm.
    warnings
        For people.
    puts_back
        Whether this is a backup that is put back.
    """

    source: Path
    content: Content
    tables: tuple[Table, ...]
    record: Mapping[str, Any] = field(default_factory=dict)
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    warnings: tuple[str, ...] = ()
    puts_back: bool = False

    @property
    def model(self) -> dict[str, Any]:
        """The model from the record: SHA-256, versions, and how it was measured.

        ``measured`` holds, for each campaign, its file, SHA-256 and the stated conditions.
        """
        reported = self.record.get("model", {})
        before = reported.get("versions_before")
        fit = reported.get("fit")
        campaigns = fit.get("campaigns") if isinstance(fit, Mapping) else None
        return {
            "sha256": reported.get("sha256", ""),
            "versions": None if before is None else before + 1,
            "measured": [
                {"file": c.get("file", ""), "sha256": c.get("sha256", ""), **_said(c)}
                for c in (campaigns if isinstance(campaigns, list) else ())
                if isinstance(c, Mapping)
            ],
        }


def _said(campaign: Mapping[str, Any]) -> dict[str, str]:
    """What a person said of a campaign's conditions."""
    return {k: str(v) for k, v in conditions_of(campaign).items() if k in STATED}


def load_plan(folder: Path, configuration: Configuration, setup: UploadSetup) -> UploadPlan:
    """Read tables and refuse those that are not for this controller and this machine.

    Raises
    ------
    InputError
        For files that were changed, another dialect or other options, another machine, and files
        that the dialect cannot read.
    AbbeError
        When the files do not hold what the record says.
    """
    made = TableSet.load(folder)
    path = folder / RECORD_NAME
    if made.controller != setup.section.controller:
        raise InputError(
            "these tables are for another controller", file=path, field="controller",
            found=made.controller, expected=setup.section.controller,
        )  # fmt: skip
    machine = configuration.model.machine
    controller = setup.make_controller(machine)
    options = with_options(type(controller), made.options)
    if options != controller.options:
        raise InputError(
            "these tables were made with other options of the controller", file=path,
            field="options", found=dict(made.options), expected=str(setup.section.options),
        )  # fmt: skip
    reported = made.record.get("model", {})
    for key, mine in (("machine", machine.name), ("structure", str(machine.structure))):
        if reported.get(key) != mine:
            raise InputError(
                "these tables are for another machine", file=path, field=f"model.{key}",
                found=reported.get(key), expected=mine,
            )  # fmt: skip
    tables = controller.read(made.files)
    if not tables:
        raise InputError("the files hold no table", file=folder)
    _match(tables, made, path)
    tool = made.record.get("conditions", {}).get("tool_mm") or configuration.file.tool.offset
    return UploadPlan(
        folder,
        Content.of(made.files),
        tables,
        made.record,
        (float(tool[0]), float(tool[1]), float(tool[2])),
        _warnings(configuration, reported),
    )


def backup_plan(folder: Path, controller: Controller, tool: Sequence[float]) -> UploadPlan:
    """A backup that is to be put back.

    Raises
    ------
    InputError
        When it is missing, was changed, or cannot be read.
    """
    content = backups.load(folder)
    tables = controller.read(content.files) if content.files else ()
    x, y, z = tool
    return UploadPlan(folder, content, tables, tool=(x, y, z), puts_back=True)


def _match(tables: Sequence[Table], made: TableSet, path: Path) -> None:
    """What the record says of each table is what the files hold."""
    reported = {row["table"]: row for row in made.record.get("tables", [])}
    for table in tables:
        row = reported.pop(table.name, None)
        if row is None:
            if table.largest() > 0.0:
                raise AbbeError(f"{path}: the files hold {table.name}, the record does not")
            continue
        _, factor = unit_of_entries(table)
        off = abs(table.largest() * factor - row["largest"])
        if not off <= max(_ROUNDED, 0.01 * abs(row["largest"])):
            raise AbbeError(
                f"{path}: {table.name} is up to {in_digits(table.largest() * factor, 4)} in "
                f"the files and {in_digits(row['largest'], 4)} {row['unit']} in the record"
            )
    if reported:
        raise AbbeError(f"{path}: the record names {', '.join(reported)}, the files do not hold it")


def _warnings(configuration: Configuration, reported: Mapping[str, Any]) -> tuple[str, ...]:
    found = []
    present = sha256(read_text(configuration.model_path))
    if reported.get("sha256") != present:
        found.append(
            "the tables were made from another version of the model than the configuration names "
            f"({str(reported.get('sha256'))[:12]}, now {present[:12]})"
        )
    if configuration.file.output.axes:
        found.append(
            "this configuration also corrects live (its section [output]): abbe run on top of "
            "these tables would correct the machine twice"
        )
    return tuple(found)
