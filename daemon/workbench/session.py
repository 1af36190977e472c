"""A session of the workbench: a model, its campaigns, its versions, and what is known of them."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.screening.what_if import WhatIf
from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from abbe.daemon.answers.inputs import now
from abbe.daemon.answers.model import compare as compare_answer
from abbe.daemon.answers.model import expected_times as expected
from abbe.daemon.answers.model import revise
from abbe.daemon.answers.model.first_fit import fitted_version
from abbe.daemon.answers.typed import Adding
from abbe.daemon.arguments.assignments import split_assignments
from abbe.daemon.config.identity import abbe_version
from abbe.daemon.report.head import file_on_page, head_of
from abbe.daemon.workbench.campaigns.laid import lay
from abbe.daemon.workbench.campaigns.shelf import CampaignShelf
from abbe.daemon.workbench.compared import compared
from abbe.daemon.workbench.learned import learned, sliders, tried, what_if
from abbe.daemon.workbench.residuals.brush import Brush, ManyResiduals
from abbe.daemon.workbench.sentences import sentences_in
from abbe.daemon.workbench.task import Tell, WorkbenchTask
from abbe.daemon.workbench.versions.beside import beside
from abbe.daemon.workbench.versions.folder import ModelVersion, VersionFolder
from abbe.daemon.workbench.versions.journal import WorkbenchJournal
from abbe.daemon.workbench.versions.watched import watched

_ADVICE = "what to measure next"
"""Last stage of a search for causes, which are known by then."""


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
    ) -> None:
        given = load_model(model)
        self._laid = lay(given, campaigns, holdout)
        self._folder = VersionFolder(versions, model)
        self.journal = WorkbenchJournal(self._folder.folder)
        kept = None if versions is None else versions / "campaigns"
        self.shelf = CampaignShelf([*campaigns, *holdout], kept, near)
        first = ModelVersion(model, given, given=True)
        self._versions = [first, *self._folder.earlier(given)]
        self._current = first
        self._said: list[str] = list(self._laid.notes)
        self._lock = threading.RLock()
        self._changes = 0
        self._task: WorkbenchTask | None = None
        self._compared: bytes | None = None
        self._many: ManyResiduals | None = None
        self._learned: bytes | None = None
        self._diagnosis: Diagnosis | None = None
        self._trial: tuple[str, WhatIf] | None = None
        self._beside: tuple[tuple[Any, ...], bytes] | None = None
        if at_once and campaigns:
            self.compare()

    @property
    def empty(self) -> bool:
        """Whether there is no campaign yet that the model is laid beside."""
        return self._laid.campaign is None

    def state(self) -> dict[str, Any]:
        """What every page shows all the time; `changes` counts what has become different."""
        with self._lock:
            task = self._task
            return {
                "changes": self._changes,
                "task": task.as_json() if task is not None and task.running else None,
                "error": "" if task is None else task.error,
                "compared": self._compared is not None,
                "learned": self._learned is not None,
                "empty": self.empty,
                "writes": self._folder.folder is not None,
                "folder": None if self._folder.folder is None else str(self._folder.folder),
                "version": self._current.path.name,
            }

    def head(self) -> dict[str, Any]:
        """Machine, serial number, date, and every file with its SHA-256."""
        current = self._current
        head = head_of(current.model, [file_on_page("model", current.path)], self._laid.campaign)
        held = [file_on_page("campaign, held out", path) for path in self._laid.held]
        return {
            "machine": current.model.machine.name or "Machine",
            "facts": [[name, text] for name, text in head.facts.items()],
            "files": [[f.part, Path(f.file).name, f.sha256] for f in (*head.files, *held)],
            "abbe": abbe_version(),
            "made": now(),
        }

    def compare(self) -> None:
        """Lay the present version beside the campaigns, in a thread."""
        if self.empty:
            return
        self._start("compare", expected.comparing(self._laid.fitted), self._compare)

    def look(self) -> None:
        """The same where it is not known yet and nothing is under way."""
        with self._lock:
            idle = self._task is None or not self._task.running
            if self._compared is None and idle:
                self.compare()

    def campaigns(self) -> dict[str, Any]:
        """Which campaigns there are, and whether what is sent lasts."""
        return {
            "campaigns": self.shelf.listed(self._laid.fitted, self._laid.held),
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
        self.journal.keep(who, "sent", file=path.name, sha256=file_on_page("", path).sha256)
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
        self.journal.require()

        def work(tell: Tell) -> None:
            tell("reading")
            try:
                laid = lay(self._current.model, files, others)
            except (AbbeError, MemoryError):
                self.shelf.refused([*files, *others])
                raise
            self.shelf.proven([*files, *others])
            with self._lock:
                self._laid = laid
                self._show(self._current, list(laid.notes))
            self.journal.keep(
                who, "campaigns", fitted=_named(files), held=_named(others),
                version=self._current.path.name,
            )  # fmt: skip
            self._compare(tell)

        stages = expected.comparing(files)
        self._start("compare", [("reading", 1.0), *stages[1:]], work)

    def note(self, text: str, number: int, who: str) -> None:
        """Keep what a person notes of a version.

        Raises
        ------
        InputError
            For a version that is not there, for nothing, and where it cannot be written.
        """
        with self._lock:
            if not 0 <= number < len(self._versions):
                raise InputError("no such version", field="version", found=number)
            version = self._versions[number].path
        if not text.strip():
            raise InputError("nothing is noted", field="text")
        sha256 = file_on_page("model", version).sha256
        self.journal.keep(who, "note", version=version.name, sha256=sha256, text=text.strip())
        self._changed()

    def beside(self, left: int, right: int) -> bytes:
        """Two versions side by side, as JSON; worked out when it is asked for.

        Raises
        ------
        InputError
            For versions that are not there, and without a campaign.
        """
        laid, campaign = self._laid, self._laid.rows
        with self._lock:
            if not all(0 <= k < len(self._versions) for k in (left, right)):
                raise InputError("no such version", field="version", found=f"{left}, {right}")
            key = (left, right, laid)
            if self._beside is not None and self._beside[0] == key:
                return self._beside[1]
            pair = self._versions[left], self._versions[right]
        for version in pair:
            require_signals(campaign, version.model)
        found = json.dumps(
            beside(*pair, campaign), ensure_ascii=False, allow_nan=False, separators=(",", ":")
        ).encode()
        self._beside = key, found
        return found

    def learn(self) -> None:
        """Diagnose the present version, in a thread; as it is where that is known already."""
        with self._lock:
            if self._learned is None and not self.empty:
                stages = expected.diagnosing(self._laid.fitted)
                self._start("find causes", stages, self._learn)

    def fit(self, who: str = "") -> None:
        """Fit the present version as it is: a new version; `who` for the journal."""
        robust, campaign, held = self._alone, self._laid.rows, self._laid.held

        def made(current: Model, out: Path, tell: Tell) -> tuple[Model, list[str]]:
            model, said = fitted_version(current, campaign, held, out, robust=robust, progress=tell)
            return model, [said]

        self._make("fit", made, who)

    def add(self, spec: str, who: str = "") -> None:
        """Add a cause to the present version and refit: a new version; `who` for the journal.

        Raises
        ------
        InputError
            For a cause that cannot be, where nothing may be written, or something is under way.
        """
        kind, *keys = spec.split() or [spec]
        # what is no effect is said at once, not by a task
        with_effect(self._current.model, kind, split_assignments(keys))
        robust, campaign, held = self._alone, self._laid.rows, self._laid.held

        def made(current: Model, out: Path, tell: Tell) -> tuple[Model, list[str]]:
            changed, effect = with_effect(current, kind, split_assignments(keys))
            revision = revise.revise(
                current, changed, campaign, held, out,
                added=effect.spec, robust=robust, progress=tell,
            )  # fmt: skip
            return revision.model, list(revise.as_text(revision, effect))

        self._make(f"add {spec}", made, who)

    @property
    def _alone(self) -> bool:
        """Whether the diagnosis that is shown left readings out that stand alone."""
        return self._diagnosis is not None and bool(self._diagnosis.strays)

    def go_back(self, number: int, who: str = "") -> None:
        """Look at another version; no file changes but the journal.

        Raises
        ------
        InputError
            For a version that is not there, or while something is under way.
        """
        with self._lock:
            if not 0 <= number < len(self._versions):
                raise InputError("no such version", field="version", found=number)
            self._require_idle()
            before, chosen = self._current.path.name, self._versions[number]
            self.journal.keep(who, "back", version=chosen.path.name, before=before)
            self._show(chosen, [])
            self.compare()

    def compared(self) -> bytes | None:
        """The page *Compare* as JSON; None: not known yet."""
        return self._compared

    def brushed(self, brush: Brush) -> dict[str, Any]:
        """Which of many rows are chosen, where not all of them are drawn.

        Raises
        ------
        InputError
            Where all rows are drawn one by one, and for what is not there.
        """
        many = self._many
        if many is None:
            raise InputError("no rows but those that are drawn", field="brush")
        return many.brushed(brush)

    def learned(self) -> bytes | None:
        """The page *Learn* as JSON; None: not known yet."""
        return self._learned

    def watched(self) -> dict[str, Any]:
        """The page *Watch*."""
        with self._lock:
            return watched(list(self._versions), self._current, self._said, self.journal.entries())

    def tried(self, spec: str, values: Mapping[str, float] | None) -> dict[str, Any]:
        """What a cause would leave at some values of its parameters; None: as it would be fitted.

        Raises
        ------
        InputError
            For a cause that cannot be tried, and for bad values.
        """
        diagnosis = self._diagnosis
        if diagnosis is None:
            raise InputError("causes are not known yet", expected="the end of the diagnosis")
        with self._lock:
            trial = self._trial
        if trial is None or trial[0] != spec or trial[1].basis is not diagnosis.basis:
            trial = (spec, what_if(diagnosis, spec))
            with self._lock:
                self._trial = trial
        answer = tried(trial[1], diagnosis, values)
        if values is None:
            answer |= {
                "sliders": sliders(trial[1]),
                "where": {k: str(v) for k, v in trial[1].effect.where().items()},
            }
        return answer

    def close(self) -> None:
        """End what is under way; give a file's name back that was taken for it."""
        task = self._task
        if task is not None:
            task.stop()
        self._folder.release()
        self.shelf.close()

    def _require_idle(self) -> None:
        """Refuse while something is under way; nobody waits for what to measure next."""
        if self._task is not None and self._task.running and self._task.stage != _ADVICE:
            raise InputError(
                "something is under way", found=self._task.as_json()["what"], expected="its end"
            )

    def _start(self, what: str, stages: Any, work: Callable[[Tell], None]) -> None:
        with self._lock:
            self._require_idle()
            before = self._task

            def after(tell: Tell) -> None:
                if before is not None:
                    before.wait()
                work(tell)

            self._task = WorkbenchTask(what, stages, after, self._changed)
            self._changes += 1
            self._task.start()

    def _changed(self) -> None:
        with self._lock:
            self._changes += 1

    def _show(self, version: ModelVersion, said: list[str]) -> None:
        """Make a version the present one: nothing of the one before counts any more."""
        with self._lock:
            if not self.empty:
                require_signals(self._laid.rows, version.model)
            self._current, self._said = version, said
            self._compared = self._learned = self._diagnosis = self._trial = self._many = None
            self._changes += 1

    def _make(
        self, what: str, made: Callable[[Model, Path, Tell], tuple[Model, list[str]]], who: str
    ) -> None:
        """Make a version in a thread, write that down and look at it."""
        fitted, held = self._laid.fitted, self._laid.held
        if self._folder.folder is None:
            with self._folder.next_file():
                pass
        self.journal.require()
        current = self._current

        def work(tell: Tell) -> None:
            with self._folder.next_file() as out:
                model, said = made(current.model, out, tell)
                version = ModelVersion(out, model)
            sha256 = file_on_page("model", out).sha256
            self.journal.keep(
                who, "made", how=what, version=out.name, sha256=sha256,
                before=current.path.name, fitted=_named(fitted), held=_named(held),
            )  # fmt: skip
            with self._lock:
                self._versions.append(version)
                self._show(version, said)
            self._compare(tell)

        stages = [*expected.adding(fitted), *expected.comparing(fitted)[1:]]
        self._start(what, stages, work)

    def _compare(self, tell: Tell) -> None:
        model, campaign = self._current.model, self._laid.rows
        tell("comparing")
        found = compare_answer.with_changes(model, campaign, compare(model, campaign))
        tell("drawing")
        page, self._many = compared(found)
        self._compared = _bytes(page)

    def _learn(self, tell: Tell) -> None:
        current = self._current
        diagnosis = diagnose(current.model, self._laid.rows, progress=tell)
        tell("noise floor")
        adding = Adding(current.path, list(self._laid.fitted), robust=bool(diagnosis.strays))
        first = _bytes(learned(diagnosis, None, adding))
        with self._lock:
            if self._current is not current:
                return
            self._diagnosis, self._learned = diagnosis, first
            self._changes += 1
        tell(_ADVICE)
        found = _bytes(learned(diagnosis, diagnosis.advice, adding))
        with self._lock:
            if self._diagnosis is diagnosis:
                self._learned = found


def _named(files: Sequence[Path]) -> list[str]:
    """Their names, for the journal."""
    return [path.name for path in files]


def _bytes(answer: Mapping[str, Any]) -> bytes:
    answer = {**answer, "sentences": sentences_in(answer)}
    return json.dumps(answer, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
