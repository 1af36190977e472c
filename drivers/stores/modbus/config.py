"""The configuration section of a store behind Modbus; ``docs/upload.md`` is the user's page."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from abbe.compcore.validation import in_one_line
from abbe.drivers.modbus.config import ModbusChannelConfig, ModbusConfig
from abbe.drivers.stores.base import StoreConfig
from abbe.drivers.stores.modbus.registers import RegisterMap

_RTU = ("baudrate", "parity", "stopbits", "pause", "local_echo", "late_reply_max")


class ModbusStoreConfig(StoreConfig):
    """A controller's Modbus port and its register map. Times are in s."""

    transport: Literal["tcp", "rtu"] = "tcp"
    host: str | None = None
    port: int | str = 502
    """TCP: port number; RTU: the serial device."""
    unit_id: Annotated[int, Field(ge=0, le=255)] = 1
    baudrate: Annotated[int, Field(ge=50)] = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    pause: Annotated[float, Field(ge=0, le=1)] | None = None
    """RTU, s of silence before a request; more than the protocol's own for slow units."""
    local_echo: bool = False
    """RTU: the adapter hears what it sends (two-wire RS-485 without echo suppression)."""
    late_reply_max: Annotated[float, Field(gt=0, le=60)] = 2.0
    """RTU, s after a request beyond which its reply cannot come any more."""
    timeout: Annotated[float, Field(gt=0, le=60)] = 1.0
    """For one answer."""
    attempts: Annotated[int, Field(ge=1, le=20)] = 4
    """How often a read, or a block, is tried."""
    reconnect_within: Annotated[float, Field(gt=0, le=600)] = 10.0
    """How long a lost connection is waited for."""
    command_timeout: Annotated[float, Field(gt=0, le=600)] = 20.0
    """For the controller to carry a command out."""
    acts_after_restart: bool = False
    """Whether the control reads its tables only when it is switched on."""
    registers: RegisterMap = RegisterMap()

    def link(self) -> ModbusConfig:
        """The same as a link's section."""
        rtu = {
            key: getattr(self, key)
            for key in _RTU
            if self.transport == "rtu" or key in self.model_fields_set
        }
        state = ModbusChannelConfig(table="holding", address=self.registers.state, type="uint16")
        return ModbusConfig.model_validate(
            {
                "transport": self.transport,
                "host": self.host,
                "port": self.port,
                "unit_id": self.unit_id,
                "timeout": self.timeout,
                "reconnect_max": 1.0,
                "channels": {"state": state},
                **rtu,
            }
        )

    @model_validator(mode="after")
    def _can_be_a_link(self) -> ModbusStoreConfig:
        try:
            self.link()
        except ValidationError as error:
            raise ValueError(in_one_line(error)) from None
        return self
