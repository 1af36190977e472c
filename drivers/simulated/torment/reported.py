"""Violations for people, each with what went on, one a second of each promise."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.drivers.simulated.torment.judge.checker import Checker
from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.script import Script


class ReportedViolations:
    """The checker's violations in words.

    Parameters
    ----------
    checker
        Finds them.
    scripts
        What went wrong when; the first one's clock counts.
    log
        Gets every one.

    Attributes
    ----------
    lines
        One a second of each promise, with what went on.
    """

    def __init__(self, checker: Checker, scripts: Sequence[Script], log: WireLog) -> None:
        self._checker = checker
        self._scripts = tuple(scripts)
        self._log = log
        self._seen = 0
        self._reported_at: dict[str, float] = {}
        self.lines: list[str] = []

    def tell(self) -> None:
        """Put new violations into words."""
        while self._seen < len(self._checker.violations):
            violation = self._checker.violations[self._seen]
            self._seen += 1
            at = self._scripts[0].elapsed(violation.time)
            line = f"{at:8.2f} s  {violation.promise}: {violation.text}"
            self._log.say("#", line)
            last = self._reported_at.get(violation.promise, -1.0)
            if 0.0 <= violation.time - last < 1.0:
                continue
            self._reported_at[violation.promise] = violation.time
            around = "; ".join(
                str(t).strip() for script in self._scripts for t in script.around(violation.time)
            )
            self.lines.append(f"{line}\n            script: {around or 'calm'}")
