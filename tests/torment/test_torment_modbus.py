"""The tormented Modbus device does to a write what its script says, and tells no other lie."""

from __future__ import annotations

import random
import struct
import time
from collections.abc import Mapping

import pytest

from abbe.drivers.simulated.torment.judge.evidence import ShownPicture, Taken
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.motion import RandomMotion
from abbe.drivers.simulated.torment.script import Script, Torment
from abbe.drivers.simulated.torment.wires.modbus_pdu import HELD_AT, ModbusDevice

WRITE_STATUS = struct.pack(">BHHBH", 16, HELD_AT, 1, 2, 7)


class Bystander:
    def sent(self, shown: ShownPicture) -> None: ...

    def taken(self, taken: Taken) -> None: ...

    def overwritten(self, now: float) -> None: ...


class Always(Script):
    """One torment that never ends."""

    def __init__(self, kind: str, amount: float) -> None:
        super().__init__("always", (), 10.0)
        self._always = Torment(kind, 0.0, float("inf"), amount)

    def active(self, kind: str, now: float) -> Torment | None:
        return self._always if kind == self._always.kind else None


def answered(kind: str, amount: float) -> tuple[bytes | None, Mapping[str, float]]:
    """What a write of the status word is answered, and what is held then."""
    now = time.monotonic()
    machine = TormentMachine(RandomMotion(random.Random(1), now), Always(kind, amount), Bystander())
    reply = ModbusDevice(machine, 4, (kind,)).reply(WRITE_STATUS, Moment(now, now))
    return None if reply is None else reply.pdu, machine.held


@pytest.mark.parametrize(("amount", "taken"), [(0.1, {"status": 7.0}), (0.9, {})])
def test_an_unanswered_write_gets_no_answer_taken_or_not(
    amount: float, taken: dict[str, float]
) -> None:
    assert answered("write_unanswered", amount) == (None, taken)


def test_a_refused_write_is_refused_and_not_taken() -> None:
    assert answered("write_refused", 0.0) == (bytes((0x90, 4)), {})


def test_a_write_is_taken_and_confirmed() -> None:
    assert answered("late", 1.0) == (WRITE_STATUS[:5], {"status": 7.0})
