"""Causes that read the clock are tried where none that reads a signal foretells anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model

PLACER = Machine(
    "pick and place", Structure.parse("w b X Y t"), {a: Axis(a, (0.0, 400.0)) for a in "XY"}
)


def boards(tmp_path: Path, free: str) -> Campaign:
    """25 boards of 12 parts, put elsewhere from the 10th board on in Y, from the 13th in X."""
    rng = np.random.default_rng(12)
    rows = []
    for board in range(1, 26):
        for part in range(12):
            at = board * 60 + part * 3
            x = -60.0 + 75.0 * (board >= 13) + rng.normal(0.0, 18.0)
            y = -60.0 + 50.0 * (board >= 10) + rng.normal(0.0, 12.0)
            rows.append(f"{at},s,displacement,0,0,1,0,0,{x:.1f}")
            rows.append(f"{at},s,displacement,0,0,0,1,0,{y:.1f}")
    head = (
        '# format = "abbe-campaign/1"\n# [setups.s]\n'
        f"# free = [{free}]\ntime,setup,kind,X,Y,ux,uy,uz,value\n"
    )
    file = tmp_path / "boards.csv"
    file.write_text(head + "\n".join(rows) + "\n")
    return read_campaign(file, PLACER)


@pytest.mark.parametrize("free", ["", '"zero"'])
def test_two_events_are_added_each_at_its_board(tmp_path: Path, free: str) -> None:
    course = to_the_verdict(Model(PLACER), boards(tmp_path, free))
    last = course.last
    moments = {t.effect.spec: t.values["t0"].value for t in last.result.model.terms
               if t.effect.kind == "event"}  # fmt: skip
    # between the last part of one board and the first of the next
    assert moments["event direction=X"] == pytest.approx(12 * 60 + 47, abs=20)
    assert moments["event direction=Y"] == pytest.approx(9 * 60 + 47, abs=20)
    # parts alone scatter by 15 µm
    assert last.held_out.lengths < 0.021
