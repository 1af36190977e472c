"""Readings as a payload's bytes, and the other way as far as commands need it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from google.protobuf.message import DecodeError

from abbe.daemon.mqtt.sparkplug.metrics import (
    BD_SEQ,
    BOOLEAN,
    DOUBLE,
    INT64,
    REBIRTH,
    STRING,
    MetricReading,
)
from abbe.daemon.mqtt.sparkplug.schema import Payload

_FIELDS = {
    INT64: "long_value",
    DOUBLE: "double_value",
    BOOLEAN: "boolean_value",
    STRING: "string_value",
}
_INT32 = 3
_QUALITY, _UNIT = "Quality", "engUnit"
_LONGEST = 100_000
"""Bytes of a command."""


def birth(
    readings: Iterable[MetricReading], aliases: Mapping[str, int], seq: int, now: int
) -> bytes:
    """A birth of a device: each metric with its name, its alias and its type.

    Parameters
    ----------
    readings
        All of them.
    aliases
        Name → alias.
    seq
        The message's number, 0 to 255.
    now
        ms since 1970.
    """
    return _birth(readings, aliases, seq, now).SerializeToString()  # type: ignore[no-any-return]


def node_birth(
    readings: Iterable[MetricReading], aliases: Mapping[str, int], connection: int, now: int
) -> bytes:
    """The birth of the node: number 0, with the connection's number and the way to ask for another.

    Parameters
    ----------
    readings, aliases, now
        As of `birth`.
    connection
        ``bdSeq``, that of the connection's last will.
    """
    payload = _birth(readings, aliases, 0, now)
    _put(payload.metrics.add(name=BD_SEQ), MetricReading(BD_SEQ, INT64, connection, now))
    # it is asked for by its name: a command may come before a birth was heard
    _put(payload.metrics.add(name=REBIRTH), MetricReading(REBIRTH, BOOLEAN, False, now))
    return payload.SerializeToString()  # type: ignore[no-any-return]


def node_death(connection: int, now: int) -> bytes:
    """The death of the node: without a number of its own, since the broker says it."""
    payload = Payload(timestamp=now)
    _put(payload.metrics.add(name=BD_SEQ), MetricReading(BD_SEQ, INT64, connection, now))
    return payload.SerializeToString()  # type: ignore[no-any-return]


def data(
    readings: Iterable[MetricReading],
    aliases: Mapping[str, int],
    seq: int,
    now: int,
    *,
    historical: bool,
) -> bytes:
    """Readings by their aliases; those that no birth has named are left out.

    Parameters
    ----------
    readings, aliases, seq, now
        As of `birth`.
    historical
        Whether they are of before: what is so now has been said by a birth.
    """
    payload = Payload(timestamp=now, seq=seq)
    for reading in readings:
        if (alias := aliases.get(reading.name)) is not None:
            metric = payload.metrics.add(alias=alias)
            if historical:
                metric.is_historical = True
            _put(metric, reading)
    return payload.SerializeToString()  # type: ignore[no-any-return]


def asks_for_rebirth(command: bytes) -> bool:
    """Whether a command to the node asks for all births anew; whatever else it says is not heard.

    Raises
    ------
    ValueError
        When it is no payload.
    """
    if len(command) > _LONGEST:
        raise ValueError(f"a command of {len(command)} bytes")
    try:
        payload = Payload.FromString(command)
    except DecodeError:
        raise ValueError("a command that is no Sparkplug payload") from None
    return any(m.name == REBIRTH and m.boolean_value for m in payload.metrics)


def _birth(
    readings: Iterable[MetricReading], aliases: Mapping[str, int], seq: int, now: int
) -> Any:
    payload = Payload(timestamp=now, seq=seq)
    for reading in readings:
        metric = payload.metrics.add(name=reading.name, alias=aliases[reading.name])
        _put(metric, reading)
        if reading.unit:
            metric.properties.keys.append(_UNIT)
            metric.properties.values.add(type=STRING, string_value=reading.unit)
    return payload


def _put(metric: Any, reading: MetricReading) -> None:
    """A reading's value, moment, type and quality."""
    metric.timestamp = reading.at
    metric.datatype = reading.datatype
    if reading.value is None:
        metric.is_null = True
    else:
        setattr(metric, _FIELDS[reading.datatype], reading.value)
    if reading.name not in (BD_SEQ, REBIRTH):
        metric.properties.keys.append(_QUALITY)
        metric.properties.values.add(type=_INT32, int_value=reading.quality)
