"""Recovery of an upload that was cut off: what the journal says, and bringing it to its end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.daemon.upload.checks.shown_correction import Expectation
from abbe.daemon.upload.history import backups
from abbe.daemon.upload.history.content import Content
from abbe.daemon.upload.history.unfinished import unfinished_words
from abbe.daemon.upload.history.upload_log import END, Entry
from abbe.daemon.upload.ledger import Ledger
from abbe.daemon.upload.outcome import UploadOutcome
from abbe.daemon.upload.settle import Settled, settle
from abbe.daemon.upload.steps import ContentChange
from abbe.daemon.upload.work import Work
from abbe.drivers.link import LinkError
from abbe.drivers.stores.base import Identity


async def recover(work: Work) -> UploadOutcome | None:
    """Bring an unfinished upload to its end; None when there is none.

    Old table active: the staging area is emptied, and that is the end. New one: its verification is
    finished. Neither: the backup is put back.
    """
    entries = work.journal.found.unfinished()
    if not entries:
        return None
    first = entries[0]
    work.tell(unfinished_words(entries))
    ledger = Ledger(work.journal, _context(first))
    ledger.note("recover", "begun", who_recovers=work.who)
    reported: dict[str, Any] = first["controller"]
    identity = Identity(reported["name"], reported["serial"])
    backup = next((e["backup"] for e in entries if e.get("backup")), None)
    old, missing = _old(first, backup)
    new = Content(first["new"])
    found = await settle(
        work.store, old, new, identity,
        want_old=False, wait_limit=work.allowed.wait_limit, step_timeout=work.allowed.step_timeout,
        tell=work.tell,
    )  # fmt: skip
    if found.active == "new":
        try:
            files = await work.store.active()
        except LinkError as error:
            found = Settled("unknown", str(error))
        else:
            return await _finished(work, first, ledger, old, Content.of(files), backup)
    outcome = UploadOutcome(
        done=False,
        active=found.active,
        old=old,
        new=new,
        upload=ledger.upload,
        backup=Path(backup) if backup else None,
        last=found.why,
        notes=tuple(n for n in (found.note, missing if found.active != "old" else "") if n),
    )
    ledger.note_anyway(
        "settle" if outcome.open else END,
        "left open" if outcome.open else "failed",
        active=outcome.active,
        why="interrupted",
        last=found.why,
    )
    return outcome


async def _finished(
    work: Work, first: Entry, ledger: Ledger, old: Content, new: Content, backup: str | None
) -> UploadOutcome:
    """Verify what was found active as an upload would have."""
    tables = work.controller.read(new.files) if new.files else ()
    x, y, z = first.get("tool_mm", (0.0, 0.0, 0.0))
    tool = (float(x), float(y), float(z))
    expected = Expectation(tables, work.model, tool, work.store.adds_error)
    kept = None if backup is None else Path(backup)
    reported: dict[str, Any] = first["controller"]
    identity = Identity(reported["name"], reported["serial"])
    change = ContentChange(identity, old, new, expected, bool(first.get("puts_back")))
    return await work.changeover(change, ledger, lambda: Path(), kept).finish()


def _context(first: Entry) -> dict[str, Any]:
    keys = ("upload", "who", "host", "abbe", "controller", "dialect", "model", "old", "new",
            "puts_back")  # fmt: skip
    return {key: first[key] for key in keys if key in first}


def _old(first: Entry, backup: str | None) -> tuple[Content, str]:
    """The old set with its files where the backup has them, and what is wrong with the backup."""
    if not first["old"]:
        return Content.of({}), ""
    if backup is None:
        return Content(first["old"]), "no backup had been made when it was cut off"
    try:
        content = backups.load(Path(backup))
    except InputError as error:
        return Content(first["old"]), f"the backup cannot be used: {error}"
    if content.sha256 != first["old"]:
        return Content(first["old"]), f"the backup {backup} is not what was active"
    return content, ""
