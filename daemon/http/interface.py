"""What the routes of the HTTP interface stand on: the run behind the hub, the gate, the metrics."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from prometheus_client import Counter
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.exceptions import HTTPException

from abbe.daemon.control.requests import Request as Change
from abbe.daemon.http.answers import ChangeableState
from abbe.daemon.http.cycles.hub import Hub, SilentRunError
from abbe.daemon.http.gate import Gate
from abbe.daemon.http.metrics import RunCollector, registry
from abbe.daemon.status.run_status import RunStatus


class Interface:
    """The run as the routes see it.

    Parameters
    ----------
    hub
        The connection to the run.
    gate
        Who may what.
    machine
        Name, for pages.
    pid
        The run's process, for its memory and processor time; 0: this one.

    Attributes
    ----------
    requests
        Counts requests by route and status.
    """

    def __init__(self, hub: Hub, gate: Gate, machine: str, pid: int = 0) -> None:
        self.hub, self.gate, self.machine = hub, gate, machine
        self._run = RunCollector()
        self._registry = registry(
            self._run,
            _OwnCollector(hub, gate, pid),
        )
        self.requests = Counter(
            "abbe_http_requests", "Requests", ["route", "status"], registry=self._registry
        )

    async def raw_status(self) -> bytes:
        """The run's status as it came.

        Raises
        ------
        HTTPException
            503 when the run says nothing.
        """
        try:
            return await self.hub.status()
        except SilentRunError as error:
            raise HTTPException(503, str(error)) from None

    async def status(self) -> RunStatus:
        """The run's status, read; raises as `raw_status`."""
        return RunStatus.model_validate_json(await self.raw_status())

    async def metrics(self, accept: str) -> tuple[bytes, str]:
        """Everything for Prometheus and its content type; also while the run says nothing."""
        try:
            self._run.status = RunStatus.model_validate_json(await self.hub.status())
        except SilentRunError:
            self._run.status = None
        encode, content_type = choose_encoder(accept)
        return encode(self._registry), content_type

    async def change(self, change: Change, who: str) -> ChangeableState:
        """Have the run do something.

        Raises
        ------
        HTTPException
            409 when it is refused, 503 when the run says nothing.
        """
        try:
            answer = await self.hub.do(change, who)
        except SilentRunError as error:
            raise HTTPException(503, str(error)) from None
        if not answer.get("ok"):
            raise HTTPException(409, str(answer.get("error", "refused")))
        return ChangeableState.model_validate(answer)


class _OwnCollector(Collector):
    """Metrics that are no part of a status: of the interface, and of the run's process."""

    def __init__(self, hub: Hub, gate: Gate, pid: int) -> None:
        self._hub, self._gate = hub, gate
        self._stat = Path(f"/proc/{pid or 'self'}/stat")

    def collect(self) -> Iterable[Metric]:
        """Every family."""
        yield GaugeMetricFamily(
            "abbe_http_streams", "Clients that stream cycles", value=self._hub.streams
        )
        yield CounterMetricFamily(
            "abbe_http_dropped_cycles", "Cycles that clients did not read", value=self._hub.dropped
        )
        yield CounterMetricFamily(
            "abbe_http_refused", "Requests without the right token", value=self._gate.refused
        )
        # as the kernel shows it also where the rest of /proc is hidden, as in a confined service
        try:
            fields = self._stat.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            return
        ticks = float(fields[11]) + float(fields[12])
        yield CounterMetricFamily(
            "abbe_process_cpu_seconds",
            "Processor time of the run",
            value=ticks / os.sysconf("SC_CLK_TCK"),
        )
        yield GaugeMetricFamily(
            "abbe_process_resident_memory_bytes",
            "Memory of the run",
            value=float(fields[21]) * os.sysconf("SC_PAGE_SIZE"),
        )
