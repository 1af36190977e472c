"""Workers of a Dask scheduler that carry tasks out; imports `distributed`, only when asked.

Dask runs whatever code it is sent, on workers and on the client: only schedulers that are one's own
are connected to, by TLS wherever the network is not. Abbe starts no scheduler and no worker.
"""

from __future__ import annotations

import asyncio
import logging
import queue
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.spreading.engine import ATTEMPTS, Numbered, WorkLostError
from abbe.daemon.spreading.fingerprint import differing, fingerprint
from abbe.daemon.spreading.spread_work import TaskAnswer, TaskPayload, perform
from abbe.drivers.resources import on_this_computer

_ADDRESS = re.compile(r"^(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]{1,253}):(\d{1,5})$")
_CONNECTING = 10.0
"""Seconds in which a scheduler answers, and in which a lost one must be there again."""
_LOOK = 0.25
"""Seconds between looks at whether the scheduler is there."""
_AHEAD = 3
"""Tasks for each thread of the workers that are on their way at a time."""


@dataclass(frozen=True)
class SchedulerAddress:
    """Where a scheduler is, and by which certificates both sides know each other.

    Attributes
    ----------
    address
        ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    authority, certificate, key
        For tls: PEM files of the authority that signed both sides' certificates, of this side's
        certificate and of its key.
    patience
        Seconds for which there may be no worker.
    """

    address: str
    authority: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    patience: float = 60.0

    def __post_init__(self) -> None:
        found = _ADDRESS.match(self.address)
        if found is None or not 0 < int(found[3]) < 65536:
            raise InputError(
                "not the address of a scheduler", field="--scheduler", found=self.address,
                expected="tcp://HOST:PORT or tls://HOST:PORT",
            )  # fmt: skip
        files = {"--tls-ca": self.authority, "--tls-cert": self.certificate, "--tls-key": self.key}
        for option, file in files.items():
            if self.encrypted != (file is not None):
                raise InputError(
                    "tls:// takes three files, tcp:// none", field=option, found=file,
                    expected="--tls-ca CA.pem --tls-cert CERT.pem --tls-key KEY.pem with tls://",
                )  # fmt: skip
            if file is not None and not file.is_file():
                raise InputError("no such file", file=file)

    @property
    def encrypted(self) -> bool:
        """Whether by TLS."""
        return self.address.startswith("tls://")

    @property
    def exposed(self) -> bool:
        """Whether anybody on the network could speak in the scheduler's place."""
        host = self.address.partition("://")[2].rpartition(":")[0]
        return not self.encrypted and not on_this_computer(host)


