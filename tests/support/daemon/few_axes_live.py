"""A run of a machine that has one linear axis and a table, on the registers of the bridge CMM."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from abbe.daemon.demo.configuration import demo_configuration
from abbe.daemon.demo.simulator import simulated_bridge

MODEL = """format = "abbe-model/1"
[machine]
name = "Table"
serial = "T-7"
structure = "w C' b X t"
[machine.axes.C]
travel = [-360, 360]
[machine.axes.X]
travel = [0, 700]
[[effects]]
kind = "scale"
axis = "X"
[effects.parameters]
k = {value = 20e-6}
"""
_OTHERS = ("axes.Y]", "axes.Z]", "output.axes.Y]", "output.axes.Z]", "reference.", "signals.")


@contextmanager
def table_and_slide(folder: Path) -> Iterator[Path]:
    """The configuration of it; X is corrected, C is read alone."""
    with simulated_bridge(1, 1.0, ["--noise", "0"]) as simulator:
        text = demo_configuration(simulator.ready, os.fspath(folder / "model.toml"), records=True)
        kept = [part for part in text.split("\n[") if not part.startswith(_OTHERS)]
        read = next(r for r in simulator.ready["registers"] if r["name"] == "count_Y")
        # what the bridge counts along Y is the table's angle here
        where = f'table = "{read["table"]}", address = {read["address"]}, type = "{read["type"]}"'
        turned = f'angle = {{ {where}, scale = 1e-5, unit = "deg" }}\n'
        (folder / "model.toml").write_text(MODEL, encoding="utf-8")
        config = folder / "config.toml"
        config.write_text(
            "\n[".join([*kept[:-1], kept[-1] + turned]) + '[axes.C]\nsource = "cmm.angle"\n',
            encoding="utf-8",
        )
        yield config
