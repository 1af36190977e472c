"""A run's status as OPC UA variables: where each stands, its value, its status, its moment.

Names are those of the companion specifications where they have one: ``Monitoring`` and
``Notification`` of machine tools (OPC 40501-1), axes with ``ActPos`` of CNC (OPC 40502). What has
none there, the corrected position and its uncertainty, is named in Abbe's words.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta
from typing import Any, Literal, NamedTuple

Kind = Literal["Double", "Boolean", "String", "Int64"]
Value = float | int | bool | str | None

GOOD = "Good"
OLD = "UncertainLastUsableValue"
"""The last sound value; its time stamp says of when."""
PARTLY = "UncertainSubNormal"
"""A correction that is on its way to or from its full size."""
NONE = "BadOutOfService"
"""There is no value: nothing was read, or what was read is not to be believed."""
SILENT = "UncertainNoCommunicationLastUsableValue"
"""The run says nothing any more; this is its last word."""
_OF_GUARD: Mapping[str, str] = {
    "active": GOOD,
    "rising": PARTLY,
    "holding": OLD,
    "falling": PARTLY,
    "off": PARTLY,
}
_LONGEST = 10_000
"""Characters of a text."""


class OfferedValue(NamedTuple):
    """One variable at one moment.

    Attributes
    ----------
    path
        Its names, from below the machine.
    kind
        Its type.
    value
        None: it has none, and a bad status.
    status
        Name of its status code.
    at
        Its source's time stamp.
    unit
        Of its value; empty: none.
    """

    path: tuple[str, ...]
    kind: Kind
    value: Value
    status: str
    at: datetime
    unit: str = ""


def of_status(status: Mapping[str, Any]) -> Iterator[OfferedValue]:
    """All variables of a run's status, as its JSON gives it."""
    at = datetime.fromisoformat(status["at"])
    yield from _of_identification(status, at)
    for name, axis in sorted(status["axes"].items()):
        yield from _of_axis(("Monitoring", "Axes", _word(name)), axis, at)
    for name, signal in sorted(status["signals"].items()):
        value, stale = signal["value"], signal["stale"]
        group = "Temperatures" if signal["temperature"] else "Signals"
        then = _taken(at, signal["age_s"])
        path = ("Monitoring", group, _word(name))
        yield OfferedValue(path, "Double", value, _of_age(value, stale), then, signal["unit"])
    yield from _of_correction(("Monitoring", "Correction"), status, at)
    round_, cycle = ("Monitoring", "Cycle"), status["cycle"]
    yield OfferedValue((*round_, "Alive"), "Boolean", status["alive"], GOOD, at)
    for name, key in (("Median", "median_ms"), ("Percentile99", "p99_ms")):
        yield _known((*round_, name), "Double", cycle[key], at, "ms")
    yield OfferedValue((*round_, "Missed"), "Int64", cycle["missed"], GOOD, at)
    for name, link in sorted(status["links"].items()):
        below = ("Monitoring", "Links", _word(name))
        yield OfferedValue((*below, "State"), "String", link["state"], GOOD, at)
        yield OfferedValue((*below, "Failures"), "Int64", link["failures"], GOOD, at)
        yield OfferedValue((*below, "Reconnects"), "Int64", link["reconnects"], GOOD, at)


def _of_identification(status: Mapping[str, Any], at: datetime) -> Iterator[OfferedValue]:
    below = ("Identification",)
    yield OfferedValue((*below, "ComponentName"), "String", _text(status["machine"]), GOOD, at)
    yield OfferedValue((*below, "SoftwareRevision"), "String", status["abbe"], GOOD, at)
    yield OfferedValue((*below, "Location"), "String", _text(status["owner"]["host"]), GOOD, at)


def _of_axis(
    below: tuple[str, ...], axis: Mapping[str, Any], at: datetime
) -> Iterator[OfferedValue]:
    value, stale, unit = axis["indicated"], axis["stale"], axis["unit"]
    then = _taken(at, axis["age_s"])
    yield OfferedValue((*below, "ActPos"), "Double", value, _of_age(value, stale), then, unit)
    guard = axis["guard"]
    if guard is None:
        return
    fair = _OF_GUARD[guard]
    corrected = axis["corrected"]
    quality = NONE if corrected is None else (OLD if stale else fair)
    yield OfferedValue((*below, "ActPosCorrected"), "Double", corrected, quality, then, unit)
    amount, unit = axis["correction"], axis["correction_unit"]
    quality = NONE if amount is None else fair
    yield OfferedValue((*below, "Correction"), "Double", amount, quality, at, unit)
    # k = 2; a model without covariance has none
    yield _known((*below, "CorrectionUncertainty"), "Double", axis["uncertainty"], at, unit)
    yield OfferedValue((*below, "Guard"), "String", guard, GOOD, at)
    yield OfferedValue((*below, "Written"), "Boolean", axis["written"], GOOD, at)


def _of_correction(
    below: tuple[str, ...], status: Mapping[str, Any], at: datetime
) -> Iterator[OfferedValue]:
    faults = "; ".join(f"{what}: {why}" for what, why in sorted(status["faults"].items()))
    for name, text in (
        ("State", status["state"]),
        ("Faults", faults),
        ("OutsideMeasured", "; ".join(status["beyond"])),
    ):
        yield OfferedValue((*below, name), "String", _text(text), GOOD, at)
    for name, key in (
        ("InFull", "in_full"),
        ("ComputedInFull", "computed_in_full"),
        ("Writes", "writes"),
        ("Ending", "ending"),
    ):
        yield OfferedValue((*below, name), "Boolean", status[key], GOOD, at)
    yield OfferedValue((*below, "StatusWord"), "Int64", status["status_word"]["word"], GOOD, at)
    for name, switch in sorted(status["switches"].items()):
        yield OfferedValue((*below, "Compensations", _word(name)), "String", switch, GOOD, at)
    for name, value in zip("XYZ", status["tool_mm"], strict=True):
        yield OfferedValue((*below, "Tool", name), "Double", value, GOOD, at, "mm")
    if (checks := status.get("checks")) is not None:
        below = ("Monitoring", "Checks")
        yield OfferedValue((*below, "Verdict"), "String", checks["verdict"], GOOD, at)
        yield OfferedValue((*below, "Counted"), "Int64", checks["checks"], GOOD, at)
        yield OfferedValue((*below, "Words"), "String", _text(" ".join(checks["words"])), GOOD, at)


def _known(
    path: tuple[str, ...], kind: Kind, value: Value, at: datetime, unit: str = ""
) -> OfferedValue:
    return OfferedValue(path, kind, value, NONE if value is None else GOOD, at, unit)


def _of_age(value: Value, stale: bool) -> str:
    if value is None:
        return NONE
    return OLD if stale else GOOD


def _taken(at: datetime, age: float | None) -> datetime:
    return at - timedelta(seconds=age or 0.0)


def _word(name: str) -> str:
    """A name as one level of a path."""
    return _text(name)[:200]


def _text(text: str) -> str:
    """A text that UTF-8 can hold, not too long."""
    return text[:_LONGEST].encode("utf-8", "replace").decode("utf-8")
