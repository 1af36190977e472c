"""A real ``abbe run`` against every tormented protocol: no promise is broken.

Two minutes of the hour that ``make torment`` takes. What is left out here says why.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.simulated.torment.trial import Trial
from drivers.simulated.torment.wires import WIRES

pytestmark = pytest.mark.integration

SECONDS = 11.0
KINDS = ("split", "duplicated", "flood", "foreign", "narrow")
"""Short ones, so that each run has several. Steps after an outage are not judged here yet."""

RUNS = [
    ("modbus-tcp", "plain", 1),
    ("modbus-tcp", "verify", 2),
    ("modbus-rtu", "plain", 3),
    ("serial", "checksum", 4),
    ("serial-streaming", "plain", 5),
    ("can", "plain", 6),
    ("canopen", "plain", 7),
    ("ipp", "plain", 8),
]


def test_every_protocol_is_tormented() -> None:
    assert {protocol for protocol, _, _ in RUNS} == set(WIRES)


@pytest.mark.parametrize(("protocol", "variant", "seed"), RUNS)
def test_no_promise_is_broken(protocol: str, variant: str, seed: int, tmp_path: Path) -> None:
    trial = Trial(
        protocol, variant=variant, seed=seed, seconds=SECONDS, kinds=KINDS, folder=tmp_path
    )
    outcome = trial.run()
    said = (tmp_path / "abbe.log").read_text(encoding="utf-8")[-3000:]
    broken = [v for v in outcome.violations if v.promise != "step"]
    assert not broken, "\n".join([*outcome.lines, said])
    judged = outcome.tally.messages - outcome.tally.not_judged
    assert judged > 50, f"{outcome.tally}, {outcome.stalls} stalls: too little was judged"
