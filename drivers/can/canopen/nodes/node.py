"""One CANopen node: brought up, its heartbeat and emergencies watched, its objects read."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import TypeVar

from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.nodes.emergencies import emergency_text
from abbe.drivers.can.canopen.nodes.setup import NodeSetup, set_up
from abbe.drivers.can.canopen.objects import decode
from abbe.drivers.can.canopen.process_data.pdo import Pdo
from abbe.drivers.can.canopen.process_data.sync import Sync
from abbe.drivers.can.canopen.sdo.adapter import Network
from abbe.drivers.link import LinkTimeoutError, Quality, Sample
from abbe.drivers.quarantine import Member

logger = logging.getLogger("abbe.drivers.can")

T = TypeVar("T")

BOOTED, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127
STATES = {STOPPED: "stopped", OPERATIONAL: "operational", PRE_OPERATIONAL: "pre-operational"}
START = 1
"""NMT command."""
_START_TIME = 0.3
"""s for a started node to say so in a heartbeat."""
_NAN = float("nan")


class Node(Member):
    """One node of the configuration.

    Parameters
    ----------
    name
        Its name there.
    config
        The link's section.
    network
        The bus.
    threads
        Where SDO transfers wait.
    on_change
        Called when its health may have changed.
    sync
        Told when a PDO came that was waited for since its SYNC.

    Attributes
    ----------
    number
        Its id.
    prepared
        Whether it was found and set up since it booted last.
    needs_care
        Set when it has to be looked for and set up.
    last_heartbeat_at
        Monotonic time in s of its last heartbeat.
    started_at
        Monotonic time in s when it was told to start.
    state
        As its last heartbeat said; None before the first.
    emergency
        What it reported and did not take back, for people.
    refused
        Channel → why it cannot be had from this node; an empty name: what else it does not do.
    """

    __slots__ = (
        "_beat",
        "_busy",
        "_channels",
        "_config",
        "_found",
        "_network",
        "_on_change",
        "_restarted",
        "_sync",
        "_threads",
        "emergency",
        "last_heartbeat_at",
        "needs_care",
        "number",
        "prepared",
        "refused",
        "section",
        "started_at",
        "state",
    )  # fmt: skip

    def __init__(
        self,
        name: str,
        config: CanopenConfig,
        network: Network,
        threads: Executor,
        on_change: Callable[[], None],
        sync: Sync,
    ) -> None:
        self.section = config.nodes[name]
        self.number = self.section.id
        super().__init__(f"node {name} ({self.number})")
        self._config = config
        self._network = network
        self._threads = threads
        self._on_change = on_change
        self._sync = sync
        self._busy = asyncio.Lock()
        self._channels = {n: c for n, c in config.channels.items() if c.node == name}
        self._found = NodeSetup()
        self.refused: dict[str, str] = {}
        self.prepared = self._restarted = False
        self.needs_care = asyncio.Event()
        self._beat = asyncio.Event()
        self.last_heartbeat_at = 0.0
        self.started_at = 0.0
        self.state: int | None = None
        self.emergency = ""
        network.add(self.number, self._take_emergency)
        network.listen(0x700 + self.number, self._take_heartbeat)

    @property
    def pdos(self) -> list[Pdo]:
        """The PDOs that carry its channels."""
        return list(dict.fromkeys(pdo for pdo, _ in self._found.pdos.values()))

    def renew(self) -> None:
        """A new connection: nothing is known."""
        self.prepared = False
        self.last_heartbeat_at, self.state, self.emergency = time.monotonic(), None, ""
        self._found = NodeSetup()
        self.needs_care.set()

    def lose(self, why: str) -> None:
        """It is gone, or has restarted: it has to be set up again."""
        self.prepared = False
        self.why = why
        self.needs_care.set()

    async def prepare(self) -> None:
        """Find it and set it up: heartbeat, PDOs, scales.

        Raises
        ------
        LinkTimeoutError, LinkDownError
            When it does not answer, or its heartbeat is watched and does not come. What it refuses
            makes its channels bad, not the node.
        """
        self.needs_care.clear()
        self._beat.clear()
        self._restarted = False
        found = await self.in_thread(
            lambda: set_up(self._network, self.section, self._channels, self._config)
        )
        self._found = found
        self._tell_refused(found)
        if self.section.heartbeat is not None:
            await self._first_heartbeat(self.section.heartbeat)
        for pdo in self.pdos:
            self._network.subscribe(pdo.cob_id, self._receiver(pdo))
        self.last_heartbeat_at = time.monotonic()
        if self._restarted:
            self.why = f"{self.name} restarted while it was set up"
            self.needs_care.set()
            return
        self.why = ""
        self.prepared = True
        # set by heartbeats that came meanwhile
        self.needs_care.clear()

    async def ask_again(self) -> None:
        """Ask once more for what it refused when it was set up; what it gives is left alone.

        Raises
        ------
        LinkTimeoutError, LinkDownError
            When it does not answer.
        """
        left = {name: part for name, part in self._channels.items() if name in self.refused}
        before = self.pdos
        found = await self.in_thread(
            lambda: set_up(self._network, self.section, left, self._config, before)
        )
        if not self.prepared:
            return
        self._found.pdos |= found.pdos
        self._found.scales |= found.scales
        for pdo in self.pdos:
            if pdo not in before:
                self._network.subscribe(pdo.cob_id, self._receiver(pdo))
        self._tell_refused(found)

    def _tell_refused(self, found: NodeSetup) -> None:
        self.refused = {name: f"{self.name}, {why}" for name, why in found.refused.items()}

    async def _first_heartbeat(self, limit: float) -> None:
        try:
            await asyncio.wait_for(self._beat.wait(), limit)
        except TimeoutError:
            raise LinkTimeoutError(
                f"{self.name} answers, and no heartbeat comes from it in {limit:g} s "
                "(produce_heartbeat sets it)"
            ) from None

    async def in_thread(self, job: Callable[[], T]) -> T:
        """Have a thread do something with this node; one thing at a time, even when given up."""
        await self._busy.acquire()
        done = asyncio.get_running_loop().run_in_executor(self._threads, job)
        done.add_done_callback(self._release)
        return await asyncio.shield(done)

    async def take_turn(self) -> bool:
        """Take the node for a short transfer; False when a longer one is under way."""
        if self._busy.locked():
            return False
        return await self._busy.acquire()

    def end_turn(self) -> None:
        """Give it to the next."""
        self._busy.release()

    def _release(self, done: asyncio.Future[T]) -> None:
        self._busy.release()
        if not done.cancelled():
            done.exception()  # seen; whoever waits gets it

    def wrong_state(self) -> str:
        """In which state it is although it should be operational; empty when all is well."""
        if not self.section.start or self.state in (None, BOOTED, OPERATIONAL):
            return ""
        if time.monotonic() - self.started_at < _START_TIME:
            return ""
        return f"{self.name} is {STATES.get(self.state or 0, f'in state {self.state}')}"

    def fell_back(self) -> bool:
        """Whether it is pre-operational although it was started; a stopped one was stopped."""
        return self.state == PRE_OPERATIONAL and bool(self.wrong_state())

    def unavailable(self, name: str) -> Sample | None:
        """Why a channel cannot be had now, as the sample for it; None when it can."""
        if self.prepared and not (self.refused or self.emergency):
            return None
        now = time.monotonic()
        if not self.prepared:
            why = self.why or f"{self.name} was not found yet"
            return Sample(_NAN, now, Quality.UNAVAILABLE, why)
        if name in self.refused:
            return Sample(_NAN, now, Quality.BAD, self.refused[name])
        if self.emergency and self.section.emergency == "bad":
            return Sample(_NAN, now, Quality.BAD, self.emergency)
        return None

    def sample(self, name: str, data: bytes, at: float) -> Sample:
        """A channel's value in its object's bytes, which was asked for at `at` (monotonic, s)."""
        kind = self._channels[name].number_type
        return self._sample(name, lambda: decode(kind, data), at)

    def pdo_of(self, name: str) -> Pdo | None:
        """The PDO that carries a channel."""
        found = self._found.pdos.get(name)
        return found[0] if found is not None else None

    def from_pdo(self, name: str, pdo: Pdo) -> Sample:
        """A channel's value in the last frame of the PDO that carried it before that came."""
        samples = pdo.samples if pdo.samples is not None else self._work_out(pdo)
        if name in samples:
            return samples[name]
        why = f"{name}: {self.name} was set up anew meanwhile"
        return Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, why)

    def _work_out(self, pdo: Pdo) -> Mapping[str, Sample]:
        samples = pdo.samples = {
            name: self._sample(name, read, pdo.taken)
            for name, (carrying, read) in self._found.pdos.items()
            if carrying is pdo
        }
        return samples

    def _sample(self, name: str, read: Callable[[], float], at: float) -> Sample:
        try:
            number = read()
        except ValueError as error:
            return Sample(_NAN, at, Quality.BAD, f"{name}: {error}")
        channel = self._channels[name]
        value = channel.value_of(number * self._found.scales[name])
        return Sample(value, at)

    # What it says by itself

    def _receiver(self, pdo: Pdo) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            awaited, came = pdo.awaited_since is not None, self._network.arrived
            sync_at = math.inf if awaited else self._sync.before(came)
            if pdo.take(data, came, sync_at, self._network.latest) and awaited:
                self._work_out(pdo)  # while others are waited for
                self._sync.came()

        return receive

    def _take_heartbeat(self, data: bytes) -> None:
        if not data:
            return
        self.last_heartbeat_at = time.monotonic()
        self._beat.set()
        state = data[0] & 0x7F
        before, self.state = self.state, state
        if state == BOOTED and self.prepared:
            logger.warning("%s restarted", self.name)
            self.emergency = ""
            self.lose(f"{self.name} restarted")
        elif not self.prepared:
            self._restarted = self._restarted or state == BOOTED
            self.retry_at = 0.0
            self.needs_care.set()
        if state != before:
            self._on_change()

    def _take_emergency(self, code: int, register: int, meaning: str) -> None:
        words = emergency_text(code, register, meaning)
        message = f"{self.name}: {words}" if words else ""
        if message != self.emergency:
            self.emergency = message
            logger.warning("%s", message or f"{self.name}: no emergency any more")
            self._on_change()
