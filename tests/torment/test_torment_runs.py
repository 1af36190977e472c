"""A real ``abbe run`` against every tormented protocol: no promise is broken.

Two minutes of the hour that ``make torment`` takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from abbe.drivers.simulated.torment.judge.promises import Tally
from abbe.drivers.simulated.torment.kinds import LAST
from abbe.drivers.simulated.torment.trial import Trial
from abbe.drivers.simulated.torment.wires import WIRES, wire_class

pytestmark = pytest.mark.integration

SECONDS = 9.0
RUNS = [
    ("modbus-tcp", "plain", 1),
    ("modbus-tcp", "patient", 2),
    ("modbus-rtu", "plain", 3),
    ("serial", "checksum", 4),
    ("serial-streaming", "plain", 5),
    ("can", "plain", 6),
    ("canopen", "plain", 7),
    ("ipp", "plain", 8),
]


def outcome_of(protocol: str, variant: str, seed: int, kinds: Sequence[str], folder: Path) -> Tally:
    """Torment, and have no promise broken."""
    trial = Trial(protocol, variant=variant, seed=seed, seconds=SECONDS, kinds=kinds, folder=folder)
    outcome = trial.run()
    said = (folder / "abbe.log").read_text(encoding="utf-8")[-3000:]
    assert not outcome.violations, "\n".join([*outcome.lines, said])
    return outcome.tally


def test_every_protocol_is_tormented() -> None:
    assert {protocol for protocol, _, _ in RUNS} == set(WIRES)


@pytest.mark.one_in(8)
@pytest.mark.parametrize(("protocol", "variant", "seed"), RUNS)
def test_no_promise_is_broken(protocol: str, variant: str, seed: int, tmp_path: Path) -> None:
    kinds = [kind for kind in wire_class(protocol).KINDS if kind not in LAST]
    tally = outcome_of(protocol, variant, seed, kinds, tmp_path)
    assert tally.messages - tally.not_judged > 50, f"too little was judged: {tally}"


def test_a_position_that_is_what_was_written_is_noticed(tmp_path: Path) -> None:
    tally = outcome_of("modbus-tcp", "plain", 9, ["mirrored"], tmp_path)
    assert tally.messages - tally.not_judged > 50, f"too little was judged: {tally}"
