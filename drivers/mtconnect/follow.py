"""An MTConnect agent followed: what it has, what is so now, and then only what came after that."""

from __future__ import annotations

from urllib.parse import quote

from abbe.drivers.link import LinkConfigError, LinkProtocolError
from abbe.drivers.mtconnect import units
from abbe.drivers.mtconnect.config import MtconnectConfig
from abbe.drivers.mtconnect.documents import AgentDocument, AgentElement, document_of
from abbe.drivers.mtconnect.exchange import MOST_BYTES, AgentExchange

_MOST_PROBE = 1 << 22
"""Bytes of a probe document; that of a machining centre has some 50,000."""
_PROBE_TIMES = 5.0
_COUNT = 500
"""Observations that are asked for at once; who is further behind asks what is so now."""


class _RefusedError(LinkProtocolError):
    """The agent answered with an error document."""

    def __init__(self, message: str, codes: frozenset[str]) -> None:
        super().__init__(message)
        self.codes = codes


class _RestartedError(LinkProtocolError):
    """The agent counts anew since the last answer."""


class AgentFollower:
    """The last observation of each channel's data item.

    Parameters
    ----------
    name
        The link's name, for errors.
    config
        Its section.

    Attributes
    ----------
    last
        Id of a data item → its last observation.
    asked_at
        When the question was asked whose answer ends with what is in `last`, monotonic, s.
    made_at
        The agent's own time stamp of that answer.
    test
        Whether the agent says of itself that it is tested, so that its values mean nothing.
    """

    def __init__(self, name: str, config: MtconnectConfig) -> None:
        self._name, self._config = name, config
        self._wanted = frozenset(channel.data for channel in config.channels.values())
        self._exchange = AgentExchange(config.host, config.port)
        which = " or ".join(f'@id="{one}"' for one in sorted(self._wanted))
        self._path = "path=" + quote(f"//DataItem[{which}]", safe="") if config.select else ""
        self._instance = self._next = 0
        self._count = _COUNT
        self.last: dict[str, AgentElement] = {}
        self.asked_at = 0.0
        self.made_at = ""
        self.test = False

    async def begin(self) -> None:
        """See what the agent has, and what is so now.

        Raises
        ------
        LinkConfigError
            When it lacks a data item, or has one in another unit.
        LinkError
            When it does not answer, or wrongly.
        """
        config = self._config
        probe, _ = await self._get(
            "/probe", "MTConnectDevices", _PROBE_TIMES * config.timeout, _MOST_PROBE
        )
        self._check(probe)
        await self._current(probe.number("instanceId"))

    async def renew(self) -> None:
        """See what came since the last time.

        Raises
        ------
        LinkError
            As of `begin`.
        """
        try:
            await self._sample()
        except _RestartedError:
            # perhaps with other data items, or in other units
            await self.begin()

    async def _sample(self) -> None:
        target = f"/sample?from={self._next}&count={self._count}"
        try:
            found, asked_at = await self._streams(target + (f"&{self._path}" if self._path else ""))
        except _RefusedError as error:
            # what it kept since is overwritten, or it counts anew: it is asked what is so now
            if "OUT_OF_RANGE" not in error.codes:
                raise
            await self._current(self._instance)
            return
        if found.number("instanceId") != self._instance:
            raise _RestartedError("the agent started again")
        following, last = found.number("nextSequence"), found.number("lastSequence")
        # more than was asked for, its count goes backwards, or what it kept is overwritten unsaid
        lost = found.number("firstSequence") > self._next
        if following <= last or following < self._next or lost:
            await self._current(self._instance)
            return
        self._take(found, asked_at, following)

    def drop(self) -> None:
        """End the connection at once."""
        self._exchange.drop()

    async def _current(self, instance: int) -> None:
        found, asked_at = await self._streams("/current" + (f"?{self._path}" if self._path else ""))
        if found.number("instanceId") != instance:
            raise _RestartedError("the agent started again between two answers")
        self._instance = instance
        size = found.header.get("bufferSize", "")
        self._count = min(_COUNT, int(size)) if size.isdigit() and 0 < len(size) < 10 else _COUNT
        self._count = max(self._count, 1)
        self.last = {}
        self._take(found, asked_at, found.number("nextSequence"))

    def _take(self, found: AgentDocument, asked_at: float, following: int) -> None:
        newest: dict[str, tuple[int, AgentElement]] = {}
        for element in found.observations:
            number = _sequence(element)
            known = element.attributes["dataItemId"]
            if known not in newest or number >= newest[known][0]:
                newest[known] = number, element
        # an answer that repeats what is older than it was asked for brings nothing new
        for known, (number, element) in newest.items():
            if known not in self.last or number >= _sequence(self.last[known]):
                self.last[known] = element
        self._next, self.asked_at = following, asked_at
        self.made_at = found.header.get("creationTime", "")
        self.test = found.header.get("testIndicator", "false").strip().lower() in ("true", "1")

    async def _streams(self, target: str) -> tuple[AgentDocument, float]:
        return await self._get(target, "MTConnectStreams", self._config.timeout, MOST_BYTES)

    async def _get(
        self, target: str, root: str, seconds: float, most: int
    ) -> tuple[AgentDocument, float]:
        answer = await self._exchange.ask(self._config.path + target, seconds, most)
        short = target.partition("?")[0]
        try:
            found = await document_of(answer.body, self._wanted)
        except LinkProtocolError as error:
            status = "" if answer.status == 200 else f"HTTP {answer.status}, "
            raise LinkProtocolError(f"{short}: {status}{error}") from None
        if found.root == "MTConnectError":
            said = "; ".join(f"{code[:80]}: {text[:200]}" for code, text in found.errors[:3])
            codes = frozenset(code for code, _ in found.errors)
            raise _RefusedError(f"{short}: the agent refuses: {said or 'no reason'}", codes)
        if answer.status != 200 or found.root != root:
            raise LinkProtocolError(f"{short}: HTTP {answer.status} with {found.root}")
        return found, answer.asked_at

    def _check(self, probe: AgentDocument) -> None:
        """See that each data item is there, and of no other unit than is configured."""
        for name, channel in self._config.channels.items():
            item = probe.items.get(channel.data)
            if item is None:
                raise LinkConfigError(
                    f"link {self._name}: channel {name}: the agent has no data item "
                    f"{channel.data!r}: see {self._config.url}/probe",
                    ("channels", name, "data"),
                )
            stated = item.get("units", "").strip()
            # scaled, the unit is that of what it becomes
            plain = (channel.scale, channel.offset) == (1.0, 0.0)
            unit = channel.unit if self._config.units and plain else ""
            if unit and stated and units.contradicts(unit, stated):
                raise LinkConfigError(
                    f"link {self._name}: channel {name}: unit {unit!r}, but the agent "
                    f"states {stated[:80]!r} for {channel.data}",
                    ("channels", name, "unit"),
                )


def _sequence(element: AgentElement) -> int:
    text = element.attributes.get("sequence", "")
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise LinkProtocolError(
            f"{element.name[:80]}: sequence: expected a number, found {text[:80]!r}"
        )
    return int(text)
