"""How a command that evaluates something tells it: as text, as JSON, as a page."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from abbe.daemon.arguments.options import AsJson, Force, Report

if TYPE_CHECKING:
    from abbe.daemon.outputs import Say


class WrittenPage(Protocol):
    """A page that can be written to a file."""

    def write(self, path: Path) -> None:
        """Write it."""


@dataclass(frozen=True)
class AnswerOptions:
    """``--json``, ``--report``, ``--force``.

    Attributes
    ----------
    as_json
        One JSON object instead of text.
    report
        The page that is written besides.
    force
        Over a file of another kind, too.
    """

    as_json: AsJson = False
    report: Report = None
    force: Force = False

    def checked(self, reads: Iterable[Path | None]) -> Say:
        """How to tell the user something; see `check_outputs`, which refuses what would destroy."""
        from abbe.daemon.outputs import REPORT, check_outputs

        return check_outputs(
            reads, [(self.report, REPORT)], force=self.force, as_json=self.as_json
        )  # fmt: skip

    def tell(
        self, say: Say, page: Callable[[], WrittenPage], as_json: Callable[[], object],
        as_text: Callable[[], Iterable[str]],
    ) -> None:  # fmt: skip
        """Write the page where one is wanted, and say the answer; only what is wanted is made."""
        if self.report is not None:
            page().write(self.report)
        if self.as_json:
            say(json.dumps(as_json(), ensure_ascii=False))
            return
        for line in as_text():
            say(line)
        if self.report is not None:
            say(f"written: {self.report}")
