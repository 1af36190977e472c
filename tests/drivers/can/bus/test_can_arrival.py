"""When a frame came, and whether it can be the answer to what was asked."""

from __future__ import annotations

import os
from types import SimpleNamespace

import can
import pytest

from abbe.drivers.can import incoming
from abbe.drivers.can.canopen.process_data.pdo import Pdo
from abbe.drivers.can.incoming import Incoming

DATA = bytes(4)


class Clocks:
    """Both clocks as the program sees them, which is stalled when told to."""

    def __init__(self, *stalls: float) -> None:
        self._now = 1000.0
        self._stalls = list(stalls)

    def pass_by(self, seconds: float) -> None:
        self._now += seconds

    def monotonic(self) -> float:
        self._now += 1e-6
        return self._now

    def time(self) -> float:
        stall = self._stalls.pop(0) if self._stalls else 0.0
        self._now += 1e-6 + stall
        return self._now + 1.7e9


def message(age: float) -> can.Message:
    """A frame that the kernel took in so long (s) before the clocks began to be read."""
    return can.Message(timestamp=1000.0 + 1.7e9 - age, arbitration_id=1, data=DATA)


class Waiting:
    """One frame, for whoever asks for it."""

    def __init__(self, frame: can.Message) -> None:
        self._frame = frame
        self._ends = os.pipe()

    def fileno(self) -> int:
        return self._ends[0]

    def recv(self, timeout: float | None) -> can.Message:
        return self._frame

    def close(self) -> None:
        for end in self._ends:
            os.close(end)


@pytest.mark.parametrize("stalls", [(), (3e-3,), (3e-3, 0.2), (0.0, 5e-3)])
async def test_a_stall_between_the_clocks_makes_no_frame_older(
    stalls: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A busy machine does that; the frame would pass for an answer to something earlier."""
    came: list[float] = []
    bus = Waiting(message(0.25))
    taken = Incoming(
        bus,  # type: ignore[arg-type]
        stamped=True,
        name="clocks",
        on_frame=lambda _, arrived, __: came.append(arrived),
        on_lost=pytest.fail,
    )
    clocks = Clocks(*stalls)
    with monkeypatch.context() as patched:
        patched.setattr(
            incoming, "time", SimpleNamespace(monotonic=clocks.monotonic, time=clocks.time)
        )
        assert taken.wait(0.0)
    taken.close()
    bus.close()
    assert came == [pytest.approx(1000.0 - 0.25, abs=20e-6)]


async def test_a_stall_while_the_clocks_are_compared_sets_none_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else what comes until the next comparison passes for older than any question."""
    came: list[float] = []
    bus = Waiting(message(-0.25))
    taken = Incoming(
        bus,  # type: ignore[arg-type]
        stamped=True,
        name="clocks",
        on_frame=lambda _, arrived, __: came.append(arrived),
        on_lost=pytest.fail,
    )
    clocks = Clocks(5e-3, 8e-3)
    with monkeypatch.context() as patched:
        patched.setattr(
            incoming, "time", SimpleNamespace(monotonic=clocks.monotonic, time=clocks.time)
        )
        taken.drain()
        clocks.pass_by(0.5)
        assert taken.wait(0.0)
    taken.close()
    bus.close()
    assert came == [pytest.approx(1000.25, abs=20e-6)]


def pdo(**values: float | None) -> Pdo:
    made = Pdo(1, 0x181, 1, {})
    for name, value in values.items():
        setattr(made, name, value)
    return made


@pytest.mark.parametrize(
    ("state", "believed"),
    [
        (dict[str, float | None](), True),
        ({"awaited_since": 9.0}, True),
        ({"awaited_since": 10.5}, False),
        ({"not_before": 11.0}, False),
    ],
)
def test_a_pdo_from_before_its_sync_is_no_answer(
    state: dict[str, float | None], *, believed: bool
) -> None:
    """It waited in the socket; the one that answers is still to come."""
    asked = pdo(**state)
    assert asked.take(DATA, 10.0) is believed
    assert (asked.data is not None) is believed
    assert asked.awaited_since == (None if believed else state.get("awaited_since"))
