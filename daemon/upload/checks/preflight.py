"""The questions to the controller before anything is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said
from abbe.compcore.tables.table import Table
from abbe.daemon.config.sections.upload import UploadSetup
from abbe.daemon.upload.checks.bounds import Extent, Limits, check, extent, largest_change
from abbe.daemon.upload.history.content import Content, short
from abbe.daemon.upload.settle import check_identity, check_ready
from abbe.daemon.upload.upload_plan import UploadPlan
from abbe.drivers.controllers import Controller
from abbe.drivers.link import LinkError
from abbe.drivers.stores.base import Identity, Store


@dataclass(frozen=True)
class Cleared:
    """A pre-flight that found nothing against it.

    Attributes
    ----------
    identity
        Which controller answers.
    old
        What is active now.
    extent
        How large the new tables are.
    change_um
        How far from the present ones, at most.
    plan
        What shall become active.
    """

    identity: Identity
    old: Content
    extent: Extent
    change_um: float
    plan: UploadPlan

    @property
    def nothing_to_do(self) -> bool:
        """Whether it is active already."""
        return self.old.sha256 == self.plan.content.sha256

    def lines(self) -> list[str]:
        """For people: what would change."""
        reported = self.identity.name + (
            f", {self.identity.serial}" if self.identity.serial else ""
        )
        new = self.plan.content
        found: list[str] = [
            said("controller: {name}; idle and referenced", name=reported),
            said("active now: {table}", table=_with_files(self.old)),
            said("to become active: {table}", table=_with_files(new)),
            said(
                "new entries up to {entry}, correction at most {correction} µm",
                entry=f"{self.extent.entry_um:.2f} µm"
                if not self.extent.entry_urad
                else said(
                    "{length} µm and {angle} µrad",
                    length=f"{self.extent.entry_um:.2f}",
                    angle=f"{self.extent.entry_urad:.2f}",
                ),
                correction=f"{self.extent.correction_um:.2f}",
            ),
            said("the correction changes by at most {change} µm", change=f"{self.change_um:.2f}"),
        ]
        return found + [said("warning: {what}", what=w) for w in self.plan.warnings]

    def as_json(self) -> dict[str, Any]:
        """One object for ``--json``."""
        return {
            "controller": {"name": self.identity.name, "serial": self.identity.serial},
            "old": self.old.sha256,
            "new": self.plan.content.sha256,
            "entry_um": self.extent.entry_um,
            "entry_urad": self.extent.entry_urad,
            "slope_um_per_mm": self.extent.slope,
            "correction_um": self.extent.correction_um,
            "change_um": self.change_um,
            "warnings": list(self.plan.warnings),
        }


def limits_of(setup: UploadSetup, max_change_um: float | None) -> Limits:
    """What the configuration allows; `max_change_um` in place of its own for this once."""
    section = setup.section
    return Limits(
        section.max_entry_um,
        section.max_entry_urad,
        section.max_slope_um_per_mm,
        setup.max_correction_um,
        section.max_change_um if max_change_um is None else max_change_um,
    )


def check_tables(plan: UploadPlan, model: Model, limits: Limits) -> Extent:
    """The bounds that need no controller; a backup that was active before is let through.

    Raises
    ------
    OutOfBoundsError
        When the tables are too large or too steep.
    """
    found = extent(plan.tables, model, plan.tool)
    if not plan.puts_back:
        check(found, None, limits)
    return found


def _with_files(content: Content) -> str:
    files = "" if content.none else f" ({', '.join(sorted(content.files or {}))})"
    return f"{short(content.sha256)}{files}"


async def preflight(
    store: Store,
    setup: UploadSetup,
    controller: Controller,
    plan: UploadPlan,
    model: Model,
    limits: Limits,
) -> Cleared:
    """Ask everything that has to be known before anything is written; writes nothing.

    Parameters
    ----------
    store
        Open.

    Raises
    ------
    WrongControllerError, NotReadyError, OutOfBoundsError
        What speaks against it.
    LinkError
        When the controller does not tell.
    AbbeError
        When what is active is not of this dialect.
    """
    measured = check_tables(plan, model, limits)
    identity = await store.identity()
    check_identity(identity, setup.section.identity, setup.section.serial)
    await check_ready(store)
    old = Content.of(await store.active())
    present = present_tables(controller, old)
    change = largest_change(plan.tables, present, model, plan.tool) * 1e3
    if not plan.puts_back:
        check(measured, change, limits)
    return Cleared(identity, old, measured, change, plan)


def present_tables(controller: Controller, old: Content) -> Sequence[Table]:
    """What is active, read in the dialect.

    Raises
    ------
    AbbeError
        When it cannot be read.
    """
    if not old.files:
        return ()
    try:
        return controller.read(old.files)
    except InputError as error:
        raise AbbeError(
            f"what is active on the controller cannot be read as {controller.name}: {error}. "
            "Nothing was written; save it and take it out of action at the controller first"
        ) from None


def unreachable(error: LinkError) -> AbbeError:
    """The controller did not answer before anything was written."""
    return AbbeError(f"{error}. Nothing was written; what was active is active")
