"""Settings of a serial port, shared by every link that has one."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

SCHEMES = ("serial", "socket", "rfc2217", "hwgrep", "loop", "spy", "alt", "cp2110")
"""What may stand before ``://`` in a port: pyserial's own handlers, and ``serial://`` a path."""


class SerialSettings(BaseModel):
    """Speed and shape of the characters on a serial line, as the devices on it are set."""

    baudrate: Annotated[int, Field(ge=50)] = 9600
    """bit/s."""
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    bytesize: Literal[7, 8] = 8

    @property
    def character_time(self) -> float:
        """Time in s of one character on the line: start, data, parity and stop bits."""
        bits = 1 + self.bytesize + (self.parity != "N") + self.stopbits
        return bits / self.baudrate


class PortSettings(SerialSettings):
    """Which port, and who stops whom."""

    port: Annotated[str, Field(min_length=1)]
    """A path, or a URL of pyserial's: ``socket://192.168.0.7:4001``."""
    flow: Literal["none", "xonxoff", "rtscts", "dsrdtr"] = "none"

    @property
    def path_or_url(self) -> str:
        """What pyserial opens: ``serial://`` in front of a path is taken off."""
        return self.port.removeprefix("serial://")

    @model_validator(mode="after")
    def _port_is_known(self) -> PortSettings:
        scheme, colon, _ = self.port.partition("://")
        if colon and scheme not in SCHEMES:
            raise ValueError(
                f"port {self.port!r}: {scheme}:// is not known; there are: "
                + ", ".join(f"{name}://" for name in SCHEMES)
            )
        return self
