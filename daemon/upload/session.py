"""Uploading, rolling back, recovering: everything joined, one at a time, the store closed after."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import AbbeError
from abbe.daemon.config import Configuration
from abbe.daemon.config.sections.upload import UploadSetup
from abbe.daemon.ownership.claims import held_by_upload
from abbe.daemon.ownership.lock import hold
from abbe.daemon.upload.checks.preflight import (
    Cleared,
    check_tables,
    limits_of,
    preflight,
    present_tables,
    unreachable,
)
from abbe.daemon.upload.checks.shown_correction import EffectCheck, Expectation, check_effect
from abbe.daemon.upload.history import backups
from abbe.daemon.upload.history.content import Content
from abbe.daemon.upload.history.unfinished import unfinished_words
from abbe.daemon.upload.history.upload_log import Journal, last_change
from abbe.daemon.upload.ledger import Ledger
from abbe.daemon.upload.lock import only_one
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.outcome import UploadOutcome
from abbe.daemon.upload.recovery import recover
from abbe.daemon.upload.settle import check_identity, check_ready
from abbe.daemon.upload.steps import ContentChange
from abbe.daemon.upload.upload_plan import UploadPlan, backup_plan, load_plan
from abbe.daemon.upload.work import Work, user
from abbe.drivers.link import LinkError


@dataclass(frozen=True)
class UploadRequest:
    """The request for an upload, a roll-back or a recovery.

    Attributes
    ----------
    dry_run
        The pre-flight only.
    max_change_um
        In place of the configuration's, for this once.
    by, note
        For the journal.
    """

    dry_run: bool = False
    max_change_um: float | None = None
    by: str = ""
    note: str = ""


@dataclass(frozen=True)
class Result:
    """The result of an upload or a roll-back.

    Attributes
    ----------
    cleared
        The pre-flight, where it was reached.
    outcome
        Of the upload; None: nothing was begun.
    recovered
        Of an earlier upload that was cut off.
    declined
        The operator said no.
    """

    cleared: Cleared | None = None
    outcome: UploadOutcome | None = None
    recovered: UploadOutcome | None = None
    declined: bool = False

    @property
    def ok(self) -> bool:
        """Whether what was wanted is so."""
        if self.outcome is not None:
            return self.outcome.done
        if self.recovered is not None and self.recovered.open:
            return False
        return not self.declined


def setup_of(configuration: Configuration) -> UploadSetup:
    """The section ``[upload]``.

    Raises
    ------
    AbbeError
        When there is none.
    """
    if configuration.upload is None:
        raise AbbeError(
            f"{configuration.path}: no section [upload]: which controller, and within which bounds?"
        )
    return configuration.upload


@contextmanager
def working(
    configuration: Configuration, operator: OperatorPort, by: str, *, writes: bool
) -> Iterator[Work]:
    """Hold the locks, read the journal, make the store.

    Parameters
    ----------
    writes
        Whether tables may be changed: then nobody else may be at work on the controller.

    Raises
    ------
    AbbeError
        When another upload or a live run is at work on the controller, or the journal was changed.
    """
    setup = setup_of(configuration)
    store = setup.make_store()
    resources = held_by_upload(configuration, store, writes=writes)
    doing = f"upload with {configuration.path.resolve()}"
    with only_one(setup.journal) as left:
        if left:
            operator.tell(f"process {left} ended without unlocking (killed, or a power cut)")
        machine = configuration.model.machine
        with hold(resources, doing):
            yield Work(
                setup,
                configuration.model,
                setup.make_controller(machine),
                store,
                Journal(setup.journal),
                operator,
                by or user(),
            )


@asynccontextmanager
async def opened(work: Work) -> AsyncIterator[None]:
    """The store, open.

    Raises
    ------
    AbbeError
        When nobody answers; nothing was written then.
    """
    try:
        await work.store.open()
    except LinkError as error:
        raise unreachable(error) from None
    try:
        yield
    finally:
        await work.store.close()


async def upload(
    configuration: Configuration, folder: Path, request: UploadRequest, operator: OperatorPort
) -> Result:
    """Upload tables; an earlier upload that was cut off is brought to its end first.

    Raises
    ------
    AbbeError
        When the pre-flight finds something against it: nothing was written.
    """
    setup = setup_of(configuration)
    plan = load_plan(folder, configuration, setup)
    check_tables(plan, configuration.model, limits_of(setup, request.max_change_um))
    with working(configuration, operator, request.by, writes=not request.dry_run) as work:
        return await _carry_out(work, plan, request)


async def roll_back(
    configuration: Configuration, request: UploadRequest, operator: OperatorPort
) -> Result:
    """Put back what was active before the last upload.

    Raises
    ------
    AbbeError
        When there was none, its backup is missing, or the pre-flight finds something against it.
    """
    with working(configuration, operator, request.by, writes=not request.dry_run) as work:
        recovered = None if request.dry_run else await _recover_first(work)
        if recovered is not None and recovered.open:
            return Result(recovered=recovered)
        last = last_change([e for e in work.journal.found.entries if not e.get("puts_back")])
        if last is None:
            raise AbbeError("nothing to roll back: the journal knows of no upload that took effect")
        lines = work.journal.found.uploads()[last["upload"]]
        backup = next((e["backup"] for e in lines if e.get("backup")), None)
        if backup is None:
            raise AbbeError(f"upload {last['upload']} has no backup in the journal")
        plan = backup_plan(Path(backup), work.controller, configuration.file.tool.offset)
        if plan.content.sha256 != last["old"]:
            raise AbbeError(f"{backup} is not what was active before upload {last['upload']}")
        result = await _carry_out(work, plan, request)
        return Result(
            result.cleared, result.outcome, recovered or result.recovered, result.declined
        )


async def check(configuration: Configuration, operator: OperatorPort) -> EffectCheck:
    """Check what the controller adds against the tables that are active; writes nothing.

    As after an upload: where the store is set up to move the machine for that, it does.

    Raises
    ------
    AbbeError
        When nobody answers, another controller does, it is not ready, no table is active, or it
        adds something else than the active tables say.
    """
    with working(configuration, operator, "", writes=False) as work:
        section, allowed = work.setup.section, work.allowed
        async with opened(work):
            try:
                check_identity(await work.store.identity(), section.identity, section.serial)
                await check_ready(work.store)
                active = Content.of(await work.store.active())
                tables = present_tables(work.controller, active)
                if not tables:
                    raise AbbeError("no table is active: there is no effect to check")
                return await check_effect(
                    work.store,
                    Expectation(tables, work.model, _tool_of(work, active), work.store.adds_error),
                    tolerance=allowed.effect_tolerance_um,
                    looks=allowed.effect_looks,
                    every=allowed.effect_every,
                )
            except LinkError as error:
                raise AbbeError(f"{error}. Nothing was written") from None


def _tool_of(work: Work, active: Content) -> tuple[float, float, float]:
    """Tool offset for which the active tables were made, mm; zero where the journal knows none."""
    for entry in reversed(work.journal.found.entries):
        if entry.get("new") == active.sha256 and "tool_mm" in entry:
            x, y, z = entry["tool_mm"]
            return float(x), float(y), float(z)
    return 0.0, 0.0, 0.0


async def finish(
    configuration: Configuration, request: UploadRequest, operator: OperatorPort
) -> UploadOutcome | None:
    """Bring an upload that was cut off to its end; None when there is none."""
    with working(configuration, operator, request.by, writes=True) as work:
        try:
            return await recover(work)
        finally:
            await work.store.close()


async def _recover_first(work: Work) -> UploadOutcome | None:
    try:
        outcome = await recover(work)
    finally:
        await work.store.close()
    work.journal.reload()
    if outcome is not None:
        for line in outcome.lines():
            work.tell(line)
    return outcome


async def _carry_out(work: Work, plan: UploadPlan, request: UploadRequest) -> Result:
    recovered = None
    unfinished = work.journal.found.unfinished()
    if unfinished and request.dry_run:
        work.tell(unfinished_words(unfinished))
    elif unfinished:
        recovered = await _recover_first(work)
        if recovered is not None and recovered.open:
            return Result(recovered=recovered)
    async with opened(work):
        try:
            cleared = await preflight(
                work.store, work.setup, work.controller, plan, work.model,
                limits_of(work.setup, request.max_change_um),
            )  # fmt: skip
        except LinkError as error:
            raise unreachable(error) from None
        if request.dry_run or cleared.nothing_to_do:
            return Result(cleared, recovered=recovered)
        if not work.operator.ask(cleared.lines()):
            return Result(cleared, recovered=recovered, declined=True)
        return Result(cleared, await _change(work, cleared, request), recovered)


async def _change(work: Work, cleared: Cleared, request: UploadRequest) -> UploadOutcome:
    plan, old = cleared.plan, cleared.old
    context = work.context(cleared.identity, old, plan.content, plan.model)
    if plan.puts_back:
        context["puts_back"] = True
    ledger = Ledger(work.journal, context)
    ledger.note(
        "begin", "begun",
        source=str(plan.source.resolve()), note=request.note, record=dict(plan.record),
        tool_mm=list(plan.tool), change_um=cleared.change_um, warnings=list(plan.warnings),
    )  # fmt: skip

    def back_up() -> Path:
        record = {k: context[k] for k in ("upload", "who", "host", "abbe")}
        folder = work.setup.backups.resolve()
        reported = {"backup_of": context["controller"], "made": context["upload"], **record}
        options = work.setup.section.options
        return backups.save(folder, old, work.controller.name, options, reported)

    expected = Expectation(plan.tables, work.model, plan.tool, work.store.adds_error)
    change = ContentChange(cleared.identity, old, plan.content, expected, plan.puts_back)
    return await work.changeover(change, ledger, back_up).run()
