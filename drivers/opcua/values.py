"""What an OPC UA server says of a variable, as a sample: number, quality, and how old it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime

from asyncua import ua

from abbe.compcore.units import in_digits
from abbe.drivers.link import LinkProtocolError, Quality, Sample
from abbe.drivers.opcua.config import OpcuaChannelConfig, Stamp

_NAN = math.nan
_LIMITED = 0x300
"""Bits of a status code: the value is held at a limit (Part 4, 7.39.1)."""
_INFO_IS_OF_DATA = 0x400
_NOT_MEASURED = {
    ua.StatusCodes.GoodClamped: "clamped",
    ua.StatusCodes.GoodLocalOverride: "overridden by hand",
    ua.StatusCodes.GoodNoData: "no data",
}
"""Good codes of values that nothing measured like this."""
_CODE = 0xFFFF0000
_JITTER = 0.1
"""s by which a value's stamp may be later than its answer's: clocks are read in steps."""

RUNNING = 0
"""`ServerState` of a server whose values mean anything (Part 5, 12.6)."""
_STATES = (
    "Running", "Failed", "NoConfiguration", "Suspended", "Shutdown", "Test", "CommunicationFault",
    "Unknown",
)  # fmt: skip


def of_state(found: ua.DataValue) -> str:
    """Why nothing of the server may be used; empty when it says that it runs."""
    number = found.Value.Value if found.Value is not None else None
    if found.StatusCode is None or not found.StatusCode.is_good():
        # a server that does not offer its state is believed without
        return ""
    if not isinstance(number, int) or number == RUNNING:
        return ""
    name = _STATES[number] if 0 <= number < len(_STATES) else str(int(number))
    return f"the server says of itself: {name}"


def sample_of(
    channel: OpcuaChannelConfig,
    value_of: Callable[[float], float],
    stamp: Stamp,
    found: ua.DataValue,
    asked_at: float,
    made_at: datetime | None,
) -> Sample:
    """One value.

    Parameters
    ----------
    channel
        What is expected.
    value_of
        Its number → its value.
    stamp
        Whose stamp tells its age.
    found
        What the server said.
    asked_at
        When it was asked, monotonic, s.
    made_at
        When it made its answer, by its own clock.

    Returns
    -------
    Sample
        Its time is that of the question, less what the value was old in the server already: both
        times for that are of the server's clock, so that it need not be right.
    """
    try:
        _check(found)
        value = value_of(_number(channel, found))
        if not math.isfinite(value):
            raise LinkProtocolError(f"becomes {value}")
        age = _age(stamp, found, made_at)
    except LinkProtocolError as error:
        return Sample(_NAN, asked_at, Quality.BAD, f"{channel.node}: {error}")
    return Sample(value, asked_at - age)


def _check(found: ua.DataValue) -> None:
    status = found.StatusCode
    if status is None:
        return
    code = status.value
    if not status.is_good():
        raise LinkProtocolError(f"{status.name} (0x{code:08X})")
    if why := _NOT_MEASURED.get(code & _CODE):
        raise LinkProtocolError(f"{why}: {status.name} (0x{code:08X})")
    if code & _INFO_IS_OF_DATA and code & _LIMITED:
        raise LinkProtocolError(f"held at a limit (0x{code:08X})")


def _number(channel: OpcuaChannelConfig, found: ua.DataValue) -> float:
    value = found.Value.Value if found.Value is not None else None
    if isinstance(value, list):
        if channel.item is None:
            raise LinkProtocolError(f"is an array of {len(value)}: say which item")
        if channel.item > len(value):
            raise LinkProtocolError(f"item {channel.item} of an array of {len(value)}")
        value = value[channel.item - 1]
    elif channel.item is not None:
        raise LinkProtocolError("item: is no array")
    if not isinstance(value, (int, float)):
        raise LinkProtocolError(f"is no number: {type(value).__name__}")
    number = float(value)
    if not math.isfinite(number):
        raise LinkProtocolError(f"is {number}")
    return number


def _age(stamp: Stamp, found: ua.DataValue, made_at: datetime | None) -> float:
    """How old a value was, s, when the server answered; by its own clock."""
    if stamp == "none":
        return 0.0
    at = found.ServerTimestamp if stamp == "server" else found.SourceTimestamp
    if at is None or at.year <= 1601 or made_at is None:
        whose = "value" if made_at is not None else "answer"
        raise LinkProtocolError(
            f"its {whose} carries no {stamp} time stamp, so that nobody knows how old it is: "
            "see stamp in docs/opcua.md"
        )
    age: float = (made_at - at).total_seconds()
    if age < -_JITTER:
        raise LinkProtocolError(
            f"its {stamp} time stamp is {in_digits(-age)} s later than the answer itself, so "
            "that nobody knows how old it is: see stamp in docs/opcua.md"
        )
    return max(0.0, age)
