"""The views that one workbench has: which of them depends on what it was opened with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from abbe.daemon.workbench.calibration.guide import CalibrationGuide
from abbe.daemon.workbench.live.view import LiveView
from abbe.daemon.workbench.session.workbench import Workbench
from abbe.daemon.workbench.tables.desk import TableDesk


@dataclass(frozen=True)
class WorkbenchViews:
    """What the pages of a workbench stand on.

    Attributes
    ----------
    live
        The run that is looked at; None: it is not of this computer.
    bench
        The session with its model and campaigns; None: there is no model.
    desk
        The tables and their controller; None: there are none.
    guide
        The calibration; None: there is none.
    """

    live: LiveView | None = None
    bench: Workbench | None = None
    desk: TableDesk | None = None
    guide: CalibrationGuide | None = None

    @property
    def names(self) -> list[str]:
        """Their names, in the order of the tabs."""
        found = [] if self.live is None else ["live"]
        if self.bench is not None:
            found += ["compare", "learn", "watch"]
        if self.desk is not None:
            found.append("tables")
        if self.guide is not None:
            found.append("calibrate")
        return found

    @property
    def first(self) -> str:
        """The one that is shown first."""
        laid = self.bench is not None and not self.bench.empty
        if self.desk is not None and self.desk.folder is not None and not laid:
            return "tables"
        if self.guide is not None and not laid:
            return "calibrate"
        return "compare" if self.live is None else self.live.first

    def state(self) -> dict[str, Any]:
        """What every page shows all the time."""
        if self.bench is not None:
            return self.bench.state()
        return {} if self.live is None else self.live.state()

    def head(self) -> dict[str, Any]:
        """Machine, date, files with their SHA-256."""
        run = {} if self.live is None else self.live.head()
        if self.bench is None or (self.bench.empty and run.get("files")):
            return run
        return self.bench.head()

    @property
    def writing(self) -> bool:
        """Whether something is under way at the controller."""
        desks = (self.desk, self.guide.known_desk if self.guide is not None else None)
        return any(desk is not None and desk.busy for desk in desks)

    def end_streams(self) -> None:
        """End what would go on for as long as somebody looks."""
        if self.live is not None:
            self.live.end()

    def close(self) -> None:
        """End what is under way; an upload, and the last rows of a measurement, are waited for."""
        if self.bench is not None:
            self.bench.close()
        if self.desk is not None:
            self.desk.close()
        if self.guide is not None:
            self.guide.close()
