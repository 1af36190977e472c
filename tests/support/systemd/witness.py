"""What a controller sees of Abbe, written down from outside: a Modbus client of its own."""

from __future__ import annotations

import contextlib
import itertools
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from abbe.drivers.simulated.bridge.registers import MATCHED, UNIT_ID, WRITE_BACK

_PACE = 0.05
_WITHIN = 2.0
_CODES = {"uint16": ">H", "int32": ">i", "uint32": ">I"}
_REGISTERS = (*WRITE_BACK.registers, *MATCHED.registers)
_COUNT = _REGISTERS[-1].address + _REGISTERS[-1].size
_MATCHED = 1
_LAST = 0.15
"""Part of the correction that may have been seen last: a cycle of the ramp is 5 %, and the zero
at its end stands for some milliseconds before the last word."""
_SPEEDS = 1.1
"""How much faster than allowed a step may look: the samples' clock has 1 ms."""


@dataclass(frozen=True)
class Seen:
    """Registers in one answer.

    Attributes
    ----------
    at
        s of the monotonic clock.
    status, heartbeat
        Abbe's words.
    sample
        ms of the controller's clock for which the correction holds.
    correction
        Corrected minus indicated position, µm, in X, Y, Z; nothing while they do not match.
    """

    at: float
    status: int
    heartbeat: int
    sample: int
    correction: tuple[float, float, float] | None

    @property
    def size(self) -> float:
        """Largest component, µm; 0 where nothing is corrected."""
        return max(map(abs, self.correction)) if self.correction else 0.0


class Witness:
    """Reads the registers of a simulated controller 20 times a second and keeps all of it."""

    def __init__(self, port: int) -> None:
        self.seen: list[Seen] = []
        self._port = port
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no longer."""
        self._over.set()
        self._thread.join()

    def until(self, what: Callable[[Seen], bool], within: float, since: int | None = None) -> Seen:
        """The first look, from now or from index `since` on, of which `what` holds."""
        at = len(self.seen) if since is None else since
        deadline = time.monotonic() + within
        while time.monotonic() < deadline:
            while at < len(self.seen):
                if what(self.seen[at]):
                    return self.seen[at]
                at += 1
            time.sleep(_PACE)
        raise AssertionError(f"the controller did not see it in {within:g} s; {self.seen[-1:]}")

    def ramp(self, since: int, rate: float) -> str:
        """`ramp` of what was seen from index `since` on."""
        return ramp(self.seen[since:], rate)

    def _look(self) -> None:
        while not self._over.is_set():
            with (
                contextlib.suppress(OSError),
                socket.create_connection(("127.0.0.1", self._port), _WITHIN) as connection,
            ):
                for number in itertools.count(1):
                    data = _read(connection, number & 0xFFFF)
                    self.seen.append(_understood(data))
                    if self._over.wait(_PACE):
                        return
            self._over.wait(_PACE)


def ramp(looks: Sequence[Seen], rate: float) -> str:
    """Check that the correction was led to zero; in words.

    Parameters
    ----------
    looks
        From one on where the correction was still there in full.
    rate
        mm/s that it may change by.

    Raises
    ------
    AssertionError
        When it was dropped instead, or its end was not told.
    """
    end = next((i for i, look in enumerate(looks) if look.status == 0), None)
    assert end is not None, "the status word 0 was never written"
    path = [look for look in looks[:end] if look.correction]
    sizes = [size for size, _ in itertools.groupby(look.size for look in path)]
    assert len(sizes) > 5, f"no ramp: {sizes}"
    assert sizes[0] > 5.0, f"there was no correction before: {sizes}"
    assert sizes[-1] < _LAST * sizes[0], f"it did not come to zero before its end: {sizes[-30:]}"
    for one, two in itertools.pairwise(path):
        step = max(abs(a - b) for a, b in zip(one.correction, two.correction, strict=True))  # type: ignore[arg-type]
        allowed = _SPEEDS * rate * (two.sample - one.sample) + 0.02
        assert step <= allowed, f"{step:.2f} µm in {two.sample - one.sample} ms"
    steps = len(sizes) - 1
    falling = [look for look in path if look.size < 0.99 * sizes[0]]
    lasted = (falling[-1].sample - falling[0].sample) / 1e3
    return f"{sizes[0]:.1f} µm to {sizes[-1]:.1f} in {steps} steps, {lasted:.1f} s; status 0"


@contextmanager
def witness(port: int) -> Iterator[Witness]:
    """One that looks as long as the context."""
    made = Witness(port)
    try:
        yield made
    finally:
        made.close()


def _read(connection: socket.socket, number: int) -> bytes:
    connection.sendall(struct.pack(">HHHBBHH", number, 0, 6, UNIT_ID, 3, 0, _COUNT))
    answer = b""
    while len(answer) < 9 + 2 * _COUNT:
        more = connection.recv(1024)
        if not more or (len(answer + more) > 8 and (answer + more)[7] & 0x80):
            raise ConnectionError
        answer += more
    return answer[9:]


def _understood(data: bytes) -> Seen:
    found = {
        r.name: struct.unpack_from(_CODES[r.type], data, 2 * r.address)[0] * r.scale
        for r in _REGISTERS
    }
    correction = None
    if found["matched_state"] == _MATCHED:
        correction = tuple(
            1e3 * (found[f"corrected_{a}"] - found[f"matched_indicated_{a}"]) for a in "XYZ"
        )
    return Seen(
        time.monotonic(),
        int(found["abbe_status"]),
        int(found["abbe_heartbeat"]),
        int(found["echo_sample"]),
        correction,  # type: ignore[arg-type]
    )
