"""Of causes that no lever tells apart, the likelier one is named."""

from __future__ import annotations

import math
import random

from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging.trial import as_campaign

BRIDGE = """format = "abbe-model/1"
[machine]
name = "bridge"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 700.0]
[machine.axes.Y]
travel = [0.0, 900.0]
[machine.axes.Z]
travel = [-360.0, 0.0]
[machine.signals.T_air]
unit = "degC"
role = "air"
"""


def test_an_offset_before_a_tilt_whose_lever_is_always_the_same() -> None:
    """A beam on one stand with six lines: with one stylus a tilt of Z says what a shift says.

    Both foretell the same to the last digits, and these chose the tilt (34 µrad/K) before.
    """
    noise = random.Random(7)
    model = parse_model(TomlSource(BRIDGE))
    head = '# format = "abbe-campaign/1"\n# instrument = "laser interferometer"\n'
    head += "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,tool_z,ux,uy,uz,value,sd,T_air\n"
    rows: list[str] = []
    t = 0.0
    for line in range(6):
        there = [600.0 * i / 12 for i in range(13)]
        for x, way in [(x, w) for w in (1, -1, 1, -1) for x in (there if w > 0 else there[::-1])]:
            air = 20.0 + 2.5 * math.sin(t / 9000.0) + t / 7200.0
            value = 0.003 * x + 3.348 * air + noise.gauss(0.0, 0.2)
            place = f"{x:g},{100 + 60 * line},{-50 - 25 * line},{way},0,0,-100,1,0,0"
            rows.append(f"{t:.0f},x{line},displacement,{place},{value:.4f},0.2,{air:.3f}")
            t += 20.0
        t += 600.0
    found = diagnose(model, as_campaign(head + "\n".join(rows) + "\n", model))
    specs = [e.effect.spec for e in found.established]
    assert "thermal_offset direction=X signal=T_air" in specs
    (offset,) = [e for e in found.established if e.effect.kind == "thermal_offset"]
    alike = [a.found.candidate.effect.kind for a in offset.aliases]
    assert "thermal_tilt" in alike
    assert "dead_path" in alike
