"""The tormentor's script, motion and page."""

from __future__ import annotations

import random
from itertools import pairwise
from pathlib import Path

import pytest

from abbe.drivers.simulated.torment.__main__ import main
from abbe.drivers.simulated.torment.kinds import KINDS
from abbe.drivers.simulated.torment.motion import FASTEST, TRAVEL, RandomMotion
from abbe.drivers.simulated.torment.script import Script
from abbe.drivers.simulated.torment.wires import WIRES, wire_class

DOC = (Path(__file__).parents[2] / "docs" / "torment.md").read_text(encoding="utf-8")


def test_the_same_seed_makes_the_same_script() -> None:
    kinds = list(KINDS)
    once, again, other = (Script(s, kinds, 300.0).torments for s in ("a 1", "a 1", "a 2"))
    assert once == again != other
    assert {torment.kind for torment in once} == set(kinds)
    assert all(0.0 < t.begin < t.end <= 297.0 for t in once)


def test_what_is_active_is_what_the_script_says() -> None:
    script = Script("x", list(KINDS), 120.0)
    assert script.active("late", 5.0) is None
    script.start(1000.0)
    for torment in script.torments:
        middle = 1000.0 + (torment.begin + torment.end) / 2
        assert script.active(torment.kind, middle) is not None
        assert torment in script.around(middle)


def test_the_machine_stays_in_its_travel_and_never_jumps() -> None:
    motion = RandomMotion(random.Random(5), 0.0)
    places = [motion.at(0.01 * k) for k in range(20_000)]
    for before, after in pairwise(places):
        for a, b, (low, high) in zip(before, after, TRAVEL, strict=True):
            assert abs(b - a) <= FASTEST * 0.01 + 1e-9
            assert low - 1e-6 <= b <= high + 1e-6


def test_the_machine_stands_when_the_script_says_so() -> None:
    motion = RandomMotion(random.Random(5), 0.0)
    motion.at(7.0)
    motion.halt(7.0, 2.0)
    assert motion.at(7.0) == pytest.approx(motion.at(8.99))
    assert motion.at(6.99) == pytest.approx(motion.at(7.0), abs=3.1)


def test_every_kind_is_on_some_wire_and_every_wire_knows_its_kinds() -> None:
    spoken = {kind for protocol in WIRES for kind in wire_class(protocol).KINDS}
    assert spoken == set(KINDS)


def test_the_page_tells_every_protocol_and_kind() -> None:
    for protocol in WIRES:
        assert f"`{protocol}`" in DOC
        for variant in wire_class(protocol).VARIANTS:
            assert variant in DOC
    for kind, what in KINDS.items():
        assert f"| `{kind}` | {what.text} |" in DOC


def test_the_command_prints_its_script(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--protocol", "modbus-tcp", "--variant", "plain", "--seconds", "30", "--script"]
    assert main([*arguments, "--only", "late,split"]) == 0
    printed = capsys.readouterr().out
    assert "late" in printed
    assert "silent" not in printed


def test_an_unknown_kind_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--only", "lat"])
    assert "no such kind: lat" in capsys.readouterr().err
