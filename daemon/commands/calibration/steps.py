"""The steps of a calibration: each calls the command of its name, on files of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.sentences import said
from abbe.compcore.verification.verdict import VerdictOutcome
from abbe.daemon.calibration.asking import AskPerson
from abbe.daemon.calibration.live_configuration import kept_model, write_live_configuration
from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.calibration.state import CalibrationState
from abbe.daemon.calibration.step import (
    CALIBRATED,
    CAMPAIGN,
    CERTIFICATE,
    CHECK,
    CHECK_PLAN,
    CHECK_PROGRAM,
    CHECK_READINGS,
    CHECK_TARGETS,
    CHECK_VISITS,
    FITTED,
    LIVE,
    MODEL,
    NOT_VERIFIED,
    PLAN,
    PROGRAM,
    READINGS,
    TABLES,
    TARGETS,
    VISITS,
    CalibrationStep,
)
from abbe.daemon.commands.calibration.acting_tables import require_acting
from abbe.daemon.commands.calibration.diagnosing import complete_model
from abbe.daemon.commands.calibration.files_matched import (
    match_readings,
    placed_in,
    write_targets,
)
from abbe.daemon.commands.calibration.judging import (
    NOTHING_CHECKED,
    judge_check,
    less_sure_than_corrected,
    live_words,
)


def steps_of(
    request: CalibrationRequest, state: CalibrationState, say: Callable[[str], None], ask: AskPerson
) -> Iterator[CalibrationStep]:
    """The steps of a calibration in their order."""
    yield from _measured(request, state, say, ask)
    yield from _modelled(request, state, say, ask)
    if request.tables:
        yield from _applied(request, say)
    if request.checked_by:
        yield from _verified(request, state, say, ask)
    if not request.tables and request.corrected_live:
        yield _live(request, state, say)


def _measured(
    request: CalibrationRequest, state: CalibrationState, say: Callable[[str], None], ask: AskPerson
) -> Iterator[CalibrationStep]:
    file = request.file
    model, plan_file, campaign = file(MODEL), file(PLAN), file(CAMPAIGN)

    def start() -> None:
        from abbe.compcore.files.model_file import load_model, save_model
        from abbe.compcore.model.start_model import StartOptions, start_model

        loaded = load_model(request.model)
        if not loaded.effects:
            rotary = bool(loaded.machine.structure.rotary)
            only = request.holds_positioning_only(loaded.machine)
            options = StartOptions(play=True, rotary_motions=rotary, positioning_only=only)
            loaded = start_model(loaded.machine, options)
        save_model(loaded, model)

    yield CalibrationStep("start", "the model to begin with", (request.model,), (model,), start)

    def planned() -> None:
        from abbe.daemon.commands.measurements.plan import plan

        plan(
            model, instruments=request.instruments, time=request.time, out=plan_file,
            tool=list(request.tools), plate=request.plate,
            gauge=request.gauge if request.touches != "ball-plate" else None,
            along_axes=request.along_axes,
            table_radius=request.radii[0], tool_radius=request.radii[1],
        )  # fmt: skip
        if request.by_file:
            write_targets(plan_file, model, file(TARGETS))

    made_from = tuple(p for p in (model, request.plate, request.gauge) if p is not None)
    yield CalibrationStep("plan", "which measurements", made_from, (plan_file,), planned)
    yield from _program(request, state, "program", plan_file, file(PROGRAM), model)

    visits = file(VISITS) if request.by_file else campaign

    def measured() -> None:
        _measure(request, plan_file, visits, None, _program_settings(request, state, "program"))

    yield CalibrationStep("measure", "measuring", (plan_file,), (visits,), measured)
    if request.by_file:
        yield _readings(request, say, ask, "readings", (visits, file(READINGS), campaign))


def _program(
    request: CalibrationRequest,
    state: CalibrationState,
    name: str,
    plan_file: Path,
    out: Path,
    model: Path,
) -> Iterator[CalibrationStep]:
    settings = _program_settings(request, state, name)

    def made() -> None:
        from abbe.daemon.commands.measurements.program import program

        program(
            plan_file, controller=request.controller, out=out, model=model,
            feed=float(settings["feed"]),
            stands=float(settings["stands"]) if settings["stands"] else None,
        )  # fmt: skip

    if request.controller and not request.touches:
        yield CalibrationStep(name, "the program of it", (plan_file,), (out,), made, settings)


def _program_settings(
    request: CalibrationRequest, state: CalibrationState, name: str
) -> dict[str, str]:
    """How the program of a step is made, or was where nothing else is asked for."""
    record = state.steps.get(name)
    return request.program_settings(None if record is None else record.settings)


def _readings(
    request: CalibrationRequest,
    say: Callable[[str], None],
    ask: AskPerson,
    name: str,
    paths: tuple[Path, Path, Path],
) -> CalibrationStep:
    """The instrument's files matched: `paths` of the targets, of its files, of the campaign."""
    visits, folder, out = paths

    def matched() -> None:
        model = request.file(MODEL)
        match_readings(visits, model, folder, out, say, None if request.yes else ask)

    title = "the files of its instrument matched"
    return CalibrationStep(name, title, (visits, *placed_in(folder)), (out,), matched)


def _modelled(
    request: CalibrationRequest, state: CalibrationState, say: Callable[[str], None], ask: AskPerson
) -> Iterator[CalibrationStep]:
    file = request.file
    model, campaign = file(MODEL), file(CAMPAIGN)
    fitted, calibrated = file(FITTED), file(CALIBRATED)

    def fit_all() -> None:
        from abbe.daemon.commands.model.fit import fit

        fit(model, [campaign], out=fitted, cautious=True)

    yield CalibrationStep("fit", "the model fitted", (model, campaign), (fitted,), fit_all)

    def diagnosed() -> str:
        return complete_model(fitted, campaign, calibrated, say, ask)

    record = state.steps.get("diagnose")
    settings = {} if record is None else dict(record.settings)
    if record is not None and record.outcome and not request.yes:
        # what nobody was there to be asked is asked now, once
        settings = {"asked": "somebody"}
    yield CalibrationStep(
        "diagnose", "what is missing", (fitted, campaign), (calibrated,), diagnosed, settings
    )


