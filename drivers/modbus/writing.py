"""Writing channels over a Modbus bus: values checked, sent in order, read back where asked."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    TooLateError,
    WriteNotVerifiedError,
)
from abbe.drivers.modbus.bus.bus import Bus
from abbe.drivers.modbus.bus.refusals import ModbusExceptionError
from abbe.drivers.modbus.codec import NotRepresentableError
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.plan import WritePlan, WriteRequest, write_plan

_NOT_TAKEN = (1, 2, 3, 6, 8)
"""Exceptions with which a device says that it has not written anything (Modbus Application
Protocol V1.1b3, 7)."""
_PLANS = 64
"""Sets of channels whose requests are kept; a daemon has a handful."""


class ModbusWriter:
    """The writer of Modbus channels, in batches.

    Parameters
    ----------
    name
        The link's name, for messages.
    config
        The link's section; every name that is written must be in it.
    bus
        Where to write.
    """

    def __init__(self, name: str, config: ModbusConfig, bus: Bus) -> None:
        self._name = name
        self._config = config
        self._bus = bus
        self._plans: dict[tuple[str, ...], WritePlan] = {}

    def plans(self, names: tuple[str, ...]) -> bool:
        """Whether this set was written before, and so is known to be in the configuration."""
        return names in self._plans

    async def write(
        self, names: tuple[str, ...], values: Mapping[str, float], until: float
    ) -> None:
        """As the link's `write`; `names` are the keys of `values`, in order."""
        plan = self._plans.get(names) or self._plan(names)
        try:
            raw = {name: to_raw(values[name]) for name, to_raw in plan.writers}
        except NotRepresentableError:
            raise self._none_of(plan, values) from None
        done: list[str] = []
        going: tuple[str, ...] = ()
        try:
            async with self._bus.bus_lock:
                for request in plan.requests:
                    going = request.names
                    await self._write_one(request, [raw[name] for name in going], until)
                    done += going
        except LinkError as exc:
            left = [name for name in names if name not in done]
            kept = set(left) - set(going) | (exc.untouched and set(going))
            written = f"; written before: {', '.join(done)}" if done else ""
            raise _same_kind(exc)(
                f"link {self._name}: not written: {', '.join(left)}: {exc}{written}"
            ).leaving(kept, (*done, *exc.written)) from exc

    def _none_of(self, plan: WritePlan, values: Mapping[str, float]) -> LinkError:
        """The error of a batch of which some value does not fit: each that does not, and why."""
        wrong = []
        for name, to_raw in plan.writers:
            try:
                to_raw(values[name])
            except NotRepresentableError as exc:
                unit = self._config.channels[name].unit
                wrong.append(f"{name}: {exc}{' ' if unit else ''}{unit}")
        nothing = LinkError(f"link {self._name}: nothing written; {'; '.join(wrong)}")
        return nothing.leaving(untouched=values)

    async def _write_one(
        self, request: WriteRequest, numbers: Sequence[float], until: float
    ) -> None:
        bus = self._bus
        unit = bus.units[request.span.unit]
        if why := unit.refusal(time.monotonic()):
            raise LinkTimeoutError(why).leaving(untouched=request.names)
        words = request.encode(numbers)
        try:
            await bus.write(request.span, words, until)
        except ModbusExceptionError as exc:
            # a device that failed while it wrote (4), or is still at it (5), may have taken it
            raise exc.leaving(request.names if exc.code in _NOT_TAKEN else ()) from None
        except TooLateError as exc:
            raise exc.leaving(request.names) from None
        if not request.verify:
            return
        found = request.found(await bus.read(request.span))
        wrong = [
            f"{name}: wrote {_words(words[place])}, device holds {_words(found[place])}"
            for name, place in request.verify
            if tuple(words[place]) != tuple(found[place])
        ]
        if wrong:
            raise WriteNotVerifiedError("; ".join(wrong))

    def _plan(self, names: tuple[str, ...]) -> WritePlan:
        fixed = [name for name in names if not self._config.channels[name].writable]
        if fixed:
            raise LinkError(
                f"link {self._name}: nothing written; not writable: {', '.join(fixed)} "
                "(set writable = true)"
            ).leaving(untouched=names)
        if len(self._plans) >= _PLANS:
            self._plans.clear()
        plan = self._plans[names] = write_plan(self._config, names)
        return plan


def _words(words: Sequence[float]) -> str:
    return " ".join(f"{int(word):#06x}" for word in words)


def _same_kind(error: LinkError) -> Callable[[str], LinkError]:
    """The contract's class of an error, for saying it again with more context."""
    kinds: tuple[type[LinkError], ...] = (
        LinkDownError,
        LinkTimeoutError,
        LinkProtocolError,
        TooLateError,
        WriteNotVerifiedError,
    )
    return next((kind for kind in kinds if isinstance(error, kind)), LinkError)
