"""What the tests of CANopen links share."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.link import CanopenLink
from tests.support.drivers.can.links import PATIENT, STALL, interface

ENCODER_NODES: dict[str, Any] = {
    axis: {"id": number, "heartbeat": STALL, "produce_heartbeat": 0.05}
    for axis, number in (("x", 3), ("y", 4), ("z", 5))
}
BY_SDO: dict[str, Any] = {
    axis: {"node": axis, "profile": "cia406", "unit": "count"} for axis in "xyz"
}
BY_PDO: dict[str, Any] = {axis: section | {"by": "pdo"} for axis, section in BY_SDO.items()}
INPUTS: dict[str, Any] = {
    f"T{n}": {"node": "t", "profile": "cia404", "input": n, "unit": "degC"} for n in (1, 2, 3, 4)
}
THERMOMETER: dict[str, Any] = {"t": {"id": 6}}
CONTROLLER: dict[str, Any] = {"mill": {"id": 16}}
AXES = ("x", "y", "z")
APART = 1_000_000
"""Counts by which the simulated encoders stand apart at any moment."""


@asynccontextmanager
async def linked(
    ready: Mapping[str, Any], nodes: dict[str, Any], channels: dict[str, Any], **settings: Any
) -> AsyncIterator[CanopenLink]:
    """An open link on a simulated bus."""
    section = {"nodes": nodes, "channels": channels} | interface(ready) | PATIENT | settings
    link = CanopenLink("bench", CanopenConfig.model_validate(section))
    await link.open()
    try:
        yield link
    finally:
        await link.close()
