"""What was uploaded before, as the journal of uploads has it."""

from __future__ import annotations

from typing import Any

from abbe.daemon.config import Configuration
from abbe.daemon.upload.history.content import short
from abbe.daemon.upload.history.upload_log import END, read_journal

_COLUMNS = ["Time (UTC)", "Who", "What", "From → to", "Outcome", "Remark"]
_MOST = 12
"""Uploads that are listed, the newest."""


def past_uploads(configuration: Configuration) -> dict[str, Any]:
    """The newest uploads as a table; raises as `read_journal`."""
    rows = []
    if configuration.upload is not None:
        uploads = list(read_journal(configuration.upload.journal).uploads().values())
        for entries in reversed(uploads[-_MOST:]):
            first, last = entries[0], entries[-1]
            ended = last["step"] == END
            rows.append(
                [
                    str(first["time"])[:16].replace("T", " "),
                    str(first.get("who") or "–"),
                    "rolled back" if first.get("puts_back") else "uploaded",
                    f"{short(first['old'])} → {short(first['new'])}",
                    f"{last.get('active')} is active" if ended else f"cut off at '{last['step']}'",
                    str(first.get("note", "")),
                ]
            )
    return {"columns": _COLUMNS, "cells": rows}
