"""``abbe upload``: compensation tables into a controller, verified, rolled back where it fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abbe.daemon.answers.typed import uploading
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson

if TYPE_CHECKING:
    from abbe.daemon.config import Configuration
    from abbe.daemon.upload.operator import TerminalOperator
    from abbe.daemon.upload.session import UploadRequest


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("upload")(upload)


def upload(
    config: Annotated[
        Path, typer.Argument(help="Configuration with [upload].", metavar="CONFIG.toml")
    ],
    tables: Annotated[
        Path | None, typer.Argument(help="Folder that `abbe table` wrote.", metavar="TABLES")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only ask and compare; say what would change.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before writing.")] = False,
    rollback: Annotated[
        bool, typer.Option("--rollback", help="Put back what was active before the last upload.")
    ] = False,
    status: Annotated[
        bool, typer.Option("--status", help="What is active, and where it came from.")
    ] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Whether the controller adds what the active tables say."),
    ] = False,
    recover: Annotated[
        bool, typer.Option("--recover", help="Bring an upload that was cut off to its end.")
    ] = False,
    max_change: Annotated[
        float | None,
        typer.Option(
            callback=within(1e-3, 1e5, "µm"),
            help="Allowed change, µm, in place of upload.max_change_um.",
        ),
    ] = None,
    by: Annotated[str, typer.Option(help="Who uploads, for the journal.")] = "",
    note: Annotated[str, typer.Option(help="A remark for the journal.")] = "",
    as_json: AsJson = False,
) -> None:
    """Write tables to a controller: check, back up, stage, read back, activate, check the effect.

    Whatever fails, either the old tables are active or the new ones, never a mixture, and the last
    lines say which. An example: abbe upload mill.toml tables
    """
    from abbe.daemon.config import load_config
    from abbe.daemon.upload.session import UploadRequest

    if (tables is not None) + rollback + status + check + recover != 1:
        raise typer.BadParameter(
            "give a folder of tables, or one of --rollback --status --check --recover"
        )
    if dry_run and (status or check or recover):
        raise typer.BadParameter("--dry-run does not go with --status, --check and --recover")
    configuration = load_config(config)
    request = UploadRequest(dry_run, max_change, by, note)
    if status:
        _status(configuration, as_json)
    elif check:
        _check(configuration, as_json)
    elif recover:
        _recover(configuration, request, as_json)
    else:
        _change(configuration, tables, request, yes, as_json)


def _change(
    configuration: Configuration,
    tables: Path | None,
    request: UploadRequest,
    yes: bool,
    as_json: bool,
) -> None:
    import asyncio

    from abbe.compcore.errors import AbbeError
    from abbe.daemon.answers.tables.upload_words import named, naming, result_json, result_lines
    from abbe.daemon.answers.tables.words import trust_lines
    from abbe.daemon.upload.operator import TerminalOperator, can_ask
    from abbe.daemon.upload.session import roll_back, setup_of, upload

    if not (yes or request.dry_run) and (as_json or not can_ask()):
        raise AbbeError(
            "nobody can be asked whether to write to the controller (no terminal, or --json): "
            "say --yes"
        )
    setup = setup_of(configuration)
    with TerminalOperator(quiet=as_json, yes=yes) as operator:
        for line in trust_lines(setup.make_controller(configuration.model.machine)):
            operator.tell(line)
        port = naming(operator.port(), configuration.path)
        doing = (
            roll_back(configuration, request, port)
            if tables is None
            else upload(configuration, tables, request, port)
        )
        result = asyncio.run(doing)
    if as_json:
        typer.echo(_json(result_json(result, request), configuration))
    else:
        for line in result_lines(result, request):
            typer.echo(named(line, configuration.path))
    if not result.ok:
        raise typer.Exit(1)


def _json(reported: Any, configuration: Configuration) -> str:
    """One line of JSON, its texts with whole commands too."""
    named = json.dumps(uploading(configuration.path), ensure_ascii=False)[1:-1]
    return json.dumps(reported, ensure_ascii=False).replace("abbe upload CONFIG.toml", named)


def _recover(configuration: Configuration, request: UploadRequest, as_json: bool) -> None:
    import asyncio

    from abbe.daemon.answers.tables.upload_words import named, naming
    from abbe.daemon.upload.operator import TerminalOperator
    from abbe.daemon.upload.session import finish

    with TerminalOperator(quiet=as_json, yes=True) as operator:
        operator.begin("recovering")
        outcome = asyncio.run(
            finish(configuration, request, naming(operator.port(), configuration.path))
        )
    if as_json:
        reported = {"recovered": None if outcome is None else outcome.as_json()}
        typer.echo(_json(reported, configuration))
    elif outcome is None:
        typer.echo("no upload was cut off: nothing to recover")
    else:
        for line in outcome.lines():
            typer.echo(named(line, configuration.path))
    if outcome is not None and outcome.open:
        raise typer.Exit(1)


def _status(configuration: Configuration, as_json: bool) -> None:
    import asyncio

    from abbe.daemon.answers.tables.upload_words import named
    from abbe.daemon.upload.operator import TerminalOperator
    from abbe.daemon.upload.session import opened, working
    from abbe.daemon.upload.status import status, status_lines

    async def ask(operator: TerminalOperator) -> dict[str, Any]:
        with working(configuration, operator.port(), "", writes=False) as work:
            async with opened(work):
                return await status(work)

    with TerminalOperator(quiet=as_json, yes=True) as operator:
        found = asyncio.run(ask(operator))
    if as_json:
        typer.echo(json.dumps(found, ensure_ascii=False))
        return
    for line in status_lines(found):
        typer.echo(named(line, configuration.path))


def _check(configuration: Configuration, as_json: bool) -> None:
    import asyncio

    from abbe.daemon.upload.operator import TerminalOperator
    from abbe.daemon.upload.session import check

    with TerminalOperator(quiet=as_json, yes=True) as operator:
        seen = asyncio.run(check(configuration, operator.port()))
    if as_json:
        reported = {"looks": seen.looks, "worst_um": seen.worst, "largest_um": seen.largest}
        typer.echo(json.dumps(reported, ensure_ascii=False))
    else:
        typer.echo(seen.words())
