"""The guide through a calibration: step after step, from where it was left."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.sentences import as_it_stands, said
from abbe.daemon.calibration.asking import AskPerson
from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.calibration.state import (
    CalibrationState,
    at_the_wall,
    make_folder,
    one_at_a_time,
)
from abbe.daemon.calibration.step import (
    CHECK_TARGETS,
    LIVE,
    NOT_VERIFIED,
    TARGETS,
    StepNow,
)
from abbe.daemon.commands.calibration.judging import NOTHING_CHECKED
from abbe.daemon.commands.calibration.steps import steps_of


def steps_now(request: CalibrationRequest) -> list[StepNow]:
    """Every step of a calibration, and whether it is done; changes nothing.

    Raises
    ------
    InputError
        As `CalibrationState.read`.
    """
    state = CalibrationState.read(request.folder, request.config)
    found = []
    for step in steps_of(request, state, lambda _: None, _nobody):
        done = state.done(step.name, step.made_from, step.makes, step.settings)
        record = state.steps[step.name] if done else None
        found.append(StepNow(step, record.at if record else "", record.note if record else ""))
    return found


def _nobody(question: str, *, default: bool = True) -> bool:
    del question, default
    return False


def left_out_of(request: CalibrationRequest) -> str:
    """Causes that are established and were left out of the model, and why; or empty."""
    return CalibrationState.read(request.folder, request.config).outcome("diagnose")


def outcome_of(request: CalibrationRequest) -> str:
    """How the check of a calibration came out, in a word: ``verified``, ``not verified``."""
    state = CalibrationState.read(request.folder, request.config)
    return (state.outcome("verify") or NOTHING_CHECKED).partition(":")[0]


def calibrate(
    request: CalibrationRequest, say: Callable[[str], None], ask: AskPerson, upto: str = ""
) -> bool:
    """Go through all steps that are not done; whether all are.

    Parameters
    ----------
    say, ask
        Tell a line; ask yes or no.
    upto
        The step after which to stop; empty: none.

    Raises
    ------
    InputError
        For a step that there is not, a folder that cannot be made, and where somebody else does a
        step of the same calibration.
    AbbeError
        When a step cannot be done; those before it stay done.
    """
    state = CalibrationState.read(request.folder, request.config)
    names = [step.name for step in steps_of(request, state, say, ask)]
    if upto and upto not in names:
        raise InputError("no such step", field="upto", found=upto, expected=", ".join(names))
    make_folder(request.folder)
    with one_at_a_time(request.folder):
        return _through(request, say, ask, upto)


def _through(
    request: CalibrationRequest, say: Callable[[str], None], ask: AskPerson, upto: str
) -> bool:
    state = CalibrationState.read(request.folder, request.config)
    every = list(steps_of(request, state, say, ask))
    names = [step.name for step in every]
    later = map(request.file, (TARGETS, CHECK_TARGETS, LIVE, NOT_VERIFIED))
    state.begin(chain(later, *(step.makes for step in every)))
    for number in range(1, len(names) + 1):
        # anew: a step may hang on what came out of those before it
        step = list(steps_of(request, state, say, ask))[number - 1]
        # its name as --upto takes it, in every language
        which = f"{number}/{len(names)} {step.name}"
        title = said("{step}: {what}", step=which, what=as_it_stands(step.title))
        if state.done(step.name, step.made_from, step.makes, step.settings):
            say(said("{title}: done {at}", title=title, at=at_the_wall(state.steps[step.name].at)))
        else:
            if not ask(said("{title}. Go on?", title=title)):
                say(said("stopped; the same command goes on here"))
                return False
            say(title)
            lacking = [path for path in step.made_from if not path.exists()]
            if lacking:
                raise AbbeError(
                    said("{step} needs {file}, which is not there", step=step.name, file=lacking[0])
                )
            try:
                outcome = step.run() or ""
            except BaseException:
                say(
                    said(
                        "{step} is not done; the steps before it are, and what it has written "
                        "stays: the same command goes on here",
                        step=step.name,
                    )
                )
                raise
            state.note(step.name, step.made_from, request.by, step.settings, outcome)
        if step.name == upto:
            return False
    return True
