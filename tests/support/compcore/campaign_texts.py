"""Small campaign files and the machine that they measure, for the tests of campaigns."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure

DATA = Path(__file__).parents[2] / "data"

MILL = Machine(
    "Five-axis mill",
    Structure.parse("w X' b Y Z B (C) t"),
    {
        "X": Axis("X", (0.0, 800.0)),
        "Y": Axis("Y", (0.0, 500.0)),
        "Z": Axis("Z", (-450.0, 0.0)),
        "B": Axis("B", (-2.0, 2.0)),
    },
    {"T_x": Signal("T_x", "degC", "scale", "X")},
)
CMM = Machine(
    "Bridge CMM",
    Structure.parse("w b Y X Z t"),
    {
        "X": Axis("X", (0.0, 700.0)),
        "Y": Axis("Y", (0.0, 900.0)),
        "Z": Axis("Z", (-360.0, 0.0)),
    },
    {"T_x": Signal("T_x", "degC", "scale", "X")},
)

GOOD = """\
# format = "abbe-campaign/1"
# machine = "Bridge CMM"
# instrument = "laser interferometer"
# notes = "warm-up 2 h; load none; feed 1500 mm/min"
# [setups.x_pos_1]
# free = ["zero"]
# [setups.x_straight_y]
# free = ["zero", "slope"]
# [bases.B1]
# position = [10.0, 20.0, -400.0]
# [bases.B2]
# position = [600.0, 20.0, -400.0]
# [tools.T1]
# offset = [0.0, 0.0, -150.0]
# free = ["x", "z"]
time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,tool_x,tool_y,tool_z,ux,uy,uz,value,sd,T_x,T_amb,tool,base,base2
0.0,x_pos_1,displacement,0,450,-180,1,0,0,0,0,-150,1,0,0,0.00,0.5,20.11,20.3,,,
1.5,x_pos_1,displacement,100,450,-180,1,0,0,0,0,-150,1,0,0,1.25,0.5,20.12,20.3,,,
3.0,x_straight_y,rotation,100,450,-180,-1,0,0,,,,0,0.6,-0.8,-2.5,,20.12,20.3,T1,,
9.0,ball bar,distance,100,450,-180,0,0,0,,,,,,,412.345678,0.0006,20.12,20.3,T1,B1,
9.9,bases,base_distance,,,,,,,,,,,,,590.001,0.0006,,,,B1,B2
"""
"""A file of every kind of row; its header is on line 16."""
HEADER = 16


def good_lines() -> list[str]:
    """The lines of `GOOD`."""
    return GOOD.splitlines()


def read_text(folder: Path, text: str | bytes, machine: Machine = CMM) -> Campaign:
    """Read a campaign from its text."""
    path = folder / "campaign.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_campaign(path, machine)
