"""The session that all pages of a workbench stand on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from abbe.compcore.sentences import sentences_in
from abbe.daemon.answers.model import expected_times as expected
from abbe.daemon.workbench.campaigns.laid import lay
from abbe.daemon.workbench.campaigns.shelf import CampaignShelf
from abbe.daemon.workbench.session.findings import ADVICE, VersionFindings
from abbe.daemon.workbench.session.head import session_head
from abbe.daemon.workbench.session.laying import LayingCampaigns, names_of
from abbe.daemon.workbench.session.making import Making, adding, fitting
from abbe.daemon.workbench.session.origin import FromStore
from abbe.daemon.workbench.session.task import Tell
from abbe.daemon.workbench.session.tasks import SessionTasks
from abbe.daemon.workbench.session.view import SessionView
from abbe.daemon.workbench.versions.beside import SideBySide
from abbe.daemon.workbench.versions.folder import ModelVersion, VersionFolder
from abbe.daemon.workbench.versions.journal import WorkbenchJournal
from abbe.daemon.workbench.versions.seen_file import SeenFile
from abbe.daemon.workbench.versions.watched import watched


class Workbench:
    """What all pages of one session stand on; may be asked from any thread.

    Parameters
    ----------
    model, campaigns, holdout
        Files, as ``abbe add`` takes them; there may be none, until somebody chooses some.
    versions
        Folder in which new versions, what the browser sends and the journal are kept; None: nothing
        is written for longer than the session.
    near
        Folders whose campaigns may be chosen as well.
    at_once
        Whether to compare now; else when somebody looks.
    origin
        Where model and campaigns were taken from; None: they are the person's own files.

    Raises
    ------
    InputError
        For bad files.
    """

    def __init__(
        self,
        model: Path,
        campaigns: Sequence[Path],
        holdout: Sequence[Path] = (),
        versions: Path | None = None,
        *,
        near: Sequence[Path] = (),
        at_once: bool = True,
        origin: FromStore | None = None,
    ) -> None:
        self._origin = origin
        first = ModelVersion.read(model, given=True)
        given = first.model
        laid = lay(given, campaigns, holdout)
        self._folder = VersionFolder(versions, model)
        self.journal = WorkbenchJournal(self._folder.folder)
        kept = None if versions is None else versions / "campaigns"
        shelf = CampaignShelf([*campaigns, *holdout], kept, near)
        self._view = SessionView([first, *self._folder.earlier(given)], laid)
        self._side_by_side = SideBySide()
        self._tasks = SessionTasks(ADVICE)
        self.campaigns = LayingCampaigns(shelf, self._view, self._tasks, self.journal, self._show)
        if at_once and campaigns:
            self.compare()

    @property
    def empty(self) -> bool:
        """Whether there is no campaign yet that the model is laid beside."""
        return self._view.empty

    @property
    def findings(self) -> VersionFindings:
        """What is known of the present version."""
        return self._view.findings

    def state(self) -> dict[str, Any]:
        """What every page shows all the time; `changes` counts what has become different."""
        tasks = self._tasks
        with tasks.lock:
            findings = self.findings
            return {
                "changes": tasks.changes,
                "task": tasks.as_json(),
                "error": tasks.error,
                "sentences": sentences_in(tasks.error),
                "compared": findings.compared is not None,
                "learned": findings.learned is not None,
                "empty": self.empty,
                "writes": self._folder.folder is not None,
                "folder": None if self._folder.folder is None else str(self._folder.folder),
                "version": self._view.current.path.name,
                "stands_on": self._view.stands_on,
                "differ": [seen.path.name for seen in self._view.seen if seen.differs],
                "take_out": "" if self._origin is None else self._origin.take_out,
            }

    def head(self) -> dict[str, Any]:
        """Machine, serial number, date, and every file with its SHA-256."""
        return session_head(self._view.current, self._view.laid, self._origin)

    def compare(self) -> None:
        """Lay the present version beside the campaigns, in a thread."""
        if self.empty:
            return
        stages = expected.comparing(self._view.laid.fitted)
        self._tasks.start("compare", stages, lambda tell: self.findings.compare(tell))

    def look(self) -> None:
        """The same where it is not known yet and nothing is under way."""
        with self._tasks.lock:
            if self.findings.compared is None and self._tasks.idle:
                self.compare()

    def note(self, text: str, number: int, who: str) -> None:
        """Keep what a person notes of a version.

        Raises
        ------
        InputError
            For a version that is not there, for nothing, and where it cannot be written.
        """
        with self._tasks.lock:
            version = self._view.version(number).seen
        self.journal.note(who, version, text)
        self._tasks.changed()

    def beside(self, left: int, right: int) -> bytes:
        """Two versions side by side, as JSON; worked out when it is asked for.

        Raises
        ------
        InputError
            For versions that are not there, and without a campaign.
        """
        with self._tasks.lock:
            pair, laid = (self._view.version(left), self._view.version(right)), self._view.laid
        return self._side_by_side.answer(*pair, laid)

    def learn(self) -> None:
        """Diagnose the present version, in a thread; as it is where that is known already."""
        with self._tasks.lock:
            if self.findings.learned is None and not self.empty:
                stages = expected.diagnosing(self._view.laid.fitted)
                self._tasks.start("find causes", stages, self._learn)

    def fit(self, who: str = "", on: str = "") -> None:
        """Fit the present version as it is: a new version; `who` and `on` as `add` has them."""
        with self._tasks.lock:
            self._view.require_seen(on)
            self._make("fit", fitting(self._view.laid, robust=self.findings.strays), who)

    def add(self, spec: str, who: str = "", on: str = "") -> None:
        """Add a cause to the present version and refit: a new version.

        Parameters
        ----------
        spec
            The cause.
        who
            For the journal.
        on
            What the page stood on where it was clicked, as `state` says it; empty: not stated.

        Raises
        ------
        InputError
            For a cause that cannot be, where nothing may be written, something is under way, or
            somebody else has changed meanwhile what is looked at.
        """
        with self._tasks.lock:
            self._view.require_seen(on)
            made = adding(
                self._view.current.model, spec, self._view.laid, robust=self.findings.strays
            )
            self._make(f"add {spec}", made, who)

    def go_back(self, number: int, who: str = "") -> None:
        """Look at another version; no file changes but the journal.

        Raises
        ------
        InputError
            For a version that is not there, or while something is under way.
        """
        with self._tasks.lock:
            chosen, before = self._view.version(number), self._view.current.path.name
            self._tasks.require_idle()
            self.journal.keep(who, "back", version=chosen.path.name, before=before)
            self._show(chosen, [])
            self.compare()

    def watched(self) -> dict[str, Any]:
        """The page *Watch*."""
        with self._tasks.lock:
            return watched(
                list(self._view.versions),
                self._view.current,
                self._view.said,
                self.journal.entries(),
            )

    def close(self) -> None:
        """End what is under way; give a file's name back that was taken for it."""
        self._tasks.stop()
        self._folder.release()
        self.campaigns.shelf.close()

    def _show(self, version: ModelVersion, said: Sequence[str]) -> None:
        """Look at a version, and tell all windows."""
        with self._tasks.lock:
            self._view.show(version, said)
            self._tasks.changes += 1

    def _make(self, what: str, made: Making, who: str) -> None:
        """Make a version in a thread, write that down and look at it."""
        fitted, held = self._view.laid.fitted, self._view.laid.held
        if self._folder.folder is None:
            with self._folder.next_file():
                pass
        self.journal.require()
        current = self._view.current

        def work(tell: Tell) -> None:
            with self._folder.next_file() as out:
                model, said = made(current.model, out, tell)
                version = ModelVersion(out, model, SeenFile(out))
            sha256 = version.seen.sha256
            self.journal.keep(
                who, "made", how=what, version=out.name, sha256=sha256,
                before=current.path.name, fitted=names_of(fitted), held=names_of(held),
            )  # fmt: skip
            with self._tasks.lock:
                self._view.versions.append(version)
                self._show(version, said)
            self.findings.compare(tell)

        stages = [*expected.adding(fitted), *expected.comparing(fitted)[1:]]
        self._tasks.start(what, stages, work)

    def _learn(self, tell: Tell) -> None:
        self.findings.learn(tell, self._tasks.changed)
