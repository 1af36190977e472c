"""An arm's tool that is counted from its flange is noticed; one at its end is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.compcore.campaign.misplaced_tools import of_tools
from abbe.compcore.campaign.suspicions import of_campaign
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure

LINES = {
    "C1": (0.0, 0.0, 0.0), "B2": (150.0, 0.0, 400.0), "B3": (150.0, 0.0, 900.0),
    "A4": (0.0, 0.0, 1000.0), "B5": (900.0, 0.0, 1000.0), "A6": (0.0, 0.0, 1000.0),
}  # fmt: skip
ARM = Machine(
    "arm",
    Structure.parse(f"w b {' '.join(LINES)} t"),
    {name: Axis(name, (-2.0, 2.0), location=at) for name, at in LINES.items()},
    {},
)
UPRIGHT = Machine(
    "stretched out upwards",
    Structure.parse("w b C1 B2 B3 C4 B5 C6 t"),
    {
        name: Axis(name, (-2.0, 2.0), location=(0.0, 0.0, height))
        for name, height in zip(("C1", "B2", "B3", "C4", "B5", "C6"),
                                (0.0, 400.0, 900.0, 1000.0, 1300.0, 1300.0), strict=True)
    },
    {},
)  # fmt: skip
SCARA = Machine(
    "SCARA",
    Structure.parse("w b C C2 Z t"),
    {
        "C": Axis("C", (-2.0, 2.0)),
        "C2": Axis("C2", (-2.0, 2.0), location=(300.0, 0.0, 0.0)),
        "Z": Axis("Z", (-200.0, 0.0)),
    },
    {},
)
HEAD = Machine(
    "five axes with a head",
    Structure.parse("w X' Y' b Z C A t"),
    {n: Axis(n, (-2.0, 2.0), location=(0.0, 0.0, 300.0)) for n in "CA"}
    | {n: Axis(n, (0.0, 500.0)) for n in "XYZ"},
    {},
)


def with_tool(path: Path, machine: Machine, tool: tuple[float, ...]) -> list[str]:
    names = machine.structure.axes
    head = ",".join(["setup", "kind", *names, "tool_x,tool_y,tool_z,ux,uy,uz,value"])
    zeros = ",".join("0" for _ in names)
    at = ",".join(map(str, tool))
    rows = [f"s,displacement,{zeros},{at},{u},{k}" for k, u in enumerate(("1,0,0", "0,1,0"))]
    path.write_text("\n".join(['# format = "abbe-campaign/1"', head, *rows]) + "\n")
    campaign = read_campaign(path, machine)
    found = [str(s) for s in of_tools(campaign, machine)]
    assert [s for s in map(str, of_campaign(campaign, machine)) if "flange" in s] == found
    return found


@pytest.mark.parametrize(
    ("machine", "wrong", "right"),
    [
        (ARM, (100.0, 0.0, 80.0), (1000.0, 0.0, 1080.0)),
        (ARM, (0.0, 0.0, 0.0), (1000.0, 0.0, 1000.0)),
        (UPRIGHT, (0.0, 0.0, 100.0), (0.0, 0.0, 1400.0)),
        (SCARA, (0.0, 0.0, -50.0), (550.0, 0.0, -50.0)),
        (HEAD, None, (0.0, 0.0, -120.0)),
    ],
)
def test_a_tool_at_the_foot_is_noticed(
    tmp_path: Path,
    machine: Machine,
    wrong: tuple[float, ...] | None,
    right: tuple[float, ...],
) -> None:
    assert with_tool(tmp_path / "right.csv", machine, right) == []
    if wrong is not None:
        (said,) = with_tool(tmp_path / "wrong.csv", machine, wrong)
        assert "counts from the machine's origin, not from the flange" in said
