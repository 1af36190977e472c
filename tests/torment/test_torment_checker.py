"""The tormentor's checker finds what is wrong and leaves alone what is right: made-up evidence."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import pytest

from abbe.drivers.simulated.torment.judge.checker import Checker
from abbe.drivers.simulated.torment.judge.evidence import ShownPicture, Taken
from abbe.drivers.simulated.torment.judge.promises import Promises
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.machine import REFERENCED

PROMISES = Promises()
GOOD = 0x7003
SPEED = 100.0


class Scene:
    """A machine that moves at 100 mm/s, shown every 20 ms, and what is written of it."""

    def __init__(self) -> None:
        self.checker = Checker(PROMISES, lambda early, late: False, lambda early, late: 0.0)
        self.beat = 0
        self.number = 0

    def show(self, now: float, **changes: object) -> ShownPicture:
        self.number += 1
        shown = ShownPicture(
            number=self.number,
            sampled=now,
            place=(50.0 + SPEED * now, 200.0, -50.0 - SPEED * now / 2),
            beat=int(50 * now),
            status=REFERENCED,
            temperature=21.0,
            sent=now + 0.001,
        )
        shown = dataclasses.replace(shown, **changes)  # type: ignore[arg-type]
        self.checker.sent(shown)
        return shown

    def corrected(self, shown: ShownPicture, share: float = 1.0) -> dict[str, float]:
        self.beat += 1
        x, y, z = shown.place
        return {
            "X": x + share * PROMISES.error("X", x, 21.0),
            "Y": y + share * PROMISES.error("Y", y, 21.0),
            "Z": z,
            "status": float(GOOD if share == 1.0 else 1),
            "heartbeat": float(self.beat),
            "echo": float(shown.number),
        }

    def write(self, now: float, values: dict[str, float]) -> None:
        self.checker.taken(Taken(Moment(now, now + 0.0005), values))

    def cycles(self, times: Sequence[float]) -> None:
        for time in times:
            self.write(time + 0.003, self.corrected(self.show(time)))

    @property
    def found(self) -> list[str]:
        return [violation.promise for violation in self.checker.violations]


@pytest.fixture
def scene() -> Scene:
    made = Scene()
    made.cycles([0.02 * k for k in range(100)])
    assert made.found == []
    return made


def test_good_cycles_are_judged_and_right(scene: Scene) -> None:
    tally = scene.checker.tally
    assert (tally.messages, tally.positions, tally.compensating) == (100, 300, 100)
    assert tally.steps > 500


def test_a_position_that_was_sampled_early_and_sent_late(scene: Scene) -> None:
    shown = scene.show(2.0, sent=2.6)
    scene.write(2.61, scene.corrected(shown))
    assert set(scene.found) == {"age"}


def test_a_position_within_its_age_is_right(scene: Scene) -> None:
    shown = scene.show(2.0, sent=2.15)
    scene.write(2.19, scene.corrected(shown))
    assert scene.found == []


def test_a_frozen_gateway_that_is_believed_for_too_long(scene: Scene) -> None:
    last = scene.show(2.0)
    for k in range(1, 40):
        now = 2.0 + 0.02 * k
        scene.checker.sent(dataclasses.replace(last, frozen=True, sent=now))
        scene.write(now + 0.003, scene.corrected(last))
    assert "age" in scene.found


def test_a_foreign_answer_that_is_believed(scene: Scene) -> None:
    shown = scene.show(2.0)
    values = scene.corrected(shown)
    scene.write(2.003, {**values, "X": values["X"] + 7.0})
    assert scene.found == ["position"]
    assert "foreign" in scene.checker.violations[0].text


def test_the_echo_of_another_sample(scene: Scene) -> None:
    first = scene.show(2.0)
    second = scene.show(2.02)
    scene.write(2.023, {**scene.corrected(second), "echo": float(first.number)})
    assert "position" in scene.found


def test_a_machine_that_is_not_referenced(scene: Scene) -> None:
    shown = scene.show(2.0, status=0)
    scene.write(2.003, scene.corrected(shown))
    assert "position" in scene.found


def test_a_step_in_the_correction(scene: Scene) -> None:
    values = scene.corrected(scene.show(2.0))
    scene.write(2.003, {**values, "X": values["X"] + 0.005, "status": 1.0})
    assert scene.found == ["step"]


def test_a_step_after_refused_writes(scene: Scene) -> None:
    for k in range(100):
        scene.show(2.0 + 0.02 * k)
    shown = scene.show(4.0)
    scene.write(4.003, scene.corrected(shown))  # 200 mm on: 24 µm
    assert scene.found == ["step"]


def test_a_slow_way_to_zero_is_right(scene: Scene) -> None:
    for k in range(100):
        scene.write(2.003 + 0.02 * k, scene.corrected(scene.show(2.0 + 0.02 * k), 1.0 - k / 100))
    assert scene.found == []


def test_full_correction_that_is_not_the_model_s(scene: Scene) -> None:
    for k in range(100):
        values = scene.corrected(scene.show(2.0 + 0.02 * k), 1.0 - k / 100)
        scene.write(2.003 + 0.02 * k, {**values, "status": float(GOOD)})
    assert set(scene.found) == {"status"}


def test_full_correction_without_positions(scene: Scene) -> None:
    scene.write(2.9, {"status": float(GOOD), "heartbeat": 7.0})
    assert scene.found == ["status"]


def test_a_heartbeat_that_stands_still(scene: Scene) -> None:
    scene.write(2.0, {"status": 1.0, "heartbeat": 3.0})
    scene.write(2.02, {"status": 1.0, "heartbeat": 3.0})
    assert scene.found == ["status"]


def test_mirrored_registers(scene: Scene) -> None:
    where = scene.show(2.0).place
    place = where
    for k in range(1, 100):
        now = 2.0 + 0.02 * k
        shown = scene.show(now, place=place, mirrored=where)
        values = scene.corrected(shown)
        scene.write(now + 0.003, values)
        place = (values["X"], values["Y"], values["Z"])
    assert set(scene.found) == {"position"}


def test_an_end_that_the_controller_did_not_learn_of(scene: Scene) -> None:
    scene.checker.ending = 2.0
    scene.checker.ended(0, 3.0)
    assert scene.found == ["end"]


def test_a_right_end(scene: Scene) -> None:
    scene.checker.ending = 2.0
    scene.write(2.5, {"status": 0.0, "heartbeat": 9.0})
    scene.checker.ended(0, 3.0)
    assert scene.found == []


def test_what_fell_into_a_stall_is_not_judged(scene: Scene) -> None:
    scene.checker.stalled = lambda early, late: True
    scene.write(2.003, {**scene.corrected(scene.show(2.0)), "X": 0.0})
    assert scene.found == []
    assert scene.checker.tally.not_judged == 1


def test_a_position_in_a_stall_is_not_held_against_the_echo_after_it(scene: Scene) -> None:
    """Where every value is a message of its own, a stall can end between a sample's two."""
    before = scene.corrected(scene.show(2.0))
    scene.write(2.001, {"Y": before["Y"]})
    moved = scene.show(2.4, place=(290.0, 220.0, -170.0))
    scene.checker.stalled = lambda early, late: True
    scene.write(2.401, {"Y": 220.0 + PROMISES.error("Y", 220.0, 21.0)})
    scene.checker.stalled = lambda early, late: False
    scene.write(2.402, {"echo": float(moved.number)})
    assert scene.found == []
