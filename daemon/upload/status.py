"""The status of uploads: what is active, where it came from, what was left unfinished."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from abbe.compcore.sentences import joined, said
from abbe.daemon.upload.history.content import Content, short
from abbe.daemon.upload.history.unfinished import unfinished_words
from abbe.daemon.upload.history.upload_log import END, Entry
from abbe.daemon.upload.settle import check_identity
from abbe.daemon.upload.work import Work


async def status(work: Work) -> dict[str, Any]:
    """Ask the controller; reads only.

    Parameters
    ----------
    work
        Its store open.

    Raises
    ------
    WrongControllerError
        When another controller answers.
    LinkError
        When it does not tell.
    """
    store, section = work.store, work.setup.section
    identity = await store.identity()
    check_identity(identity, section.identity, section.serial)
    ready = await store.readiness()
    active = Content.of(await store.active())
    staged = Content.of(await store.staged())
    unfinished = work.journal.found.unfinished()
    return {
        "controller": {"name": identity.name, "serial": identity.serial},
        "idle": ready.idle,
        "referenced": ready.referenced,
        "hindrances": list(ready.hindrances),
        "active": active.sha256,
        "files": sorted(active.files or {}),
        "restart_needed": store.restart_needed,
        "from": origin(active, work.journal.found.entries),
        "staged": staged.sha256,
        "unfinished": unfinished_words(unfinished) if unfinished else None,
    }


def origin(active: Content, entries: Sequence[Entry]) -> dict[str, Any] | None:
    """The upload that made a set active; None when the journal knows of none."""
    for entry in reversed(entries):
        ended = entry["step"] == END and entry.get("active") == "new"
        if ended and entry["new"] == active.sha256:
            keys = ("upload", "time", "who", "model", "abbe")
            return {key: entry.get(key) for key in keys}
    return None


_READY = {
    (True, True): said("idle, referenced"),
    (True, False): said("idle, not referenced"),
    (False, True): said("not idle, referenced"),
    (False, False): said("not idle, not referenced"),
}


def status_lines(found: dict[str, Any]) -> list[str]:
    """For people."""
    reported = found["controller"]
    ready = _READY[bool(found["idle"]), bool(found["referenced"])]
    lines: list[str] = [
        said(
            "controller: {name}",
            name=reported["name"] + (f", {reported['serial']}" if reported["serial"] else ""),
        ),
        joined([ready, *found["hindrances"]]),
    ]
    if not found["active"]:
        lines.append(said("active: no table"))
    else:
        table = f"{short(found['active'])} ({', '.join(found['files'])})"
        lines.append(said("active: {table}", table=table))
        came = found["from"]
        if came is None:
            lines.append(said("not from any upload that this journal knows"))
        else:
            version = came["model"].get("versions")
            of = said("; version {version} of the model", version=version) if version else ""
            lines.append(
                said(
                    "from upload {upload} of {time} by {who}{of}",
                    upload=came["upload"],
                    time=came["time"],
                    who=came["who"],
                    of=of,
                )
            )
    if found["restart_needed"]:
        lines.append(said("it acts after the controller was restarted"))
    if found["staged"]:
        lines.append(said("staged, not active: {table}", table=short(found["staged"])))
    if found["unfinished"]:
        lines.append(f"{found['unfinished']}; run abbe upload CONFIG.toml --recover")
    return lines
