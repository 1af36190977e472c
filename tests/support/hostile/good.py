"""Good files to be damaged: each is read as it stands (`test_hostile_good.py`)."""

from __future__ import annotations

import base64
import struct
import zlib

MODEL = """\
format = "abbe-model/1"

[machine]
name = "Bridge CMM"
structure = "w b Y X Z t"
reference_temperature = 20.0

[machine.axes.X]
travel = [0.0, 700.0]
[machine.axes.Y]
travel = [0.0, 900.0]
rotation_point = 10.0
[machine.axes.Z]
travel = [-360.0, 0.0]
location = [1.0, 2.0, 3.0]

[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"
location = "X scale, left end"

[[effects]]
kind = "positioning"
axis = "X"
shape = "polynomial:1"
[effects.parameters.c0]
value = 0.001
sd = 0.0001
unit = "mm"
[effects.parameters.c1]
value = -0.002
sd = 0.0001
unit = "mm"

[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
[effects.parameters.alpha]
value = 1.6e-5
sd = 2.0e-7
unit = "1/K"

[fit]
date = "2026-01-01T00:00:00+00:00"
n = 60
unit = "um"
rms = 0.31
noise_floor = 0.3
chi2_per_dof = 1.1
dof = 55
abbe = "0.1.0"
covariance = "@COVARIANCE@"
[[fit.campaigns]]
file = "day1.csv"
sha256 = "00ff"

[[history]]
date = "2025-12-01T00:00:00+00:00"
rms = 1.2
n = 60
effects = 1
"""


def covariance(*numbers: float) -> str:
    """Numbers of an upper triangle, packed as a model file holds them."""
    return base64.b64encode(zlib.compress(struct.pack(f"<{len(numbers)}d", *numbers))).decode()


def model(text: str = MODEL, packed: str | None = None) -> str:
    """A model file's text with a covariance put in."""
    good = covariance(1e-8, 0.0, 0.0, 1e-8, 0.0, 4e-14)
    return text.replace("@COVARIANCE@", good if packed is None else packed)


UNFITTED = (
    MODEL[: MODEL.index("[[effects]]")]
    + """\
[[effects]]
kind = "positioning"
axis = "X"
shape = "polynomial:2"
[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
"""
)

CAMPAIGN = """\
# format = "abbe-campaign/1"
# machine = "Bridge CMM"
# [setups.x1]
# free = ["zero"]
# [bases.B1]
# position = [10.0, 20.0, -400.0]
# [tools.T1]
# offset = [0.0, 0.0, -150.0]
# free = ["z"]
time,setup,kind,X,Y,Z,X_dir,tool_x,tool_y,tool_z,ux,uy,uz,value,sd,T_x,tool,base
""" + "".join(
    f"{10 * i}.5,x{i // 30},displacement,{50 * (i % 15)},450,-180,{1 if i // 15 % 2 else -1},"
    f"0,0,-150,1,0,0,{0.01 * i * (i % 15):.2f},0.5,{20 + 0.07 * i:.2f},,\n"
    for i in range(60)
)

POINTS = """\
name,X,Y,Z,X_dir,tool_x,tool_y,tool_z,T_x,remark
p1,10,20,-30,1,0,0,-80,20.5,first
p2,600,20,-30,-1,0,0,-80,21.5,"second, quoted"
p3,300.5,820.25,-330,0,0,0,-80,22.5,
"""
