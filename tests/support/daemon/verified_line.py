"""A machine whose X scale is too long, its fitted model, and lines whose figures are known by hand.

After compensation the readings of `UP` and `DOWN` are left, µm, at 0, 100 and 200 mm in three runs:
means ↑ 1 4 8, ↓ 3 6 10; s ↑ 1 1 1, ↓ 1 1 0.5. E = 10 − 1 = 9, M = 9 − 2 = 7, B = 2;
A = (10 + 2·0.5) − (1 − 2·1) = 12; R = 2·1 + 2·1 + 2 = 6.
"""

from __future__ import annotations

from pathlib import Path

from tests.support.daemon.command_line import abbe

UP = ((0.0, 1.0, 2.0), (3.0, 4.0, 5.0), (7.0, 8.0, 9.0))
DOWN = ((2.0, 3.0, 4.0), (5.0, 6.0, 7.0), (9.5, 10.0, 10.5))
BY_HAND = {"A": 12.0, "R": 6.0, "E": 9.0, "M": 7.0, "B": 2.0}
SCALE = 200.0
"""ppm by which the machine moves too far along X."""
MODEL = """format = "abbe-model/1"
[machine]
name = "Small"
serial = "4711"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 300.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[[effects]]
kind = "positioning"
axis = "X"
shape = "polynomial:1"
"""
HEAD = """# format = "abbe-campaign/1"
# machine = "Small"
# date = 2026-03-02
# operator = "R. Meier"
# instrument = "XL-80, 12A345"
# environment = "hall 3"
"""


def line(setup: str, y: float, *, scale: float, first: float = 0.0) -> str:
    """The rows of a line along X at a Y: three runs each way at three targets.

    `scale` in ppm is in the readings besides `UP` and `DOWN`; `first` is the first target, mm.
    """
    rows, t = [], 0
    for run in range(3):
        for sense, table in ((1, UP), (-1, DOWN)):
            for i in range(3)[::sense]:
                t += 10
                x = first + 100.0 * i
                value = table[i][run] + scale * 1e-3 * x
                rows.append(f"{t},{setup},displacement,{x},{y},-100,{sense},1,0,0,{value!r},0.3")
    return "\n".join(rows) + "\n"


COLUMNS = "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd\n"


def written(path: Path, *lines: str) -> Path:
    """A campaign of lines."""
    path.write_text(HEAD + COLUMNS + "".join(lines), encoding="utf-8")
    return path


def fitted(folder: Path) -> Path:
    """The model, fitted to ``fit.csv``: exactly the scale, since the readings are."""
    rows = "".join(
        f"{i},fit{k},displacement,{x},{y},-100,1,1,0,0,{SCALE * 1e-3 * x!r},0.3\n"
        for k, y in enumerate((50.0, 200.0))
        for i, x in enumerate((0.0, 60.0, 120.0, 180.0, 240.0, 300.0))
    )
    written(folder / "fit.csv", rows)
    (folder / "start.toml").write_text(MODEL, encoding="utf-8")
    done = abbe("fit", folder / "start.toml", folder / "fit.csv", "-o", folder / "m.toml")
    assert done.status == 0, done.err
    return folder / "m.toml"
