"""A gauge that is corrected wrongly is no error over the volume: nothing is described for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.screening.left_out.lines import same_lines
from abbe.compcore.diagnosis.uncatalogued.other_lines import foretells_other_lines
from abbe.compcore.diagnosis.uncatalogued.over_the_volume import smooth_errors
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect

TABLE = """format = "abbe-model/1"
[machine]
name = "table"
structure = "w b Y X t"
[machine.axes.X]
travel = [0.0, 600.0]
[machine.axes.Y]
travel = [0.0, 600.0]
"""
MOTIONS = (
    *(f'kind = "positioning"\naxis = "{a}"\nshape = "spline:6"\n' for a in "XY"),
    *(
        f'kind = "straightness"\naxis = "{a}"\ndirection = "{b}"\nshape = "spline:6"\n'
        for a, b in ("XY", "YX")
    ),
    *(f'kind = "angular"\naxis = "{a}"\nabout = "Z"\nshape = "spline:6"\n' for a in "XY"),
    'kind = "squareness"\naxes = ["Y", "X"]\n',
)
SD = 0.4  # µm
LINES = {
    # laser, along each axis at two places of the other
    "x1": ((0, 60), (600, 60)), "x2": ((0, 480), (600, 480)),
    "y1": ((90, 0), (90, 600)), "y2": ((510, 0), (510, 600)),
    # gauge, on three days on the same lines
    **{f"g{day}{way}": line for day in "123" for way, line in (
        ("h", ((100, 300), (500, 300))), ("v", ((300, 100), (300, 500))),
        ("d", ((120, 100), (470, 450))), ("u", ((120, 450), (470, 100))),
    )},
}  # fmt: skip
GAUGE = 16e-6
"""Of its length: what the gauge's correction was wrong by."""


def campaign(folder: Path, model: Model, *, gauge: float = GAUGE, twist: float = 0.0) -> Campaign:
    rng = np.random.default_rng(7)
    rows = ["time,setup,kind,X,Y,X_dir,Y_dir,ux,uy,uz,value,sd"]
    heads = ['# format = "abbe-campaign/1"', '# instrument = "laser"']
    time = 0.0
    for name, (start, end) in LINES.items():
        heads += [f"# [setups.{name}]", '# free = ["zero"]']
        a, b = np.array(start, float), np.array(end, float)
        along = (b - a) / np.linalg.norm(b - a)
        for part in (*np.linspace(0, 1, 15), *np.linspace(1, 0, 15)):
            x, y = a + part * (b - a)
            # 30 µrad of squareness, a bow and a scale of 8 ppm
            error = np.array([0.008 * x - 0.03 * y, 6.0 * (x / 600.0) ** 2 + 0.008 * y])
            error[0] += twist * (x - 300.0) * (y - 300.0) / 9e4
            value = float(error @ along) + SD * rng.normal()
            if name[0] == "g":
                value += 1e3 * gauge * part * float(np.linalg.norm(b - a))
            time += 20.0
            rows.append(
                f"{time},{name},displacement,{x:.3f},{y:.3f},1,1,"
                f"{along[0]:.9f},{along[1]:.9f},0,{value:.4f},{SD}"
            )
        time += 3600.0
    path = folder / "campaign.csv"
    path.write_text("\n".join([*heads, *rows]) + "\n")
    return read_campaign(path, model.machine)


def test_lines_of_several_days_are_one_line(tmp_path: Path) -> None:
    model = parse_model(TomlSource(TABLE))
    found = same_lines(campaign(tmp_path, model).conditions)
    assert sorted(len(rows) for rows in found) == [30] * 4 + [90] * 4


@pytest.mark.parametrize(
    ("gauge", "twist", "degree", "foretold"), [(GAUGE, 0.0, 4, False), (0.0, 12.0, 2, True)]
)
def test_a_gauge_foretells_its_own_lines_only(
    tmp_path: Path, gauge: float, twist: float, degree: int, foretold: bool
) -> None:
    """A polynomial beside the motions: of a gauge, and of a bed that is twisted."""
    text = TABLE + "".join(f"[[effects]]\n{one}" for one in MOTIONS)
    model = parse_model(TomlSource(text))
    rows = campaign(tmp_path, model, gauge=gauge, twist=twist)
    (effects,) = [
        found
        for found in smooth_errors(model.machine, rows)
        if len(found[0].linear(model.machine)) == {2: 1, 4: 6}[degree]
    ]
    more, added = model, []
    for one in effects:
        more, effect = with_effect(more, one.kind, one.where())
        added.append(effect)
    before, result = fit(model, rows), fit(more, rows)
    # each day foretells the next, whichever it is
    was, now = (LeftOutErrors.of(r, added) for r in (before, result))
    assert was.falls_to(now, result, bound=False) < 0.95
    assert foretells_other_lines(before, result, added) is foretold
