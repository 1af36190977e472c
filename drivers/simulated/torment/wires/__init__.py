"""The protocols, each spoken on raw sockets or pseudo-terminals; found by name."""

from __future__ import annotations

from importlib import import_module

from abbe.drivers.simulated.torment.wires.base import TormentWire

WIRES = {
    "modbus-tcp": "modbus_tcp:ModbusTcp",
    "modbus-rtu": "modbus_rtu:ModbusRtu",
    "serial": "serial_lines:SerialAsked",
    "serial-streaming": "serial_lines:SerialStreaming",
    "can": "can_dbc:CanDbc",
    "canopen": "canopen:Canopen",
    "ipp": "ipp:Ipp",
}
"""Protocol → where it is spoken."""


def wire_class(protocol: str) -> type[TormentWire]:
    """The class that speaks a protocol."""
    module, name = WIRES[protocol].split(":")
    found: type[TormentWire] = getattr(import_module(f"{__name__}.{module}"), name)
    return found


__all__ = ["WIRES", "TormentWire", "wire_class"]
