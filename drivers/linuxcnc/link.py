"""The LinuxCNC link: HAL pins read, live corrections written as external offsets.

LinuxCNC runs on the same computer; a bridge process (`abbe.drivers.linuxcnc.bridge`) of the
system's Python is part of its HAL and ends with it.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

from abbe.drivers import resources
from abbe.drivers.batch import Batch
from abbe.drivers.bus_lock import BusLock
from abbe.drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    Quality,
    Sample,
    TooLateError,
    WirePlace,
    WriteNotVerifiedError,
)
from abbe.drivers.linuxcnc.config import STATE_BITS, LinuxCncConfig
from abbe.drivers.linuxcnc.probing import LinuxCncProbe
from abbe.drivers.linuxcnc.process import BridgeProcess
from abbe.drivers.reconnect import Reconnector
from abbe.drivers.touch_probe import TouchingLink, TouchProbe

logger = logging.getLogger("abbe.drivers.linuxcnc")

_NAN = float("nan")
_ROTARY = "ABC"


class LinuxCncLink(Link, TouchingLink):
    """A running LinuxCNC.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = LinuxCncConfig

    def __init__(self, name: str, config: LinuxCncConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._reconnector = Reconnector(
            f"link {name} (LinuxCNC)",
            config,
            self.status,
            self._connect,
            self._disconnect,
            logger,
        )
        self._bus_lock = BusLock(self._reconnector, config.max_waiting)
        self._bridge: BridgeProcess | None = None
        self._probe = LinuxCncProbe(f"link {name} (LinuxCNC)", config)
        self._units_per_mm = 1.0
        self._pins = {name: self._pins_of(name) for name in config.channels}
        self._scaled = {name: section.scaled for name, section in config.channels.items()}

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → pin, or axis whose offset it is, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, whether it is written, and an offset's range and step."""
        section = self._config.channels[channel]
        if section.offset is not None and section.max is not None:
            return ChannelInfo(
                "deg" if section.offset in _ROTARY else "mm",
                writable=True,
                low=-section.max,
                high=section.max,
                step=section.resolution,
                read_back=True,
            )
        if section.word is not None:
            return ChannelInfo(low=0.0, high=float((1 << len(STATE_BITS)) - 1), step=1.0)
        return ChannelInfo(section.unit)

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Its pins; of an offset also those by which it is set."""
        pins = list(self._pins[channel])
        if self._config.channels[channel].offset is not None:
            pins += [f"{pins[0]}-{part}" for part in ("request", "counts", "scale", "enable")]
        return tuple(WirePlace(self.owns[0], space=(pin,), apart=(True,)) for pin in pins)

    @property
    def owns(self) -> tuple[str, ...]:
        """The LinuxCNC of this computer."""
        return (resources.linuxcnc(),)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """All channels of a call come in one answer, read within some ten microseconds."""
        self._check_known(channels, self._config.channels)

    async def open(self) -> None:
        """Attach to LinuxCNC, or begin to wait for it to be started."""
        await self._reconnector.open()

    async def close(self) -> None:
        """Detach; offsets that are not zero are taken back first."""
        await self._probe.close()
        await self._reconnector.close()
        bridge, self._bridge = self._bridge, None
        if bridge is not None:
            await bridge.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read pins, all in one request.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        self._check_known(channels, self._config.channels)
        pins = list(dict.fromkeys(pin for name in channels for pin in self._pins[name]))
        try:
            async with self._bus_lock:
                said = await self._ask({"read": pins})
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(channels, lost)
        values = dict(zip(pins, said["values"], strict=True))
        return {name: self._sample(name, values, said["why"], said["at"]) for name in channels}

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Set external offsets, mm (degrees), not after `until`; returns when LinuxCNC has them.

        It moves there with its own share of speed and acceleration (``OFFSET_AV_RATIO``), which may
        take longer; reading the channel tells what is applied.

        Raises
        ------
        LinkError
            When a channel is no offset, or a value is beyond its ``max``: nothing was written.
        WriteNotVerifiedError
            When LinuxCNC did not take an offset up (off, not homed), or holds it back at a soft
            limit; says how much is applied.
        LinkDownError, LinkTimeoutError
            When LinuxCNC, or the bridge, is gone.
        """
        if not values:
            return
        self._check_known(values, self._config.channels)
        batch, orders = Batch(f"link {self.name}", values), dict[str, float]()
        for name, value in values.items():
            section = self._config.channels[name]
            if section.offset is None or section.max is None:
                raise batch.refused(f"{name} is no offset")
            if not abs(value) <= section.max:
                raise batch.refused(f"{name}: {value:g} is beyond max = {section.max:g}")
            orders[section.offset.lower()] = float(value)
        try:
            async with self._bus_lock:
                batch.begin(*values)
                # what is in the pipe when the answer is given up is not to be carried out later
                last = min(until, time.monotonic() + self._config.timeout)
                said = await self._ask({"set": orders, "until": last})
        except (TooLateError, LinkProtocolError) as error:
            raise batch.failed(error.leaving(untouched=values)) from error
        except LinkError as error:
            raise batch.failed(error) from error
        self._verify(values, said)

    def touch_probe(self) -> TouchProbe:
        """The machine's own probe; only who asks for it has the machine moved."""
        return self._probe

    def _verify(self, values: Mapping[str, float], said: Mapping[str, Any]) -> None:
        wrong = {}
        for name, value in values.items():
            section = self._config.channels[name]
            now = said["set"][str(section.offset).lower()]
            request, applied = now["request"], now["applied"]
            if abs(request - value) > section.resolution:
                wrong[name] = f"{name}: wrote {value:g}, LinuxCNC has {request:g}: {said['why']}"
            elif said["limited"] and abs(applied - value) > section.resolution:
                wrong[name] = f"{name}: wrote {value:g}, a soft limit lets {applied:g} through"
        if wrong:
            raise WriteNotVerifiedError(f"link {self.name}: {'; '.join(wrong.values())}").leaving(
                written=values.keys() - wrong.keys()
            )

    async def _ask(self, order: dict[str, Any]) -> dict[str, Any]:
        bridge, status = self._bridge, self.status
        if bridge is None:
            raise self._reconnector.down_error()
        status.requests += 1
        began = time.monotonic()
        try:
            said = await bridge.ask(order, self._config.timeout)
        except LinkProtocolError:
            status.failures += 1
            raise
        except (LinkTimeoutError, LinkDownError) as error:
            status.failures += 1
            self._reconnector.lost(str(error))
            raise
        status.round_trip = time.monotonic() - began
        return said

    def _pins_of(self, name: str) -> tuple[str, ...]:
        section = self._config.channels[name]
        if section.word is not None:
            return tuple(STATE_BITS)
        if section.offset is not None:
            return (f"axis.{section.offset.lower()}.eoffset",)
        return (str(section.pin),)

    def _sample(
        self, name: str, values: Mapping[str, float], why: Mapping[str, str], at: float
    ) -> Sample:
        for pin in self._pins[name]:
            if pin in why:
                return Sample(_NAN, at, Quality.BAD, f"{pin}: {why[pin]}")
        value = self._value(name, values)
        if value - value != 0.0:
            return Sample(_NAN, at, Quality.BAD, f"{self._pins[name][0]} is {value}")
        return Sample(value, at)

    def _value(self, name: str, values: Mapping[str, float]) -> float:
        section = self._config.channels[name]
        if section.word is not None:
            return float(sum(bool(values[pin]) << bit for pin, bit in STATE_BITS.items()))
        (pin,) = self._pins[name]
        if section.offset is not None:
            rotary = section.offset in _ROTARY
            return values[pin] if rotary else values[pin] / self._units_per_mm
        return self._scaled[name].value_of(values[pin])

    async def _connect(self) -> None:
        """Start a bridge once the last one has ended."""
        bridge, self._bridge = self._bridge, None
        if bridge is not None:
            await bridge.close()
        config = self._config
        settings = {
            "offsets": {
                str(section.offset).lower(): {"scale": section.resolution, "max": section.max}
                for section in config.channels.values()
                if section.offset is not None
            },
            "lease": config.lease,
            "ramp": config.ramp,
            "servo_silence": config.servo_silence,
        }
        self._bridge = BridgeProcess(config.python, settings, self._reconnector.lost)
        ready = await self._bridge.start()
        self._units_per_mm = float(ready["units_per_mm"])
        logger.info("link %s: LinuxCNC runs %s", self.name, ready["ini"])

    def _disconnect(self) -> None:
        if self._bridge is not None:
            self._bridge.abandon()

    def _describe(self, name: str) -> str:
        section = self._config.channels[name]
        if section.word is not None:
            return "state word: on 0, homed 1, in position 2, offset active 3, limited 4"
        if section.offset is not None:
            return (
                f"external offset of axis {section.offset}, at most ±{section.max:g}, "
                f"in steps of {section.resolution:g}"
            )
        parts = [f"pin {section.pin}"]
        parts += section.scaled.scaling
        if section.unit:
            parts.append(f"in {section.unit}")
        return ", ".join(parts)
