"""The configuration section of a store on a serial line; ``docs/upload.md`` is the user's page."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from abbe.drivers.serial.checksum import ChecksumConfig
from abbe.drivers.serial.config import LineConfig
from abbe.drivers.serial.patterns import checked
from abbe.drivers.serial.port.settings import PortSettings
from abbe.drivers.serial.tape import TapeSettings
from abbe.drivers.stores.base import StoreConfig

MEMORY = ("staged_length", "staged_crc", "active_length", "active_crc")
"""Fields of the answer about the table memory."""
_FIELDS = {
    "identity": ("name", "serial"),
    "state": ("idle", "referenced", "protected"),
    "memory": MEMORY,
    "shown": ("shown",),
}


class Texts(StoreConfig):
    """The commands of a control, with ``{length}`` and ``{crc}`` put in, and answer patterns."""

    identity: str = "ID?"
    identity_answer: str = r"ID (?P<name>[^;]+);(?P<serial>[^;]*)"
    state: str = "STATE?"
    state_answer: str = (
        r"STATE IDLE=(?P<idle>[01]) REFERENCED=(?P<referenced>[01]) PROTECTED=(?P<protected>[01])"
    )
    memory: str = "TABLES?"
    memory_answer: str = (
        r"TABLES STAGED=(?P<staged_length>\d+),(?P<staged_crc>[0-9A-F]{8}) "
        r"ACTIVE=(?P<active_length>\d+),(?P<active_crc>[0-9A-F]{8})"
    )
    """Bytes and CRC-32 of what is staged (CRC 0 while it is not whole) and of what is active."""
    receive: str = "RECEIVE {length} {crc:08X}"
    """Empties the staging area and reads a tape into it; answered by DC1."""
    send_staged: str = "SEND STAGED"
    send_active: str = "SEND ACTIVE"
    """Answered by the tape."""
    activate: str = "ACTIVATE {length} {crc:08X}"
    activate_answer: str = "ACTIVATED"
    discard: str = "DISCARD"
    discard_answer: str = "DISCARDED"
    deactivate: str = "DEACTIVATE"
    deactivate_answer: str = "DEACTIVATED"
    shown: str | None = "SHOW?"
    """None: the control shows no corrections."""
    shown_answer: str = r"SHOW (?P<shown>.+)"
    """``X,1,123.4,-0.0012;Y,...``: axis, direction, position and correction in mm."""
    refused: str = r"ERROR .*"
    abort: str = "\x18"
    """Ends a transfer that was cut off; sent before anything else. Empty: there is none."""

    @model_validator(mode="after")
    def _patterns_have_their_fields(self) -> Texts:
        for name, fields in _FIELDS.items():
            try:
                found = checked(getattr(self, f"{name}_answer")).fields
            except ValueError as error:
                raise ValueError(f"{name}_answer: {error}") from None
            missing = [field for field in fields if field not in found]
            if missing:
                raise ValueError(f"{name}_answer has no field (?P<{missing[0]}>...)")
        return self


class SerialStoreConfig(StoreConfig, PortSettings):
    """A control's serial port and what is said on it. Times are in s."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    timeout: Annotated[float, Field(gt=0, le=60)] = 2.0
    """For an answer to begin."""
    command_timeout: Annotated[float, Field(gt=0, le=60)] = 20.0
    """For the control to activate."""
    late_reply_max: Annotated[float, Field(gt=0)] = 1.0
    """After a query beyond which its answer cannot come any more."""
    stall_timeout: Annotated[float, Field(gt=0)] = 30.0
    """Longest pause within a tape."""
    attempts: Annotated[int, Field(ge=1, le=20)] = 4
    """How often a question, or a read-back, is tried."""
    terminator: str = "\r\n"
    run_on: Annotated[int, Field(ge=1, le=4096)] = 8
    """Characters that may still come after a DC3."""
    checksum: ChecksumConfig | None = ChecksumConfig(kind="xor", after="*")
    """Of every line; none: lines carry none."""
    texts: Texts = Texts()

    def line(self, timeout: float | None = None) -> LineConfig:
        """For questions and answers."""
        return LineConfig(
            **_port(self),
            timeout=timeout or self.timeout,
            late_reply_max=self.late_reply_max,
            terminator=self.terminator,
            max_line=1024,
        )

    def tape(self) -> TapeSettings:
        """For tapes."""
        return TapeSettings(
            **_port(self),
            verify="checksum",
            run_on=self.run_on,
            start_timeout=self.timeout,
            stall_timeout=self.stall_timeout,
            resume_within=0.0,
        )

    @model_validator(mode="after")
    def _can_be_a_tape(self) -> SerialStoreConfig:
        self.line()
        self.tape()
        return self


def _port(config: SerialStoreConfig) -> dict[str, Any]:
    return {key: getattr(config, key) for key in PortSettings.model_fields}
