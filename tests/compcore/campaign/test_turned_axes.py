"""A table's own sense in place of ISO 841's is noticed where an artefact is clamped to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.turned_axes import of_turned_axes
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model

LINE = np.array([250.0, 200.0, 0.0])
TABLE = Machine(
    "table",
    Structure.parse("w C' b X Y Z t"),
    {a: Axis(a, (0.0, 600.0)) for a in "XYZ"}
    | {"C": Axis("C", (0.0, 2.0 * np.pi), location=tuple(LINE))},
    {},
)


def turned(angle: float) -> np.ndarray:
    """Right-handed about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def spheres(path: Path, sense: float, *, free: str = '"frame"') -> Path:
    """Two spheres on a table whose line is elsewhere by (25, −12) µm, followed by the tool."""
    rng = np.random.default_rng(11)
    head, rows = ['# format = "abbe-campaign/1"'], []
    off = np.array([0.025, -0.012, 0.0])
    for name, at in {"s1": (370.0, 200.0, 80.0), "s2": (250.0, 320.0, 230.0)}.items():
        head += [f"# [setups.{name}]", f"# free = [{free}]"]
        for k in range(13):
            turn = turned(sense * np.radians(30.0 * k))
            where = turn @ (np.array(at) - LINE) + LINE
            really = turn @ (np.array(at) - LINE - off) + LINE + off
            for i in range(3):
                u = ",".join(str(int(i == j)) for j in range(3))
                value = 1e3 * (where - really)[i] + rng.normal(0.0, 0.5)
                place = ",".join(f"{v:.6f}" for v in where)
                rows.append(f"{name},displacement,{place},{30 * k},{u},{value:.3f}")
    path.write_text("\n".join([*head, "setup,kind,X,Y,Z,C,ux,uy,uz,value", *rows]) + "\n")
    return path


def test_the_tables_own_sense_is_suspected_before_anything_else(tmp_path: Path) -> None:
    campaign = read_campaign(spheres(tmp_path / "own.csv", 1.0), TABLE)
    (said,) = of_turned_axes(campaign, TABLE)
    assert "with C turned the other way" in said
    first, *_ = diagnose(Model(TABLE, ()), campaign).words()
    assert first == f"SUSPICIOUS: {said}"


def test_by_iso_841_nothing_is_suspected_and_the_line_is_found(tmp_path: Path) -> None:
    """As E_X0C has it: of a table's line at +25 µm the tool relative to the workpiece is −25."""
    campaign = read_campaign(spheres(tmp_path / "iso.csv", -1.0), TABLE)
    assert list(of_turned_axes(campaign, TABLE)) == []
    (cause,) = diagnose(Model(TABLE, ()), campaign).established
    found = {e.name: e.value for e in cause.estimates}
    assert found["E_X0C"] == pytest.approx(-0.025, abs=1e-3)
    assert found["E_Y0C"] == pytest.approx(0.012, abs=1e-3)


def test_what_stands_nowhere_on_the_table_says_nothing(tmp_path: Path) -> None:
    campaign = read_campaign(spheres(tmp_path / "own.csv", 1.0, free='"zero"'), TABLE)
    assert list(of_turned_axes(campaign, TABLE)) == []
