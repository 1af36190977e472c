"""The outcome of an upload: what is active now, what is known of it, the words for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from abbe.compcore.sentences import said
from abbe.daemon.upload.history.content import Content, short

Active = Literal["new", "old", "unknown"]


@dataclass(frozen=True)
class UploadOutcome:
    """The outcome of an upload, a roll-back or a recovery.

    Attributes
    ----------
    done
        Whether what was wanted is active, verified and, where it can be, seen to act.
    active
        Which of the two is active, as read from the controller; ``unknown``: it could not be read.
    old, new
        The two.
    upload
        Its name in the journal; empty: nothing was begun.
    step
        Where it broke; empty: nowhere.
    why
        What broke it.
    backup
        Where the old tables are kept.
    notes
        What else is to be said.
    seen
        What the check of the effect found.
    last
        What stood in the way when everything was to be put right.
    puts_back
        Whether the new one is a backup that was to be put back.
    """

    done: bool
    active: Active
    old: Content
    new: Content
    upload: str = ""
    step: str = ""
    why: str = ""
    backup: Path | None = None
    notes: tuple[str, ...] = ()
    seen: str = ""
    last: str = ""
    puts_back: bool = False

    @property
    def open(self) -> bool:
        """Whether the journal is left without an end, for ``--recover``."""
        return not self.done and self.active != "old"

    @property
    def name(self) -> str:
        """What the new set is, for people."""
        return "table of the backup" if self.puts_back else "new table"

    def lines(self) -> list[str]:
        """For people: what failed, what is active, what to do."""
        found: list[str] = []
        if self.step:
            found.append(said("failed at the step '{step}': {why}", step=self.step, why=self.why))
        found += self._state()
        if self.seen and self.active == "new":
            found.append(self.seen)
        found += self.notes
        if self.backup is not None:
            found.append(said("backup of what was active before: {file}", file=self.backup))
        return found

    def _state(self) -> list[str]:
        old, new = short(self.old.sha256), short(self.new.sha256)
        if self.active == "new":
            what = said("the new table ({table}) is active", table=new)
            if self.new.none:
                what = said("no table is active")
            elif self.puts_back:
                what = said("the table of the backup ({table}) is active", table=new)
            return [said("{what}, verified by reading it back", what=what)]
        if self.active == "old":
            what = (
                said("no table is active, as before")
                if self.old.none
                else said("the old table ({table}) is active", table=old)
            )
            return [said("{what}, verified by reading it back; nothing is staged", what=what)]
        return [
            said(
                "which table is active is NOT known, the old one ({old}) or the new one ({new}): "
                "it could not be read and verified{why}",
                old=old,
                new=new,
                why=f" ({self.last})" if self.last else "",
            ),
            said(
                "do not machine or measure with it; bring the controller back and run "
                "abbe upload CONFIG.toml --recover"
            ),
        ]

    def as_json(self) -> dict[str, Any]:
        """One object for ``--json``."""
        return {
            "done": self.done,
            "active": self.active,
            "sha256": {"new": self.new.sha256, "old": self.old.sha256}.get(self.active),
            "old": self.old.sha256,
            "new": self.new.sha256,
            "upload": self.upload,
            "failed_step": self.step or None,
            "why": self.why or None,
            "journal": "open" if self.open else "closed",
            "backup": None if self.backup is None else str(self.backup),
            "effect": self.seen or None,
            "notes": list(self.notes),
        }
