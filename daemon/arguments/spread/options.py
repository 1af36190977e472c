"""Options of commands that spread their work, and where it then goes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from abbe.daemon.spreading.spread import SpreadPlace

WORK_FILE = Path("abbe-work.sqlite")
"""Where answers of workers elsewhere are kept until all are there."""

Workers = Annotated[
    int | None,
    typer.Option(help="Processes of this computer; default: one for each processor.", min=1),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="A Dask scheduler whose workers do it instead.", metavar="tcp://HOST:PORT | tls://…"
    ),
]
TlsAuthority = Annotated[
    Path | None, typer.Option("--tls-ca", help="With tls://: the authority's.", metavar="PEM")
]
TlsCertificate = Annotated[
    Path | None, typer.Option("--tls-cert", help="With tls://: this side's.", metavar="PEM")
]
TlsKey = Annotated[
    Path | None, typer.Option("--tls-key", help="With tls://: its key.", metavar="PEM")
]
Keep = Annotated[
    Path | None,
    typer.Option(
        help="Keep answers in this file: a run that ended early goes on, one again is immediate. "
        f"With --scheduler: {WORK_FILE} until all are there.",
        metavar="FILE",
    ),
]


def spread_place(
    workers: int | None,
    scheduler: str | None,
    tls: tuple[Path | None, Path | None, Path | None],
    keep: Path | None,
    tasks: int,
) -> SpreadPlace:
    """Where the work of a command goes.

    Parameters
    ----------
    tls
        Authority, certificate and key.
    tasks
        How many there are; more processes than that are not started.

    Raises
    ------
    InputError
        For options that do not go together.
    """
    from abbe.compcore.errors import InputError
    from abbe.daemon.spreading.engine import Engine, InThisProcess
    from abbe.daemon.spreading.spread import SpreadPlace

    if scheduler is not None:
        from abbe.daemon.spreading.dask_cluster import DaskCluster, SchedulerAddress

        if workers is not None:
            raise InputError(
                "workers elsewhere or processes here", field="--workers", found=workers,
                expected="--scheduler or --workers",
            )  # fmt: skip
        address = SchedulerAddress(scheduler, *tls)
        if address.exposed:
            typer.echo(
                f"abbe: note: {scheduler} is not encrypted: whoever is on that network can read "
                "and change what is computed (docs/dask.md: tls://)",
                err=True,
            )
        return SpreadPlace(DaskCluster(address), keep or WORK_FILE, lasting=keep is not None)
    for option, given in zip(("--tls-ca", "--tls-cert", "--tls-key"), tls, strict=True):
        if given is not None:
            raise InputError(f"{option} belongs to --scheduler tls://…", field=option)
    from abbe.daemon.spreading.process_pool import ProcessPool, processors

    count = min(workers or processors(), tasks)
    engine: Engine = ProcessPool(count) if count > 1 else InThisProcess()
    return SpreadPlace(engine, keep)