def _applied(request: CalibrationRequest, say: Callable[[str], None]) -> Iterator[CalibrationStep]:
    calibrated, tables = request.file(CALIBRATED), request.file(TABLES)
    record = tables / "abbe-tables.json"

    def made() -> None:
        from abbe.daemon.commands.tables.table import table

        table(
            calibrated, controller=request.tables, out=tables, tool=_tool(request.tools),
            at=list(request.at), settings=request.table_options,
        )  # fmt: skip
        if unsure := less_sure_than_corrected(request):
            say(
                said(
                    "LOOK BEFORE THEY ACT: {why}. On lines that nobody measured they may do harm; "
                    "measure more first (--time, another instrument)",
                    why=unsure,
                )
            )

    def uploaded() -> None:
        from abbe.daemon.commands.tables.upload import upload

        upload(request.config, tables, yes=request.yes)

    yield CalibrationStep("table", "tables for the controller", (calibrated,), (record,), made)
    if request.uploads:
        yield CalibrationStep("upload", "tables uploaded", (record,), (), uploaded)


def _verified(
    request: CalibrationRequest, state: CalibrationState, say: Callable[[str], None], ask: AskPerson
) -> Iterator[CalibrationStep]:
    file = request.file
    calibrated, campaign = file(CALIBRATED), file(CAMPAIGN)
    plan_file, check, page = file(CHECK_PLAN), file(CHECK), file(CERTIFICATE)
    active = calibrated if request.uploads else None
    record = state.steps.get("verify")
    stated = request.stated(None if record is None else record.settings)

    def planned() -> None:
        from abbe.daemon.commands.measurements.verify import verify

        try:
            verify(
                calibrated, out=plan_file, fitted=[campaign], time=request.check_time, runs=2,
                tool=list(request.tools), instruments=request.checked_by, gauge=request.gauge,
                plate=request.plate, along_axes=request.along_axes,
                table_radius=request.radii[0], tool_radius=request.radii[1],
            )  # fmt: skip
        except InputError as error:
            if error.field != "time":
                raise
            needed = said("{n} min or more", n=(error.expected or "").partition(" ")[0])
            raise InputError(
                error.problem, field="check-time", found=error.found, expected=needed
            ) from None
        if request.by_file:
            write_targets(plan_file, calibrated, file(CHECK_TARGETS))

    made_from = (calibrated, campaign)
    yield CalibrationStep("check-plan", "lines to verify it", made_from, (plan_file,), planned)
    yield from _program(request, state, "check-program", plan_file, file(CHECK_PROGRAM), calibrated)

    visits = file(CHECK_VISITS) if request.by_file else check

    def measured() -> None:
        settings = _program_settings(request, state, "check-program")
        _measure(request, plan_file, visits, active, settings)

    yield CalibrationStep("check", "these lines measured", (plan_file,), (visits,), measured)
    if request.by_file:
        placed = (visits, file(CHECK_READINGS), check)
        yield _readings(request, say, ask, "check-readings", placed)

    def judged() -> str:
        return judge_check(request, active, stated, state.outcome("diagnose"), say)

    judged_from = (calibrated, plan_file, check)
    yield CalibrationStep("verify", "the certificate", judged_from, (page,), judged, stated)


def _live(
    request: CalibrationRequest, state: CalibrationState, say: Callable[[str], None]
) -> CalibrationStep:
    calibrated = request.file(CALIBRATED)
    outcome = state.outcome("verify") if request.checked_by else ""
    verified = outcome.startswith(VerdictOutcome.VERIFIED.value)
    out = request.file(LIVE if verified else NOT_VERIFIED)

    def live() -> str:
        found = outcome or NOTHING_CHECKED
        words = live_words(found, state.outcome("diagnose"))
        model = write_live_configuration(request.config, calibrated, out, words)
        say(
            said(
                "written: {file}, which starts {model}; {outcome}",
                file=out, model=model.name, outcome=found,
            )
        )  # fmt: skip
        return found

    checked = (request.file(CHECK),) if request.checked_by else ()
    made_from = (calibrated, *checked)
    makes = (out, *kept_model(calibrated, request.folder))
    settings = {"check": outcome[:200]} if checked else {}
    return CalibrationStep(
        "live", "the configuration of abbe run", made_from, makes, live, settings
    )


def _measure(
    request: CalibrationRequest,
    plan_file: Path,
    out: Path,
    active: Path | None,
    settings: Mapping[str, str],
) -> None:
    from abbe.daemon.commands.measurements.measure import run
    from abbe.daemon.measure.show import telling
    from abbe.daemon.report.language import ENGLISH, language

    if request.uploads:
        require_acting(request.configuration, active)
    say = language(request.language or ENGLISH).say
    with telling(as_json=request.as_json, say=say) as tell:
        run(
            plan_file, request.config, out, (), tell, yes=request.yes, once=False, active=active,
            conditions={"feed": f"{settings['feed']} mm/min"} if request.controller else {},
        )  # fmt: skip


def _tool(tools: Sequence[str]) -> str:
    """The offset of the first tool of the plan, for which tables are made."""
    from abbe.daemon.arguments.plan_arguments import tools_of

    return ",".join(f"{v:g}" for v in next(iter(tools_of(tools).values())))
