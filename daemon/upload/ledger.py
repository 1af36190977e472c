"""The lines of one upload in the journal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from abbe.compcore.errors import InputError
from abbe.daemon.upload.history.upload_log import Journal


class Ledger:
    """The lines of one upload in the journal.

    Parameters
    ----------
    journal
        Where they go.
    context
        What every line carries: which upload, who, controller, model, the two SHA-256.
    """

    def __init__(self, journal: Journal, context: Mapping[str, Any]) -> None:
        self._journal = journal
        self._context = dict(context)
        self.broken = ""

    @property
    def upload(self) -> str:
        """The upload's name."""
        return str(self._context["upload"])

    def note(self, step: str, outcome: str, **more: Any) -> None:
        """Write a line; raises `InputError` when it cannot be written."""
        self._journal.append({**self._context, "step": step, "outcome": outcome, **more})

    def note_anyway(self, step: str, outcome: str, **more: Any) -> None:
        """Write a line, and go on without where that fails: the machine comes first."""
        try:
            self.note(step, outcome, **more)
        except InputError as error:
            self.broken = str(error)
