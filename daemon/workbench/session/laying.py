"""Which campaigns lie beside the model: sent, chosen, read again from the disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.answers.model import expected_times as expected
from abbe.daemon.report.head import file_on_page
from abbe.daemon.workbench.campaigns.laid import lay
from abbe.daemon.workbench.campaigns.shelf import CampaignShelf
from abbe.daemon.workbench.session.task import Tell
from abbe.daemon.workbench.session.tasks import SessionTasks
from abbe.daemon.workbench.session.view import SessionView
from abbe.daemon.workbench.versions.folder import ModelVersion
from abbe.daemon.workbench.versions.journal import WorkbenchJournal


class LayingCampaigns:
    """Lays campaigns beside the version that is looked at.

    Parameters
    ----------
    shelf
        Those that can be chosen.
    view
        What is looked at.
    tasks
        What is under way; its lock is held while the view changes.
    journal
        Where it is written down.
    show
        Looks at a version, and tells all windows.
    """

    def __init__(
        self,
        shelf: CampaignShelf,
        view: SessionView,
        tasks: SessionTasks,
        journal: WorkbenchJournal,
        show: Callable[[ModelVersion, Sequence[str]], None],
    ) -> None:
        self.shelf = shelf
        self._view, self._tasks, self._journal, self._show = view, tasks, journal, show

    def listed(self) -> dict[str, Any]:
        """Which campaigns there are, and whether what is sent lasts."""
        return {
            "campaigns": self.shelf.listed(self._view.laid.fitted, self._view.laid.held),
            "lasting": self.shelf.lasting,
        }

    def took(self, path: Path, who: str) -> str:
        """A campaign was sent and stands in the shelf's folder; what stands for it.

        Raises
        ------
        InputError
            Where that cannot be written down.
        """
        known = self.shelf.took(path)
        self._journal.keep(who, "sent", file=path.name, sha256=file_on_page("", path).sha256)
        return known

    def use(self, fitted: Sequence[str], held: Sequence[str], who: str) -> None:
        """Lay the present version beside other campaigns of the shelf.

        Parameters
        ----------
        fitted, held
            What stands for them.
        who
            For the journal.

        Raises
        ------
        InputError
            For a campaign that is not there, or none, and while something is under way.
        """
        files, others = self.shelf.of(fitted), self.shelf.of(held)
        if not files:
            raise InputError("no campaign is chosen", field="campaigns", expected="one or more")
        self._journal.require()

        def work(tell: Tell) -> None:
            tell("reading")
            try:
                laid = lay(self._view.current.model, files, others)
            except (AbbeError, MemoryError) as error:
                self.shelf.refused([*files, *others])
                if isinstance(error, InputError) and error.file:
                    # where the server keeps it says nothing to who dropped it
                    error.file = Path(error.file).name
                raise
            self.shelf.proven([*files, *others])
            with self._tasks.lock:
                self._view.laid = laid
                self._show(self._view.current, laid.notes)
            self._journal.keep(
                who, "campaigns", fitted=names_of(files), held=names_of(others),
                version=self._view.current.path.name,
            )  # fmt: skip
            self._view.findings.compare(tell)

        self._start(files, work)

    def read_again(self, who: str = "") -> None:
        """Read the present version and its campaigns as they lie on the disk now.

        Raises
        ------
        InputError
            Where that cannot be written down, and while something is under way.
        """
        self._journal.require()
        before = self._view.current

        def work(tell: Tell) -> None:
            tell("reading")
            version = ModelVersion.read(before.path, given=before.given)
            if version.model.machine != before.model.machine:
                raise InputError(
                    "is of another machine now: end the workbench, and open it anew",
                    file=before.path,
                )
            laid = lay(version.model, self._view.laid.fitted, self._view.laid.held)
            with self._tasks.lock:
                self._view.versions[self._view.versions.index(before)] = version
                self._view.laid = laid
                self._show(version, laid.notes)
            self._journal.keep(
                who, "read again", version=version.path.name,
                sha256=version.seen.sha256, fitted=names_of(laid.fitted),
            )  # fmt: skip
            if not self._view.empty:
                self._view.findings.compare(tell)

        self._start(self._view.laid.fitted, work)

    def _start(self, files: Sequence[Path], work: Callable[[Tell], None]) -> None:
        stages = expected.comparing(files)
        self._tasks.start("compare", [("reading", 1.0), *stages[1:]], work)


def names_of(files: Sequence[Path]) -> list[str]:
    """Files as the journal calls them."""
    return [path.name for path in files]
