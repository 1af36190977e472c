"""What every page of a session says of itself: machine, dates, files with their SHA-256."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from abbe.daemon.answers.inputs import now
from abbe.daemon.installed import abbe_version
from abbe.daemon.report.head import FileOnPage, head_of
from abbe.daemon.workbench.campaigns.laid import LaidCampaigns
from abbe.daemon.workbench.session.origin import FromStore
from abbe.daemon.workbench.versions.folder import ModelVersion
from abbe.daemon.workbench.versions.seen_file import SeenFile


def session_head(
    current: ModelVersion, laid: LaidCampaigns, origin: FromStore | None
) -> dict[str, Any]:
    """Machine, serial number, date, and every file, of the present version and its campaigns."""
    head = head_of(current.model, [_as_read("model", current.seen)], laid.campaign)
    held = [_as_read("campaign, held out", f) for f in laid.seen if f.path in laid.held]
    place = [] if origin is None else [["Plant's store", origin.place]]
    return {
        "machine": current.model.machine.name or "Machine",
        "facts": [*place, *([name, text] for name, text in head.facts.items())],
        "files": [[f.part, Path(f.file).name, f.sha256] for f in (*head.files, *held)],
        "abbe": abbe_version(),
        "made": now(),
    }


def _as_read(part: str, seen: SeenFile) -> FileOnPage:
    """A file as it was read: what lies there now may be another one."""
    return FileOnPage(part, str(seen.path), seen.sha256)
