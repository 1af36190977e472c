"""``abbe fleet diagnose``: causes of many machines, bad files, what is kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemon.command_line import abbe

MODEL = """format = "abbe-model/1"
[machine]
name = "M"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 600.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
"""


def campaign(slope: float, seed: int) -> str:
    """A laser along X from both sides, three runs; the scale is off by a slope, ppm."""
    rng = np.random.default_rng(seed)
    lines = ['# format = "abbe-campaign/1"',
             "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,ux,uy,uz,value,sd"]  # fmt: skip
    for run in range(3):
        for way in (1, -1):
            for x in np.linspace(0.0, 600.0, 13)[::way]:
                value = 1e-3 * slope * x + rng.normal(0.0, 0.3)
                head = f"{10 * len(lines)},line{run},displacement,{x:.1f},200,-100,{way}"
                lines.append(f"{head},0,0,1,0,0,{value:.4f},0.3")
    return "\n".join(lines) + "\n"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Three machines; the scales of two of them are off; the third has a spoilt file, too."""
    for i, slope in enumerate((30.0, 25.0, 0.0)):
        folder = tmp_path / "plant" / f"mill-{i + 1}"
        folder.mkdir(parents=True)
        (folder / "model.toml").write_text(MODEL)
        (folder / "march.csv").write_text(campaign(slope, i))
    spoilt = campaign(0.0, 9).replace("displacement,300.0", "displacement,3oo", 1)
    (tmp_path / "plant" / "mill-3" / "april.csv").write_text(spoilt)
    return tmp_path / "plant"


def test_what_machines_share_is_said_and_a_bad_file_ends_nothing(
    fleet: Path, tmp_path: Path
) -> None:
    keep = tmp_path / "kept.sqlite"
    done = abbe("fleet", "diagnose", fleet, "--workers", 1, "--keep", keep)
    assert done.status == 0, done.err
    rows = {tuple(line.split()[:2]): line for line in done.out.splitlines() if ".csv" in line}
    assert "scale axis=X" in rows["mill-1", "march.csv"]
    assert "complete" in rows["mill-3", "march.csv"]
    assert (
        "april.csv, line" in rows["mill-3", "april.csv"]
    )  # by its own name, not where it was read
    assert "scale axis=X: on 2 of 3 machines (mill-1, mill-2)" in done.out
    assert "1 of 4 campaigns could not be diagnosed" in done.out

    manifest = tmp_path / "fleet.csv"
    manifest.write_text(
        "machine,model,campaign\n"
        + "".join(f"mill-{i},plant/mill-{i}/model.toml,plant/mill-{i}/march.csv\n" for i in (1, 2))
    )
    again = json.loads(abbe("fleet", "diagnose", manifest, "--keep", keep, "--json").out)
    assert again["machines"] == 2
    assert again["shared_causes"] == [{"cause": "scale axis=X", "machines": ["mill-1", "mill-2"]}]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("machine,model\n", "line 1: not a manifest of a fleet"),
        ("machine,model,campaign\nm,none.toml,none.csv\n", "line 2, field 'model': no such file"),
        ("machine,model,campaign\nm,x\n", "line 2: not a cell for each column"),
        ("machine,model,campaign\n", "no machine with a model and a campaign"),
    ],
)
def test_a_bad_manifest_is_named(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "fleet.csv").write_text(text)
    done = abbe("fleet", "diagnose", tmp_path / "fleet.csv")
    assert done.status == 1
    assert words in done.err


def test_a_folder_with_two_models_asks_for_a_manifest(fleet: Path) -> None:
    (fleet / "mill-1" / "older.toml").write_text(MODEL)
    done = abbe("fleet", "diagnose", fleet)
    assert done.status == 1
    assert "a machine's folder holds one model" in done.err