class DaskCluster:
    """The workers of a scheduler.

    Parameters
    ----------
    scheduler
        Where it is.
    """

    def __init__(self, scheduler: SchedulerAddress) -> None:
        self.scheduler = scheduler

    def carry_out(self, tasks: Iterable[Numbered]) -> Iterator[tuple[int, TaskAnswer]]:
        """See `Engine`.

        Raises
        ------
        AbbeError
            When no scheduler answers, or workers have other versions of what computes.
        """
        with _connected(self.scheduler) as client:
            threads = self._checked(client)
            yield from self._course(client, iter(tasks), _AHEAD * threads)

    def _checked(self, client: Any) -> int:
        """How many threads the workers have; all of the same versions."""
        try:
            client.wait_for_workers(1, timeout=self.scheduler.patience)
        except TimeoutError:
            raise WorkLostError(
                f"{self.scheduler.address} has no workers (dask worker {self.scheduler.address})"
            ) from None
        for worker, found in client.run(fingerprint, on_error="return").items():
            if isinstance(found, BaseException):
                raise AbbeError(
                    f"the worker {worker} cannot do Abbe's work ({type(found).__name__}: {found}): "
                    "it needs the same Abbe, with abbe[dask]"
                )
            if differs := differing(fingerprint(), found):
                raise AbbeError(
                    f"the worker {worker} has other versions, and results would not be the same: "
                    f"{differs}"
                )
        threads: int = sum(client.nthreads().values())
        return max(1, threads)

    def _course(
        self, client: Any, left: Iterator[Numbered], most: int
    ) -> Iterator[tuple[int, TaskAnswer]]:
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        running: dict[Any, Numbered] = {}
        failed: Counter[int] = Counter()
        working = monotonic()
        more = True
        while more or running:
            while more and len(running) < most:
                one = next(left, None)
                more = one is not None
                if one is not None:
                    self._submit(client, one, failed[one[0]], running, ended)
            if not running:
                return
            try:
                future = ended.get(timeout=_LOOK)
            except queue.Empty:
                working = self._looked(client, working)
                continue
            working = monotonic()
            number, task = running.pop(future.key)
            answer = self._answer(client, future)
            if answer is not None:
                yield number, answer
                continue
            failed[number] += 1
            if failed[number] >= ATTEMPTS:
                raise WorkLostError(
                    f"the worker that worked at {task.title or number} died {ATTEMPTS} times "
                    "(out of memory?)"
                )
            self._submit(client, (number, task), failed[number], running, ended)

    def _answer(self, client: Any, future: Any) -> TaskAnswer | None:
        """What a task gave; None: its worker is gone, and it has to be asked again."""
        try:
            if future.status == "finished":
                found: TaskAnswer = future.result(timeout=self.scheduler.patience)
                return found
            if future.status == "error" and not _worker_died(future):
                raise AbbeError(f"a worker failed: {_first_line(future.exception())}")
        except AbbeError:
            raise
        except (Exception, asyncio.CancelledError):  # noqa: BLE001  # the connection broke meanwhile
            pass
        self._require_scheduler(client)
        return None

    def _require_scheduler(self, client: Any) -> None:
        """Whether the scheduler answers; it is lost where it does not."""
        try:
            if client.status == "running":
                client.nthreads()
                return
        except (Exception, asyncio.CancelledError):  # noqa: BLE001  # whatever breaks first
            pass
        raise self._lost()

    def _submit(
        self, client: Any, one: Numbered, attempt: int, running: dict[Any, Numbered], ended: Any
    ) -> None:
        number, task = one
        key = f"abbe-{task.identity}-{number}-{attempt}"
        if client.status != "running":
            raise self._lost()
        future = client.submit(perform, TaskPayload.of(task), key=key, pure=False, retries=2)
        running[future.key] = one
        future.add_done_callback(ended.put)

    def _looked(self, client: Any, working: float) -> float:
        """Whether the scheduler is there, and workers; since when nothing was heard."""
        if client.status != "running":
            raise self._lost()
        if monotonic() - working < self.scheduler.patience:
            return working
        self._require_scheduler(client)
        if not client.nthreads():
            raise WorkLostError(f"{self.scheduler.address} has no workers any more")
        return monotonic()

    def _lost(self) -> WorkLostError:
        return WorkLostError(f"the scheduler {self.scheduler.address} is lost")


def _worker_died(future: Any) -> bool:
    from distributed.scheduler import KilledWorker

    return isinstance(future.exception(), KilledWorker)


@contextmanager
def _connected(scheduler: SchedulerAddress) -> Iterator[Any]:
    """A client of a scheduler, which says nothing on standard error itself."""
    try:
        import dask
        import distributed
    except ImportError:
        raise InputError(
            "Dask is not installed here", field="--scheduler", found=scheduler.address,
            expected="pip install 'abbe[dask]', or no --scheduler: processes of this computer",
        ) from None  # fmt: skip
    for name in ("distributed", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    settings = {
        "distributed.comm.timeouts.connect": f"{_CONNECTING:g}s",
        "distributed.comm.timeouts.tcp": "30s",
        "distributed.comm.retry.count": 0,
        "distributed.comm.require-encryption": scheduler.encrypted,
    }
    security = None
    if scheduler.encrypted:
        security = distributed.Security(
            tls_ca_file=str(scheduler.authority),
            tls_client_cert=str(scheduler.certificate),
            tls_client_key=str(scheduler.key),
            require_encryption=True,
        )
    with dask.config.set(settings):
        client = _client(
            scheduler.address,
            lambda: distributed.Client(
                scheduler.address, timeout=_CONNECTING, security=security, set_as_default=False
            ),
        )
        try:
            yield client
        finally:
            _close(client)


def _client(address: str, make: Callable[[], Any]) -> Any:
    """A client, within a time: Dask waits without end for a server that says nothing."""
    made: queue.SimpleQueue[tuple[Any, str]] = queue.SimpleQueue()

    def run() -> None:
        try:
            made.put((make(), ""))
        except Exception as error:  # noqa: BLE001  # whatever a foreign server makes Dask raise
            made.put((None, _first_line(error)))

    threading.Thread(target=run, daemon=True).start()
    try:
        client, problem = made.get(timeout=1.5 * _CONNECTING)
    except queue.Empty:
        client, problem = None, "it accepts and says nothing"
    if client is None:
        raise WorkLostError(f"no Dask scheduler answers at {address} ({problem})")
    return client


def _first_line(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return (text[0] if text else type(error).__name__)[:200]


def _close(client: Any) -> None:
    # a scheduler that is gone cannot be told
    with suppress(Exception):
        client.close(timeout=2)
