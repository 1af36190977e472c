"""The configuration and the model that ``abbe run`` is given."""

from __future__ import annotations

from pathlib import Path

from abbe.drivers.simulated.torment.judge.evidence import AXES
from abbe.drivers.simulated.torment.judge.promises import Promises
from abbe.drivers.simulated.torment.motion import TRAVEL
from abbe.drivers.simulated.torment.wires.base import TormentWire


def write_configuration(folder: Path, wire: TormentWire, promises: Promises) -> Path:
    """Write ``model.toml`` and ``config.toml``; hands back the latter's path."""
    (folder / "model.toml").write_text(_model(promises), encoding="utf-8")
    path = folder / "config.toml"
    path.write_text(_config(wire, promises), encoding="utf-8")
    return path


def _model(p: Promises) -> str:
    travels = "".join(
        f"[machine.axes.{axis}]\ntravel = [{low}, {high}]\n"
        for axis, (low, high) in zip(AXES, TRAVEL, strict=True)
    )
    return f"""format = "abbe-model/1"
[machine]
name = "Tormented"
structure = "w b Y X Z t"
reference_temperature = 20.0
{travels}
[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"

[[effects]]
kind = "scale"
axis = "X"
[effects.parameters.k]
value = {p.scale_x}
sd = 1e-7
unit = "1"

[[effects]]
kind = "scale"
axis = "Y"
[effects.parameters.k]
value = {p.scale_y}
sd = 1e-7
unit = "1"

[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
[effects.parameters.alpha]
value = {p.expansion_x}
sd = 1e-7
unit = "1/K"
"""


def _config(wire: TormentWire, p: Promises) -> str:
    out = wire.write_link
    axes = "".join(f'[axes.{a}]\nsource = "m.{a}"\n' for a in AXES)
    targets = "".join(f'[output.axes.{a}]\ntarget = "{out}.out_{a}"\n' for a in AXES)
    watch = ""
    if "beat" in wire.READ:
        watch += f'heartbeat = "m.beat"\nheartbeat_within = {p.heartbeat_within}\n'
    if "status" in wire.READ:
        watch += 'status = "m.status"\nrequire = 4\nforbid = 8\n'
    echo = ""
    if "echo" in wire.WRITTEN:
        echo = f'echo = [{{ source = "m.number", target = "{out}.out_echo" }}]\n'
    return f"""format = "abbe-config/1"
model = "model.toml"

[cycle]
period = 0.02
signals_every = 0.1

[guard]
max_correction = {p.max_correction}
max_rate = {p.max_rate}
stale_after = {p.stale_after}
signals_stale_after = {p.signals_stale_after}
hold = {p.hold}
ramp = {p.ramp}

[controller]
{watch}
{axes}
[signals.T_x]
source = "m.T_x"

[output]
status = "{out}.out_status"
heartbeat = "{out}.out_beat"
{echo}{targets}
{wire.links}
"""
