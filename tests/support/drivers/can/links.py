"""What the tests of CAN links share: configurations, opening, waiting.

Every wait that must succeed is longer than anybody may stall (a second); where one must fail, the
test says so and waits until it has.
"""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

import abbe.drivers.simulated.can
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from tests.support.drivers.opening import opened, until

STALL = 1.5
"""s of silence that are no fault: longer than a process may be stalled."""
DBC = Path(abbe.drivers.simulated.can.__file__).with_name("machine.dbc")
PATIENT = {"timeout": STALL, "reconnect_min": 0.02, "reconnect_max": 0.1, "quarantine_max": 0.5}
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


def free_port() -> int:
    """A UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
        return port


def dbc_section(
    channels: dict[str, Any], messages: Mapping[str, Any] | None = None, **settings: Any
) -> dict[str, Any]:
    """A link's section without its interface; what comes by itself may be late by a stall."""
    used = {c["message"] for c in channels.values() if not c.get("writable")}
    patient = {name: {"within": STALL} for name in used} | dict(messages or {})
    return {"dbc": str(DBC), "channels": channels, "messages": patient} | PATIENT | settings


def linked(
    ready: Mapping[str, Any], channels: dict[str, Any], **settings: Any
) -> AbstractAsyncContextManager[DbcLink]:
    """An open link on a simulated bus."""
    section = interface(ready) | dbc_section(channels, **settings)
    return opened(DbcLink("bench", DbcConfig.model_validate(section)))


async def all_good(link: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """The first samples that are all good."""
    found: dict[str, Any] = {}

    async def good() -> bool:
        found.update(await link.read(names))
        return all(s.good for s in found.values())

    await until(good)
    return found


FD_DBC = """VERSION ""

NS_ :

BS_:

BU_: Abbe Box

BO_ 5 ARRAY: 64 Box
 SG_ first : 0|32@1- (0.001,0) [0|0] "mm" Abbe
 SG_ last : 487|32@0- (0.5,0) [0|0] "um" Abbe

BO_ 2147483654 LONG: 12 Abbe
 SG_ sent : 64|32@1- (1,0) [0|0] "" Box

BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","r","J1939PG","r","r","r","r","r","r",\
"r","r","r","r","StandardCAN_FD","ExtendedCAN_FD";
BA_DEF_ BO_ "CANFD_BRS" ENUM "0","1";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "CANFD_BRS" "0";
BA_ "VFrameFormat" BO_ 5 14;
BA_ "VFrameFormat" BO_ 2147483654 15;
BA_ "CANFD_BRS" BO_ 2147483654 1;
"""
"""CAN FD: 64 bytes with a short id, and, sent with a fast data phase, 12 bytes with a long one."""
