"""What the tests of CAN links share: configurations, opening, waiting."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import drivers.simulated
from drivers.can.dbc_config import DbcConfig
from drivers.can.dbc_link import DbcLink

ROOM = 1.0
"""s that a shared machine may add to any wait."""
DBC = Path(drivers.simulated.__file__).with_name("machine.dbc")
QUICK = {"timeout": 0.3, "reconnect_min": 0.02, "reconnect_max": 0.1, "quarantine_max": 0.5}
READ: dict[str, Any] = {
    "x": {"message": "POSITION", "signal": "position_x"},
    "position_y": {"message": "POSITION"},
    "y_um": {"message": "POSITION", "signal": "position_y", "scale": 1000.0, "unit": "um"},
    "T_left": {"message": "TEMPERATURES"},
    "T_right": {"message": "TEMPERATURES"},
}
CORRECTION: dict[str, Any] = {
    name: {"message": "CORRECTION", "writable": True}
    for name in ("correction_x", "correction_y", "correction_z", "life")
}
Z: dict[str, Any] = {"position_z": {"message": "POSITION_Z"}}
ASK_Z: dict[str, Any] = {"POSITION_Z": {"request": "remote"}}


def interface(ready: Mapping[str, Any]) -> dict[str, Any]:
    """Settings to get onto a simulated bus, from what it said when it was ready."""
    if ready["interface"] == "slcan":
        return {
            "interface": "slcan",
            "channel": ready["channel"],
            "bitrate": 500_000,
            "options": {"sleep_after_open": 0.0},
        }
    return {
        "interface": "udp_multicast",
        "channel": ready["channel"],
        "options": {"port": ready["port"], "hop_limit": 0, "fd": False},
    }


@asynccontextmanager
async def linked(
    ready: Mapping[str, Any], channels: dict[str, Any], **settings: Any
) -> AsyncIterator[DbcLink]:
    section = {"dbc": str(DBC), "channels": channels} | interface(ready) | QUICK | settings
    link = DbcLink("bench", DbcConfig.model_validate(section))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


async def until(
    true: Callable[[], bool] | Callable[[], Awaitable[bool]], limit: float = 15.0
) -> float:
    """Wait for something to become true; how long it took, s."""
    began = time.monotonic()
    while True:
        found = true()
        if found if isinstance(found, bool) else await found:
            return time.monotonic() - began
        assert time.monotonic() - began < limit, "did not happen"
        await asyncio.sleep(0.005)
