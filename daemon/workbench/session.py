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
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from abbe.daemon.answers.inputs import load, now
from abbe.daemon.answers.model import compare as compare_answer
from abbe.daemon.answers.model import expected_times as expected
from abbe.daemon.answers.model import revise
from abbe.daemon.answers.model.first_fit import fitted_version
from abbe.daemon.answers.model.held_out import read_held_out
from abbe.daemon.answers.typed import Adding
from abbe.daemon.arguments.assignments import split_assignments
from abbe.daemon.config.identity import abbe_version
from abbe.daemon.report.head import file_on_page, head_of
from abbe.daemon.workbench.compared import compared
from abbe.daemon.workbench.learned import learned, sliders, tried, what_if
from abbe.daemon.workbench.residuals.brush import Brush, ManyResiduals
from abbe.daemon.workbench.sentences import sentences_in
from abbe.daemon.workbench.task import Tell, WorkbenchTask
from abbe.daemon.workbench.versions import ModelVersion, VersionFolder
from abbe.daemon.workbench.watched import watched


class Workbench:
    """What all pages of one session stand on; may be asked from any thread.

    Parameters
    ----------
    model, campaigns, holdout
        Files, as ``abbe add`` takes them.
    versions
        Folder in which new versions are kept; None: nothing is written.
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
        at_once: bool = True,
    ) -> None:
        self._campaigns, self._holdout = list(campaigns), list(holdout)
        given, self._campaign = load(model, self._campaigns)
        held = read_held_out(self._holdout, given.machine, self._campaign)
        if held is not None:
            require_signals(held.campaign, given)
        self._folder = VersionFolder(versions, model)
        first = ModelVersion(model, given, given=True)
        self._versions = [first, *self._folder.earlier(given)]
        self._current = first
        self._said: list[str] = list(held.notes()) if held is not None else []
        self._lock = threading.RLock()
        self._changes = 0
        self._task: WorkbenchTask | None = None
        self._compared: bytes | None = None
        self._many: ManyResiduals | None = None
        self._learned: bytes | None = None
        self._diagnosis: Diagnosis | None = None
        self._trial: tuple[str, WhatIf] | None = None
        if at_once:
            self.compare()

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
                "writes": self._folder.folder is not None,
                "folder": None if self._folder.folder is None else str(self._folder.folder),
                "version": self._current.path.name,
            }

    def head(self) -> dict[str, Any]:
        """Machine, serial number, date, and every file with its SHA-256."""
        current = self._current
        head = head_of(current.model, [file_on_page("model", current.path)], self._campaign)
        held = [file_on_page("campaign, held out", path) for path in self._holdout]
        return {
            "machine": current.model.machine.name or "Machine",
            "facts": [[name, text] for name, text in head.facts.items()],
            "files": [[f.part, Path(f.file).name, f.sha256] for f in (*head.files, *held)],
            "abbe": abbe_version(),
            "made": now(),
        }

    def compare(self) -> None:
        """Lay the present version beside the campaigns, in a thread."""
        self._start("compare", expected.comparing(self._campaigns), self._compare)

    def look(self) -> None:
        """The same where it is not known yet and nothing is under way."""
        with self._lock:
            if self._compared is None and (self._task is None or not self._task.running):
                self.compare()

    def learn(self) -> None:
        """Diagnose the present version, in a thread; as it is where that is known already."""
        with self._lock:
            if self._learned is None:
                stages = expected.diagnosing(self._campaigns)
                self._start("find causes", stages, self._learn)

    def fit(self) -> None:
        """Fit the present version as it is: a new version."""
        robust = self._alone

        def made(current: Model, out: Path, tell: Tell) -> tuple[Model, list[str]]:
            model, said = fitted_version(
                current, self._campaign, self._holdout, out, robust=robust, progress=tell
            )
            return model, [said]

        self._make("fit", made)

    def add(self, spec: str) -> None:
        """Add a cause to the present version and refit: a new version.

        Raises
        ------
        InputError
            For a cause that cannot be, where nothing may be written, or something is under way.
        """
        kind, *keys = spec.split() or [spec]
        # what is no effect is said at once, not by a task
        with_effect(self._current.model, kind, split_assignments(keys))
        robust = self._alone

        def made(current: Model, out: Path, tell: Tell) -> tuple[Model, list[str]]:
            changed, effect = with_effect(current, kind, split_assignments(keys))
            revision = revise.revise(
                current, changed, self._campaign, self._holdout, out,
                added=effect.spec, robust=robust, progress=tell,
            )  # fmt: skip
            return revision.model, list(revise.as_text(revision, effect))

        self._make(f"add {spec}", made)

    @property
    def _alone(self) -> bool:
        """Whether the diagnosis that is shown left readings out that stand alone."""
        return self._diagnosis is not None and bool(self._diagnosis.strays)

    def go_back(self, number: int) -> None:
        """Look at another version; no file changes.

        Raises
        ------
        InputError
            For a version that is not there, or while something is under way.
        """
        with self._lock:
            if not 0 <= number < len(self._versions):
                raise InputError("no such version", field="version", found=number)
            self._require_idle()
            self._show(self._versions[number], [])
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
            return watched(list(self._versions), self._current, self._said)

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

    def _require_idle(self) -> None:
        if self._task is not None and self._task.running:
            raise InputError(
                "something is under way", found=self._task.as_json()["what"], expected="its end"
            )

    def _start(self, what: str, stages: Any, work: Callable[[Tell], None]) -> None:
        with self._lock:
            self._require_idle()
            self._task = WorkbenchTask(what, stages, work, self._changed)
            self._changes += 1
            self._task.start()

    def _changed(self) -> None:
        with self._lock:
            self._changes += 1

    def _show(self, version: ModelVersion, said: list[str]) -> None:
        """Make a version the present one: nothing of the one before counts any more."""
        with self._lock:
            require_signals(self._campaign, version.model)
            self._current, self._said = version, said
            self._compared = self._learned = self._diagnosis = self._trial = self._many = None
            self._changes += 1

    def _make(
        self, what: str, made: Callable[[Model, Path, Tell], tuple[Model, list[str]]]
    ) -> None:
        """Make a version in a thread and look at it."""
        if self._folder.folder is None:
            with self._folder.next_file():
                pass
        current = self._current

        def work(tell: Tell) -> None:
            with self._folder.next_file() as out:
                model, said = made(current.model, out, tell)
                version = ModelVersion(out, model)
            with self._lock:
                self._versions.append(version)
                self._show(version, said)
            self._compare(tell)

        stages = [*expected.adding(self._campaigns), *expected.comparing(self._campaigns)[1:]]
        self._start(what, stages, work)

    def _compare(self, tell: Tell) -> None:
        model, campaign = self._current.model, self._campaign
        tell("comparing")
        found = compare_answer.with_changes(model, campaign, compare(model, campaign))
        tell("drawing")
        page, self._many = compared(found)
        self._compared = _bytes(page)

    def _learn(self, tell: Tell) -> None:
        current = self._current
        diagnosis = diagnose(current.model, self._campaign, progress=tell)
        tell("noise floor")
        adding = Adding(current.path, self._campaigns, robust=bool(diagnosis.strays))
        first = _bytes(learned(diagnosis, None, adding))
        with self._lock:
            self._diagnosis, self._learned = diagnosis, first
            self._changes += 1
        tell("what to measure next")
        self._learned = _bytes(learned(diagnosis, diagnosis.advice, adding))


def _bytes(answer: Mapping[str, Any]) -> bytes:
    answer = {**answer, "sentences": sentences_in(answer)}
    return json.dumps(answer, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
