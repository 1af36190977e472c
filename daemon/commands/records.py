"""``abbe records``: what a machine read, corrected and said, for a person, a file, or a part."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, Force

_PLACE = typer.Argument(
    help="Configuration with [records], or a file of records.", metavar="CONFIG.toml"
)
_FROM = typer.Option("--from", help="2026-11-22 14:03, 14:03, 2h, 30min, 7d; default: 1h.")
_TO = typer.Option("--to", help="Likewise; default: now.")
_LEVELS = {
    "info": (),
    "warning": ("WARNING", "ERROR", "CRITICAL"),
    "error": ("ERROR", "CRITICAL"),
}
_SERIES = typer.Option("--series", help="Only this; may be repeated.")


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    records = typer.Typer(
        help="What a machine read, corrected and said ([records] keeps it).",
        no_args_is_help=True,
    )
    records.command("show")(show)
    records.command("export")(export)
    records.command("part")(part)
    app.add_typer(records, name="records")


def show(
    place: Annotated[Path, _PLACE],
    since: Annotated[str, _FROM] = "",
    until: Annotated[str, _TO] = "now",
    series: Annotated[list[str] | None, _SERIES] = None,
    level: Annotated[
        str, typer.Option("--level", help="Only events as grave: info, warning, error.")
    ] = "info",
) -> None:
    """What is kept; with --from, least, mean and greatest of each series, and the last events."""
    from abbe.compcore.errors import InputError
    from abbe.daemon.answers.records import between, summary
    from abbe.daemon.records.reading import opened

    if level not in _LEVELS:
        raise InputError("not a level", field="--level", found=level, expected=", ".join(_LEVELS))
    with opened(_file(place)) as records:
        if since or series or level != "info":
            first, last = _times(since or "1h", until)
            lines = between(records, first, last, series or [], _LEVELS[level])
        else:
            lines = summary(records)
        for line in lines:
            typer.echo(line)


def export(
    place: Annotated[Path, _PLACE],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="By its ending CSV or Parquet.", metavar="FILE")
    ],
    since: Annotated[str, _FROM] = "1h",
    until: Annotated[str, _TO] = "now",
    series: Annotated[list[str] | None, _SERIES] = None,
    force: Force = False,
) -> None:
    """Write what is kept between two times to a CSV or Parquet file."""
    from abbe.compcore.errors import InputError
    from abbe.daemon.answers.records import export_csv, export_parquet
    from abbe.daemon.outputs import RECORDS_CSV, RECORDS_PARQUET, check_outputs
    from abbe.daemon.records.reading import opened

    kinds = {".csv": (RECORDS_CSV, export_csv), ".parquet": (RECORDS_PARQUET, export_parquet)}
    if out.suffix not in kinds:
        raise InputError("unknown ending", field="--out", found=out.name, expected=".csv, .parquet")
    kind, write = kinds[out.suffix]
    file = _file(place)
    say = check_outputs([place, file], [(out, kind)], force=force)
    first, last = _times(since, until)
    with opened(file) as records:
        count = write(records, out, first, last, series or [])
    say(f"{count} values: {out}")


def part(
    place: Annotated[Path, _PLACE],
    since: Annotated[str, typer.Argument(help="When the part was begun.", metavar="FROM")],
    until: Annotated[str, typer.Argument(help="When it was done.", metavar="TO")],
    as_json: AsJson = False,
) -> None:
    """Trace a part: model, corrections, temperatures, what was out of range, between two times."""
    from abbe.daemon.answers import part_trace as answer
    from abbe.daemon.records.reading import opened

    first, last = _times(since, until)
    with opened(_file(place)) as records:
        found = answer.part(records, first, last, _uploads(place))
        spans = records.spans(first, last)
    if as_json:
        typer.echo(json.dumps(found, ensure_ascii=False))
        return
    for line in answer.part_text(found, spans):
        typer.echo(line)


def _times(since: str, until: str) -> tuple[float, float]:
    from abbe.compcore.errors import InputError
    from abbe.daemon.arguments.moments import moment

    first, last = moment(since, "--from"), moment(until, "--to")
    if first > last:
        raise InputError("is later than the end", field="--from", found=since, expected=until)
    return first, last


def _file(place: Path) -> Path:
    from abbe.compcore.errors import InputError
    from abbe.daemon.config import load_config

    if place.suffix != ".toml":
        return place
    path = load_config(place).records_path
    if path is None:
        raise InputError(
            "keeps no records", file=place, field="records", expected="a section [records]"
        )
    return path


def _uploads(place: Path) -> Path | None:
    from abbe.daemon.config import load_config

    upload = load_config(place).upload if place.suffix == ".toml" else None
    return None if upload is None else upload.journal
