"""Arguments and options of the commands of ``abbe fleet``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.errors import AbbeError, InputError

StoreUrl = Annotated[
    str,
    typer.Option(
        "--store",
        envvar="ABBE_STORE",
        help="postgresql://USER@HOST/DATABASE; the password as PostgreSQL's own programs take it "
        "(~/.pgpass).",
        metavar="URL",
        show_default=False,
    ),
]
Site = Annotated[str, typer.Option("--site", help="Only of this site.", show_default=False)]
MachineType = Annotated[str, typer.Option("--type", help="Only of this type.", show_default=False)]
FleetMachineName = Annotated[str, typer.Argument(help="A machine's name.", metavar="MACHINE")]
PasswordFile = Annotated[
    Path | None,
    typer.Option(
        "--password-file",
        help="Holds the role's password; made, with a new one, where there is no such file.",
        metavar="FILE",
    ),
]


def require_store(url: str) -> str:
    """The store that is asked.

    Raises
    ------
    InputError
        Where none was named.
    AbbeError
        Where the package that speaks to it is missing.
    """
    from importlib.util import find_spec

    from abbe.daemon.config.sections.fleet import NEEDED

    if not url:
        raise InputError(
            "which store?",
            field="--store",
            expected="postgresql://USER@HOST/DATABASE, there or in the environment as ABBE_STORE",
        )
    if find_spec(NEEDED) is None:
        raise AbbeError(f"the plant's store needs {NEEDED}: pip install 'abbe[fleet]'")
    return url
