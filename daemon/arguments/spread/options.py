"""Options of commands that spread their work, and where it then goes."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True)
class SpreadOptions:
    """Where the work of a command shall go.

    Attributes
    ----------
    workers
        Processes of this computer; None: one for each processor.
    scheduler
        Address of a Dask scheduler; None: this computer.
    tls_ca, tls_cert, tls_key
        PEM files of the authority, of this side's certificate and of its key.
    keep
        File of answers.
    """

    workers: Workers = None
    scheduler: Scheduler = None
    tls_ca: TlsAuthority = None
    tls_cert: TlsCertificate = None
    tls_key: TlsKey = None
    keep: Keep = None

    def place(self, tasks: int) -> SpreadPlace:
        """Where so many tasks go; more processes than tasks are not started.

        Raises
        ------
        InputError
            For options that do not go together.
        """
        from abbe.compcore.errors import InputError
        from abbe.daemon.spreading.engine import Engine, InThisProcess
        from abbe.daemon.spreading.spread import SpreadPlace

        tls = (self.tls_ca, self.tls_cert, self.tls_key)
        if self.scheduler is not None:
            from abbe.daemon.spreading.dask_cluster import DaskCluster, SchedulerAddress

            if self.workers is not None:
                raise InputError(
                    "workers elsewhere or processes here", field="--workers", found=self.workers,
                    expected="--scheduler or --workers",
                )  # fmt: skip
            address = SchedulerAddress(self.scheduler, *tls)
            if address.exposed:
                typer.echo(
                    f"abbe: note: {self.scheduler} is not encrypted: whoever is on that network "
                    "can read and change what is computed (docs/dask.md: tls://)",
                    err=True,
                )
            lasting = self.keep is not None
            return SpreadPlace(DaskCluster(address), self.keep or WORK_FILE, lasting=lasting)
        for option, given in zip(("--tls-ca", "--tls-cert", "--tls-key"), tls, strict=True):
            if given is not None:
                raise InputError(f"{option} belongs to --scheduler tls://…", field=option)
        from abbe.daemon.spreading.process_pool import ProcessPool, processors

        count = min(self.workers or processors(), tasks)
        engine: Engine = ProcessPool(count) if count > 1 else InThisProcess()
        return SpreadPlace(engine, self.keep)
