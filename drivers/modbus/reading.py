"""Reading channels over a Modbus bus: which requests a call needs, and samples of the answers."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    Quality,
    Sample,
    good_samples,
)
from abbe.drivers.modbus.bus.bus import Bus
from abbe.drivers.modbus.bus.refusals import ModbusExceptionError
from abbe.drivers.modbus.bus.units import Unit
from abbe.drivers.modbus.codec import NotRepresentableError
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.dividing import Dividing, groups_of
from abbe.drivers.modbus.plan import ReadRequest, Together, read_plan

_NAN = float("nan")
_PLANS = 64
"""Sets of channels whose requests are kept; a daemon has a handful."""
_SILENCES = 2
"""Units that one call waits for in vain before it gives up on the rest."""


@dataclass(slots=True)
class _ChannelSet:
    """One set of channels that is read together.

    Attributes
    ----------
    always
        Channels read at every call.
    paced
        Per slow block and unit: s between reads, the channels, the unit.
    requests
        Which blocks are due (a bit each) → the requests of a call that reads those.
    """

    always: tuple[str, ...]
    paced: tuple[tuple[float, tuple[str, ...], Unit], ...]
    requests: dict[int, tuple[ReadRequest, ...]] = field(default_factory=dict)


class ModbusReader:
    """The reader of Modbus channels: sets of names in, samples out.

    Parameters
    ----------
    name
        The link's name, for the log.
    config
        The link's section; every name that is asked for must be in it.
    bus
        Where to ask.
    """

    def __init__(self, name: str, config: ModbusConfig, bus: Bus) -> None:
        self._name = name
        self._config = config
        self._bus = bus
        self._epoch = 0
        self._last: dict[str, Sample] = {}
        self._together: Together = ()
        self._dividing = Dividing(name, config, ())
        self._views: dict[tuple[str, ...], _ChannelSet] = {}

    def plans(self, names: tuple[str, ...]) -> bool:
        """Whether this set was asked for before, and so is known to be in the configuration."""
        return names in self._views

    def keep_together(self, names: Collection[str]) -> int:
        """Never read these apart from now on; in how many requests they are read."""
        self._together = groups_of((*self._together, frozenset(names)))
        self._dividing = Dividing(self._name, self._config, self._together)
        self._views.clear()
        return len(read_plan(self._config, tuple(names), (), self._together))

    async def read(self, names: tuple[str, ...]) -> dict[str, Sample]:
        """As `abbe.drivers.modbus.link.ModbusLink.read`."""
        bus = self._bus
        try:
            async with bus.bus_lock:
                if bus.reconnector.epoch != self._epoch:
                    self._begin_epoch(bus.reconnector.epoch)
                view = self._views.get(names) or self._view(names)
                await self._read_all(self._due(view))
                if self._dividing.cuts and await self._dividing.retry(bus.read):
                    self._views.clear()
                last = self._last
                return dict(zip(names, map(last.__getitem__, names), strict=True))
        except LinkError as exc:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(exc))
            return dict.fromkeys(names, lost)

    async def _read_all(self, requests: Sequence[ReadRequest]) -> None:
        """Ask all requests and keep the samples; units in trouble come last and cost little."""
        bus, units = self._bus, self._bus.units
        silences = 0
        if len(requests) > 1 and any(unit.failures for unit in units.values()):
            requests = sorted(requests, key=lambda r: units[r.span.unit].failures)
        for request in requests:
            unit = units[request.span.unit]
            if unit.failures and (why := unit.refusal(time.monotonic())):
                self._mark(request, Quality.UNAVAILABLE, why)
                continue
            if silences and (unit.failures or silences >= _SILENCES):
                why = unit.why or "not asked: other units kept the bus waiting"
                self._mark(request, Quality.UNAVAILABLE, why)
                continue
            try:
                answer = await bus.read(request.span)
            except LinkProtocolError as exc:
                self._mark(request, Quality.BAD, str(exc))
                if isinstance(exc, ModbusExceptionError) and len(request.names) > 1:
                    await self._divide(request, exc)
            except LinkTimeoutError as exc:
                silences += 1
                self._mark(request, Quality.UNAVAILABLE, str(exc))
            except LinkDownError:
                break
            else:
                self._dividing.answered(request.span)
                self._keep(request, answer, bus.client.asked_at)
                continue
        if not bus.reconnector.up:
            raise bus.reconnector.down_error()

    def _keep(self, request: ReadRequest, answer: bytes, at: float) -> None:
        last, numbers = self._last, request.decode(answer)
        try:
            # all of them good is by far the most frequent answer, so a short way
            values = request.values(numbers)
        except NotRepresentableError:
            for name, reader, raw in zip(request.names, request.readers, numbers, strict=True):
                try:
                    last[name] = Sample(reader(raw), at)
                except NotRepresentableError as exc:
                    last[name] = Sample(_NAN, at, Quality.BAD, f"{name}: {exc}")
        else:
            last.update(zip(request.names, good_samples(values, at), strict=True))

    def _mark(self, request: ReadRequest, quality: Quality, why: str) -> None:
        sample = Sample(_NAN, time.monotonic(), quality, why)
        for name in request.names:
            self._last[name] = sample

    async def _divide(self, request: ReadRequest, refusal: ModbusExceptionError) -> None:
        """Have a refused request read in parts from the next call on, where that is proved."""
        try:
            if await self._dividing.divide(request, refusal, self._bus.read):
                self._views.clear()
        except LinkError:
            # silence while trying: the unit has taken note, and the next call shows it
            return

    def _due(self, view: _ChannelSet) -> tuple[ReadRequest, ...]:
        """Requests of a call: all that is read always, and the slow blocks whose time has come."""
        mask = 0
        if view.paced:
            now = time.monotonic()
            last = self._last
            for i, (every, names, unit) in enumerate(view.paced):
                if unit.failures or any(
                    (sample := last.get(name)) is None
                    or sample.quality is Quality.UNAVAILABLE
                    or now - sample.time >= every
                    for name in names
                ):
                    mask |= 1 << i
        requests = view.requests.get(mask)
        if requests is None:
            names = view.always
            for i, (_, more, _) in enumerate(view.paced):
                if mask >> i & 1:
                    names += more
            if len(view.requests) >= _PLANS:
                view.requests.clear()
            requests = view.requests[mask] = read_plan(
                self._config, names, self._dividing.cuts, self._together
            )
        return requests

    def _begin_epoch(self, epoch: int) -> None:
        """Forget what was learned on an earlier connection: the device may be another."""
        self._epoch = epoch
        self._last.clear()
        self._dividing.forget()
        self._views.clear()

    def _view(self, names: tuple[str, ...]) -> _ChannelSet:
        config = self._config
        paced: dict[tuple[str, int], list[str]] = {}
        always = []
        for name in dict.fromkeys(names):
            if config.period_of(name) > 0:
                group = config.channels[name].block, config.unit_of(name)
                paced.setdefault(group, []).append(name)
            else:
                always.append(name)
        view = _ChannelSet(
            tuple(always),
            tuple(
                (config.blocks[block].every, tuple(members), self._bus.units[unit])
                for (block, unit), members in paced.items()
            ),
        )
        if len(self._views) >= _PLANS:
            self._views.clear()
        self._views[names] = view
        return view
