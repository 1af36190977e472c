"""What the tests of the LinuxCNC link share."""

from __future__ import annotations

import asyncio
from contextlib import AbstractAsyncContextManager
from typing import Any

from abbe.drivers.linuxcnc.config import LinuxCncConfig
from abbe.drivers.linuxcnc.link import LinuxCncLink
from tests.support.drivers.linuxcnc.machine import Machine
from tests.support.drivers.opening import opened, until

CHANNELS: dict[str, Any] = {
    "x": {"pin": "joint.0.pos-cmd", "unit": "mm"},
    "y": {"pin": "joint.1.pos-cmd", "unit": "mm"},
    "motor_x": {"pin": "joint.0.motor-pos-cmd", "unit": "mm"},
    "motor_y": {"pin": "joint.1.motor-pos-cmd", "unit": "mm"},
    "motor_um": {"pin": "joint.0.motor-pos-cmd", "unit": "um", "scale": 1000.0},
    "speed": {"pin": "joint.0.vel-cmd"},
    "offset_x": {"offset": "X", "max": 0.5},
    "offset_y": {"offset": "Y", "max": 0.5},
    "state": {"word": "state"},
    "nonsense": {"pin": "joint.0.no-such-pin"},
}
PATIENT = {"timeout": 10.0, "servo_silence": 10.0, "lease": 60.0}
"""Where nothing is meant to be late: on a busy computer everything is."""
ON, HOMED, IN_POSITION, ACTIVE, LIMITED = (1 << bit for bit in range(5))


def linked(**settings: Any) -> AbstractAsyncContextManager[LinuxCncLink]:
    section = {"channels": CHANNELS, "reconnect_min": 0.05, "reconnect_max": 0.2, "ramp": 0.2}
    return opened(LinuxCncLink("mill", LinuxCncConfig.model_validate(section | settings)))


async def value(link: LinuxCncLink, name: str) -> float:
    return (await link.read((name,)))[name].value


async def reaches(link: LinuxCncLink, name: str, wanted: float, off: float = 1e-5) -> None:
    async def near() -> bool:
        return abs(await value(link, name) - wanted) <= off

    await until(near)


async def ordered(machine: Machine, *words: Any) -> list[str]:
    return await asyncio.to_thread(machine.order, *words)
