"""The guide through a calibration as the page *Calibrate* shows it, and the step that is done."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.plan_file import PlannedWork, read_plan
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.sentences import said, sentences_in
from abbe.compcore.verification.verdict import VerdictOutcome
from abbe.daemon.arguments.plan_arguments import seconds_of
from abbe.daemon.calibration.request import CalibrationRequest, require_measured_with
from abbe.daemon.calibration.state import CalibrationState, at_the_wall, make_folder
from abbe.daemon.calibration.step import CERTIFICATE, CHECK_PLAN, PLAN, TABLES, StepNow
from abbe.daemon.config import Configuration
from abbe.daemon.measure.events import minutes, setup_words
from abbe.daemon.report.language import language as known_language
from abbe.daemon.report.measurements.survey import picture
from abbe.daemon.report.pictures.still import still
from abbe.daemon.workbench.calibration.asked import AskedCalibration
from abbe.daemon.workbench.calibration.step_process import StepProcess, step_json
from abbe.daemon.workbench.fresh import FreshConfiguration
from abbe.daemon.workbench.tables.desk import TableDesk

MEASURES = frozenset({"measure", "check"})
"""Steps that need the machine and its instruments: they take the role ``operate``."""
_UPLOAD = "upload"
"""The step that writes to the controller: looked at first, then done by a desk for tables."""
_PLANS = {"plan": PLAN, "check": CHECK_PLAN}
"""Step → the file of its plan."""


class CalibrationGuide:
    """The calibration in one folder; may be asked from any thread.

    Parameters
    ----------
    config
        The machine's configuration; read anew for each answer.
    folder
        As ``abbe calibrate --folder``.
    steps_now
        The steps as they stand; handed in, because the workbench stands below the commands.
    child
        Module that does one step in a process of its own.

    Raises
    ------
    InputError
        For a configuration with nothing to measure with, and a folder of another one.
    """

    def __init__(
        self,
        config: Path,
        folder: Path,
        steps_now: Callable[[CalibrationRequest], Sequence[StepNow]],
        child: str,
    ) -> None:
        self.config, self._folder = config, folder
        self._steps_now, self._child = steps_now, child
        self._fresh = FreshConfiguration(config)
        self._asked = AskedCalibration()
        self._lock = threading.Lock()
        self._process: StepProcess | None = None
        self._desk: TableDesk | None = None
        self._uploaded_last = False
        configuration = self._fresh.now()
        require_measured_with(configuration)
        self._steps_now(self._request(configuration))
        kept = CalibrationState.read(folder, config).asked
        if kept:
            self._asked = AskedCalibration.kept(kept)

    def _request(self, configuration: Configuration) -> CalibrationRequest:
        asked = self._asked
        return CalibrationRequest(
            configuration, self._folder, asked.time, asked.check_time, asked.tools,
            asked.controller, asked.tables, yes=False,
        )  # fmt: skip

    def shown(self) -> dict[str, Any]:
        """The page."""
        request = self._request(self._fresh.now())
        steps = self._steps_now(request)
        asked = self._asked
        plans = {key: self._setups(request, name) for key, name in _PLANS.items()}
        http = request.configuration.http
        return {
            "folder": str(self._folder),
            "asked": asked.words(),
            "steps": list(self._steps(steps)),
            "plans": plans,
            "sentences": sentences_in(plans),
            **self._outcome(request),
            "certificate": request.file(CERTIFICATE).is_file(),
            "roles": http is not None and http.tokens.exists(),
            "work": self._work_now(),
        }

    def _outcome(self, request: CalibrationRequest) -> dict[str, Any]:
        """How the check came out, in words; of a calibration whose steps are done."""
        outcome = CalibrationState.read(self._folder, self.config).outcome("verify")
        good = bool(request.checked_by) and outcome.startswith(VerdictOutcome.VERIFIED.value)
        return {"verified": good, "outcome": outcome}

    def ask_for(self, asked: AskedCalibration) -> None:
        """Ask for something else; steps that were done stay done where their files fit.

        It is kept in the folder: whoever goes on with this calibration asks for the same.

        Raises
        ------
        InputError
            For a time that is none, while a step is under way, and where it cannot be written.
        """
        seconds_of(asked.time)
        seconds_of(asked.check_time, "check-time")
        with self._lock:
            self._require_idle()
            make_folder(self._folder)
            CalibrationState.read(self._folder, self.config).ask_for(asked.words())
            self._asked = replace(asked)

    def start(self, name: str, who: str, language: str = "en") -> None:
        """Do the next step.

        Parameters
        ----------
        name
            The step that the person means.
        who
            For the state; may be empty.
        language
            Of the certificate.

        Raises
        ------
        InputError
            Where there is no such language, that is not the next step, is not done here, or one is
            under way.
        """
        known_language(language)
        with self._lock:
            self._require_idle()
            request = self._request(self._fresh.now())
            coming = next((s.step.name for s in self._steps_now(request) if not s.at), None)
            if name != coming:
                raise InputError(
                    "is not the next step", field="step", found=name, expected=coming or "none"
                )
            if name == _UPLOAD:
                raise InputError(
                    "writes to the controller",
                    field="step",
                    found=name,
                    expected="a pre-flight, and what it says looked at",
                )
            asked = self._asked
            self._uploaded_last = False
            self._process = StepProcess(
                self._child,
                {
                    "config": str(self.config), "folder": str(self._folder), "step": name,
                    "time": asked.time, "check_time": asked.check_time,
                    "tools": list(asked.tools), "controller": asked.controller,
                    "tables": asked.tables, "by": who, "language": language,
                }
            )  # fmt: skip

    def desk(self) -> TableDesk:
        """The desk for the tables of this calibration, while they are what comes next.

        Raises
        ------
        InputError
            Where the step `upload` is not the next one.
        """
        with self._lock:
            request = self._request(self._fresh.now())
            coming = next((s.step.name for s in self._steps_now(request) if not s.at), None)
            if coming != _UPLOAD and (self._desk is None or not self._desk.busy):
                raise InputError(
                    "is not the next step", field="step", found=_UPLOAD, expected=coming or "none"
                )
            if self._desk is None:
                self._desk = TableDesk(self.config, request.file(TABLES), self._uploaded)
            return self._desk

    @property
    def known_desk(self) -> TableDesk | None:
        """The same where anybody has asked for it."""
        return self._desk

    def _uploaded(self, who: str) -> None:
        """Record that the tables are active, as the command does."""
        request = self._request(self._fresh.now())
        self._uploaded_last = True
        for now in self._steps_now(request):
            if now.step.name == _UPLOAD and not now.at:
                state = CalibrationState.read(self._folder, self.config)
                state.note(_UPLOAD, now.step.made_from, who, now.step.settings)

    def answer(self, word: str) -> None:
        """Answer what the step asks; raises `InputError` where that is not asked."""
        if self._process is None or not self._process.answer(word):
            raise InputError("is not asked", field="answer", found=word)

    def stop(self) -> None:
        """Have the step end in an orderly way."""
        if self._process is not None and self._process.running:
            self._process.stop()

    def close(self) -> None:
        """End the step that is under way; what was measured is kept, an upload waited for."""
        if self._desk is not None:
            self._desk.close()
        if self._process is not None:
            self._process.close()

    def picture(self, key: str, number: int) -> str:
        """A set-up of a plan as a drawing, SVG.

        Raises
        ------
        InputError
            Where there is no such plan or set-up.
        """
        request = self._request(self._fresh.now())
        plan = _PLANS.get(key)
        work = self._work(request, plan) if plan is not None else None
        if work is None or not 0 <= number < len(work.setups):
            raise InputError("no such set-up", field="number", found=number)
        model = request.configuration.model
        return still(picture(SurveyTask(model, work.space), work.setups[number]))

    def certificate(self) -> bytes:
        """The certificate's page; raises `InputError` where it is not there."""
        path = self._request(self._fresh.now()).file(CERTIFICATE)
        try:
            return path.read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", file=path) from None

    def _require_idle(self) -> None:
        busy = self._process.step if self._process is not None and self._process.running else ""
        if self._desk is not None and self._desk.busy:
            busy = _UPLOAD
        if busy:
            raise InputError("a step is under way", found=busy, expected="its end")

    def _work_now(self) -> dict[str, Any] | None:
        """What is under way or was done last, as `StepProcess.as_json` has it."""
        if self._desk is not None and self._uploaded_last:
            work = self._desk.state()["work"]
            lines, ended = list(work["said"]), work["ended"]
            return step_json(_UPLOAD, lines) | {"ended": ended}
        return None if self._process is None else self._process.as_json()

    def _steps(self, steps: Sequence[StepNow]) -> Iterator[dict[str, Any]]:
        running = self._process.step if self._process and self._process.running else ""
        waits = False
        for now in steps:
            name = now.step.name
            state = "running" if name == running else "done" if now.at else "next"
            yield {
                "name": name,
                "title": now.step.title,
                "state": "waits" if state == "next" and waits else state,
                "at": at_the_wall(now.at) if now.at else "",
                "by": now.note,
                "makes": [path.name for path in now.step.makes],
                "role": name in MEASURES,
                "writes": name == _UPLOAD,
            }
            waits = waits or not now.at

    @staticmethod
    def _work(request: CalibrationRequest, name: str) -> PlannedWork | None:
        path = request.file(name)
        return read_plan(path, request.configuration.model.machine) if path.is_file() else None

    def _setups(self, request: CalibrationRequest, name: str) -> list[dict[str, str]]:
        """The set-ups of a plan, for people; none where it is not there or cannot be read."""
        try:
            work = self._work(request, name)
        except AbbeError:
            work = None
        return [
            {
                "name": setup.name,
                "words": said(
                    "{setup}; {n} targets, {time}",
                    setup=setup_words(setup),
                    n=setup.count,
                    time=minutes(setup.seconds),
                ),
            }
            for setup in (work.setups if work is not None else ())
        ]
