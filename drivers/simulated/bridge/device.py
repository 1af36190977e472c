"""The bridge as a Modbus device: registers in, registers out, no protocol.

What a client reads is latched at the moment of reading; what it writes takes effect at once. The
truth for the sample that Abbe echoes is looked up when the echo is written and worked out when
it is read, and both halves of the comparison are answered from one request: no race.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from abbe.drivers.simulated.bridge.machine import AXES
from abbe.drivers.simulated.bridge.plant import Latch, Plant
from abbe.drivers.simulated.bridge.registers import (
    COILS,
    CONTROLLER,
    CORRECTED_COUNTS_PER_MM,
    DISCRETES,
    FAULT,
    INPUT_SIZE,
    MATCHED,
    STATUS_BITS,
    TRUTH,
    WRITE_BACK,
)
from abbe.drivers.simulated.registers import Table

Ranges: TypeAlias = Mapping[Table, tuple[tuple[int, int], ...]]
"""Addresses (first, how many) that exist, by table."""

WATCHDOG = 1.0
"""Abbe's heartbeat must change within this time (s) for the controller to call it alive."""

NOTHING_YET, MATCHED_OK, UNKNOWN_SAMPLE, NO_ECHO = 0, 1, 2, 3
"""Values of `matched_state`."""


class NotWritableError(ValueError):
    """A client wrote to a register that is read-only."""


