"""Addresses of Modbus channels: two names for one register are found before it is written.

Many devices keep one memory behind holding and input registers, and behind coils and discrete
inputs, and answer for any unit id on their TCP port. So all of these count as one memory unless
the user says that they are ``separate`` (``docs/modbus.md``). Whether coils are the bits of
registers no device says in a way that is the same for two of them; they are taken for apart.
"""

from __future__ import annotations

from collections.abc import Iterable

from abbe.drivers import resources
from abbe.drivers.link import ChannelInfo, WirePlace
from abbe.drivers.modbus.codec import raw_range
from abbe.drivers.modbus.config import BIT_TABLES, ModbusConfig


def bus_name(config: ModbusConfig) -> str:
    """The bus as all links spell it: ``tcp 192.168.0.10:502``, ``serial /dev/ttyUSB0``."""
    if config.transport == "rtu":
        port = str(config.port)
        return next(iter(resources.serial(port)), f"serial {port}")
    return resources.tcp(str(config.host), int(config.port))


def owned(config: ModbusConfig, channels: Iterable[str]) -> tuple[str, ...]:
    """What only one process may use: each of the channels' units, or the serial line as a whole."""
    if config.transport == "rtu":
        return (bus_name(config),)
    host, port = str(config.host), int(config.port)
    units = sorted({config.unit_of(name) for name in channels})
    return tuple(dict.fromkeys(resources.modbus(host, port, unit) for unit in units))


def place_of(config: ModbusConfig, name: str) -> WirePlace:
    """Where a channel sits; addresses are those of its table."""
    channel = config.channels[name]
    memory = "bits" if channel.table in BIT_TABLES else "registers"
    return WirePlace(
        f"{bus_name(config)} {memory}",
        channel.address,
        channel.address + channel.width,
        (f"unit {config.unit_of(name)}", channel.table),
        # on a serial line every unit is a device of its own
        (config.transport == "rtu" or "units" in config.separate, "tables" in config.separate),
    )


def info_of(config: ModbusConfig, name: str) -> ChannelInfo:
    """What a channel's section says of its values: unit, range and step of its type."""
    channel = config.channels[name]
    low, high = channel.range_of(*raw_range(channel.number_type))
    return ChannelInfo(
        unit=channel.unit,
        writable=channel.writable,
        every=config.period_of(name),
        low=low,
        high=high,
        step=0.0 if "float" in channel.number_type else abs(channel.scale),
        read_back=channel.writable,
    )
