"""The check of a calibration judged: the certificate, and whether anything may go on from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.model_file import load_model
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.planning.worth import corrected_and_unsure
from abbe.compcore.sentences import joined, said
from abbe.compcore.units import in_digits
from abbe.compcore.verification.verdict import VerdictOutcome, check_verdict
from abbe.compcore.verification.verify import Verification
from abbe.daemon.answers.measurements import verify as answer
from abbe.daemon.answers.measurements.verified_files import (
    NamedModel,
    VerifiedFiles,
    fitted_campaigns,
)
from abbe.daemon.answers.typed import uploading
from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.calibration.step import (
    CALIBRATED,
    CAMPAIGN,
    CERTIFICATE,
    CHECK,
    CHECK_PLAN,
    TABLES,
)
from abbe.daemon.commands.measurements.verify import judge
from abbe.daemon.report.language import ENGLISH, language

_WAYS_ON = said(
    "Measure more (--time) or otherwise, or say no to what was added last: the certificate shows "
    "where it fails"
)
NOTHING_CHECKED = said(
    "{outcome}: {why}",
    outcome=said("not verified"),
    why=said("no line was measured that was not fitted"),
)


def judge_check(
    request: CalibrationRequest,
    active: Path | None,
    stated: Mapping[str, str],
    left_out: str,
    say: Callable[[str], None],
) -> str:
    """Write the certificate and say how the check came out.

    Parameters
    ----------
    active
        The model whose tables acted while the check was measured; None: none did.
    stated
        Tolerances and lengths' limit, as `CalibrationRequest.stated` has them.
    left_out
        Causes that are established and not in the model, and why, for the certificate; or empty.

    Raises
    ------
    AbbeError
        Where the machine is worse after than before, or a stated tolerance is surely not kept.
    """
    calibrated, page = request.file(CALIBRATED), request.file(CERTIFICATE)
    campaign, plan = request.file(CAMPAIGN), request.file(CHECK_PLAN)
    named = NamedModel(load_model(calibrated), calibrated, request.config)
    tables = request.file(TABLES) if active is not None else None
    files = VerifiedFiles(
        (request.file(CHECK),), active=active, check=plan, tables=tables, fitted=(campaign,)
    )
    known = fitted_campaigns(named, files.fitted)

    def doubt(found: Verification) -> str:
        if found.lines or check_verdict(found).outcome is not VerdictOutcome.VERIFIED:
            return ""
        return less_sure_than_corrected(request)

    done = judge(
        named, known, files, stated.get("tolerance", "").split(), stated.get("mpe") or None, page,
        notes=(left_out,) if left_out else (), doubt=doubt,
        language=request.language or stated.get("language", "en"),
    )  # fmt: skip
    # the page of a step's lines says them in its own language
    spoken = ENGLISH if request.as_json else request.language or ENGLISH
    for line in answer.as_text(done, language(spoken).say):
        say(line)
    say(said("written: {files}", files=page))
    verdict = check_verdict(done.verification)
    if verdict.outcome is VerdictOutcome.WORSE:
        back = (
            said(
                "the tables act: {command} takes them back",
                command=f"{uploading(request.config)} --rollback",
            )
            if active is not None
            else said("nothing is written for abbe run")
        )
        why = joined(verdict.reasons)
        raise AbbeError(said("the check does not pass: {why}; {then}. {ways}", why=why, then=back,
                             ways=_WAYS_ON))  # fmt: skip
    if verdict.outcome is VerdictOutcome.OPEN and active is not None:
        say(
            said(
                "the tables act, and the check does not show that they help everywhere: {command} "
                "takes them back",
                command=f"{uploading(request.config)} --rollback",
            )
        )
    return verdict.text


def less_sure_than_corrected(request: CalibrationRequest) -> str:
    """That a calibrated model is less sure over the travels than what it corrects; else empty."""
    task = SurveyTask(load_model(request.file(CALIBRATED)), tools=request.offsets)
    corrected, unsure = corrected_and_unsure(task)
    if unsure <= corrected:
        return ""
    return said(
        "over its travels the model corrects {size} and is unsure by {sd}: what no set-up "
        "showed is not known",
        size=f"{in_digits(corrected * 1e3)} µm", sd=f"{in_digits(unsure * 1e3)} µm",
    )  # fmt: skip


def live_words(outcome: str, left_out: str = "") -> tuple[str, ...]:
    """What a configuration for `abbe run` says at its top of the check of its model.

    `left_out` as of `judge_check`.
    """
    title = outcome.partition(":")[0].upper()
    now = datetime.now(UTC).isoformat(timespec="minutes")
    first = f"{title}. Written by abbe calibrate, {now}."
    return (first, outcome, left_out) if left_out else (first, outcome)