class RefusedRequestError(ValueError):
    """The device answers with a Modbus exception.

    Attributes
    ----------
    code
        Which.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


@dataclass
class WireFaults:
    """What is wrong with the connection; the server looks here after every request.

    Attributes
    ----------
    silent_until
        No answers before this time (s on the server's clock).
    busy
        So many requests are still to be answered 'device busy'.
    drop
        Close all connections.
    offline
        Stop listening for this long, s.
    answer
        What becomes of the next answer: bytes → (s from now, bytes) each to be sent; none: nothing.
    """

    silent_until: float = 0.0
    busy: int = 0
    drop: bool = False
    offline: float = 0.0
    answer: Callable[[bytes], Sequence[tuple[float, bytes]]] | None = None


class BridgeDevice:
    """The register image of one `Plant`."""

    ranges: ClassVar[Ranges] = {
        "coil": ((COILS.start, COILS.size),),
        "discrete": ((DISCRETES.start, DISCRETES.size),),
        "holding": (
            (WRITE_BACK.start, WRITE_BACK.size + MATCHED.size),
            (FAULT.start, FAULT.size),
        ),
        "input": ((0, INPUT_SIZE),),
    }

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.wire = WireFaults()
        self._written = WRITE_BACK.pack([0] * len(WRITE_BACK.registers))
        wrong = plant.disturbances
        self._coils = [
            wrong.stand_still,
            wrong.go_to,
            wrong.heartbeat_stopped,
            wrong.machine_fault,
            wrong.unreferenced,
        ]
        self._matched_state = NOTHING_YET
        self._matched: Latch | None = None
        self._matched_at = 0.0
        self._heartbeat = 0
        self._abbe_heartbeat = -1
        self._abbe_seen = -math.inf
        self.written = 0
        """Requests to write that were taken."""
        self._fault_values = dict.fromkeys((r.name for r in FAULT.registers), 0)
        self._fault_values["repeatability"] = round(wrong.repeatability * 1e6)
        for axis, place in zip(AXES, wrong.target, strict=True):
            self._fault_values[f"go_to_{axis}"] = round(place * 1e4)

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Words (or bits) of a request that lies within `ranges`."""
        if table == "coil":
            return [int(bit) for bit in self._coils[address : address + count]]
        if table == "discrete":
            status = self._status(self.plant.latch(now))
            return [status >> (address + i) & 1 for i in range(count)]
        if table == "holding":
            if FAULT.overlaps(address, count):
                words = FAULT.pack(list(self._fault_values.values()))
                return words[address - FAULT.start :][:count]
            words = list(self._written)
            if MATCHED.overlaps(address, count):
                words += self._matched_words()
            else:
                words += [0] * MATCHED.size
            return words[address : address + count]
        latch = self.plant.latch(now)
        words = self._controller_words(latch)
        words += [0] * (TRUTH.start - len(words))
        if TRUTH.overlaps(address, count):
            words += TRUTH.pack(
                [latch.sample, *self.plant.truth(latch), *latch.position, *latch.temperatures]
            )
        words += [0] * (INPUT_SIZE - len(words))
        return words[address : address + count]

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Take values in.

        Raises
        ------
        NotWritableError
            When any of the addresses is read-only; nothing is written then.
        """
        count = len(values)
        self.written += 1
        if table == "coil":
            self._coils[address : address + count] = [bool(v) for v in values]
            self._apply_coils()
        elif FAULT.start <= address:
            self._write_faults(address, values, now)
        elif address + count <= WRITE_BACK.size:
            self._write_back(address, values, now)
        else:
            raise NotWritableError(f"{table} {address} to {address + count - 1} is read-only")

    def _controller_words(self, latch: Latch) -> list[int]:
        if not self.plant.disturbances.heartbeat_stopped:
            self._heartbeat = latch.sample // 100 & 0xFFFF
        return CONTROLLER.pack(
            [
                self._status(latch),
                self._heartbeat,
                latch.sample & 0xFFFFFFFF,
                *latch.counts,
                *latch.ohms,
                *(round(c * 1e4) for c in self.plant.tool),
                *latch.directions,
            ]
        )

    def _status(self, latch: Latch) -> int:
        wrong = self.plant.disturbances
        bits = {
            "idle": not latch.moving,
            "moving": latch.moving,
            "referenced": not wrong.unreferenced,
            "fault": wrong.machine_fault,
            "compensated": latch.time - self._abbe_seen < WATCHDOG,
        }
        return sum(1 << i for i, name in enumerate(STATUS_BITS) if bits[name])

    def _write_back(self, address: int, values: Sequence[int], now: float) -> None:
        self._written[address : address + len(values)] = values
        touched = {
            r.name
            for r in WRITE_BACK.registers
            if r.address < address + len(values) and address < r.address + r.size
        }
        written = WRITE_BACK.unpack(self._written)
        if "abbe_heartbeat" in touched and written["abbe_heartbeat"] != self._abbe_heartbeat:
            self._abbe_heartbeat = int(written["abbe_heartbeat"])
            self._abbe_seen = now
        if "echo_sample" in touched:
            self._matched = self.plant.find(int(written["echo_sample"]))
            self._matched_state = UNKNOWN_SAMPLE if self._matched is None else MATCHED_OK
            self._matched_at = now
        elif any(name.startswith("corrected") for name in touched):
            self._matched, self._matched_state = None, NO_ECHO

    def _matched_words(self) -> list[int]:
        latch = self._matched
        if latch is None:
            return MATCHED.pack([0] * 7 + [self._matched_state, 0])
        truth = self.plant.truth(latch)
        places = [round(q * CORRECTED_COUNTS_PER_MM) for q in (*truth, *latch.position)]
        age = min(round((self._matched_at - latch.time) * 1e3), 0xFFFF)
        return MATCHED.pack([latch.sample & 0xFFFFFFFF, *places, self._matched_state, age])

    def _write_faults(self, address: int, values: Sequence[int], now: float) -> None:
        words = FAULT.pack(list(self._fault_values.values()))
        offset = address - FAULT.start
        words[offset : offset + len(values)] = values
        new = {name: int(value) for name, value in FAULT.unpack(words).items()}
        wrong, wire = self.plant.disturbances, self.wire
        wrong.thermistors_open = new["thermistors_open"]
        wrong.thermistors_short = new["thermistors_short"]
        wrong.encoders_frozen = new["encoders_frozen"]
        wrong.repeatability = new["repeatability"] * 1e-6
        wrong.target = (new["go_to_X"] * 1e-4, new["go_to_Y"] * 1e-4, new["go_to_Z"] * 1e-4)
        # The rest are events, not states: they happen once and read back 0.
        self.plant.warm(new["temperature_step"] * 0.01)
        if new["hang"]:
            wire.silent_until = now + new["hang"] * 1e-3
        wire.busy += new["busy"]
        wire.drop = wire.drop or bool(new["drop"])
        wire.offline = max(wire.offline, new["offline"] * 1e-3)
        events = ("temperature_step", "hang", "busy", "drop", "offline")
        self._fault_values = new | dict.fromkeys(events, 0)

    def _apply_coils(self) -> None:
        wrong = self.plant.disturbances
        (
            wrong.stand_still,
            wrong.go_to,
            wrong.heartbeat_stopped,
            wrong.machine_fault,
            wrong.unreferenced,
        ) = self._coils
