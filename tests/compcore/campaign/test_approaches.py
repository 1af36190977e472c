"""Targets that are read both ways without a word of it are noticed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.approaches import unsaid_approaches
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model

TRAVEL = {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (0.0, 400.0)}
AXES = {a: Axis(a, t) for a, t in TRAVEL.items()}
MACHINE = Machine("mill", Structure.parse("w X' Y' b Z t"), AXES, {})


def lines(folder: Path, *, both: bool = True, columns: str = "", clock: bool = True) -> Path:
    """A line of X read there and back five times, 4 µm of play; `columns`: what says which way."""
    rng = np.random.default_rng(3)
    head = ['# format = "abbe-campaign/1"', '# machine = "mill"']
    rows = []
    at = np.linspace(0.0, 600.0, 23) + rng.uniform(-4.0, 4.0, 23).clip(0.0)
    for _ in range(5):
        for sign, places in ((1, at), (-1, at[::-1])):
            for q in places if both or sign > 0 else ():
                value = 2.0 * sign + rng.normal(0.0, 0.3)
                way = f"{sign}," if columns else ""
                rows.append((q, f"l,displacement,{q:.4f},250,200,{way}1,0,0,{value:.3f}"))
    names = f"setup,kind,X,Y,Z,{columns}ux,uy,uz,value"
    text = [f"{6 * i},{row}" if clock else row for i, (_, row) in enumerate(rows)]
    path = folder / "line.csv"
    path.write_text("\n".join([*head, ("time," if clock else "") + names, *text]) + "\n")
    return path


@pytest.mark.parametrize("clock", [True, False])
def test_a_line_read_there_and_back(tmp_path: Path, clock: bool) -> None:
    campaign = read_campaign(lines(tmp_path, clock=clock), MACHINE)
    assert unsaid_approaches(campaign) == ("X",)
    words = list(diagnose(Model(MACHINE, ()), campaign).words())
    (said,) = [w for w in words if "read from both sides" in w]
    assert "X_dir" in said


def test_a_line_read_in_one_direction_or_with_its_directions(tmp_path: Path) -> None:
    assert unsaid_approaches(read_campaign(lines(tmp_path, both=False), MACHINE)) == ()
    assert unsaid_approaches(read_campaign(lines(tmp_path, columns="X_dir,"), MACHINE)) == ()


def test_a_column_that_is_no_signal_is_named_and_in_no_formula(tmp_path: Path) -> None:
    """The play's direction in a column of another name: what is offered could not be added."""
    campaign = read_campaign(lines(tmp_path, columns="dX,"), MACHINE)
    found = diagnose(Model(MACHINE, ()), campaign)
    words = "\n".join(found.words())
    assert "no signals of this machine" in words
    assert "[machine.signals.dX]" in words
    assert "(dX/1)" not in words
