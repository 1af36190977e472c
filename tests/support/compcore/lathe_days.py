"""A lathe whose zero follows a spindle that nobody measured, and a cabinet that goes along."""

from __future__ import annotations

import numpy as np

LATHE = """format = "abbe-model/1"
[machine]
name = "lathe"
structure = "w b Z t"
[machine.axes.Z]
travel = [0.0, 250.0]
[machine.signals.head]
unit = "degC"
role = "spindle"
[machine.signals.cabinet]
unit = "degC"
role = "structure"
"""
DAYS = 6
PER_KELVIN = 4.0


def lathe_days(seed: int, *, alone: bool) -> str:
    """Days on which a spindle that nobody measured warms by chance, and the zero follows it.

    The cabinet warms as the spindle does, because the same work heats both; `alone`: its fan has
    failed, and it warms while the spindle stands.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for day in range(DAYS):
        t = np.arange(0.0, 14400.0, 300.0)
        work = np.where(np.sin(t / rng.uniform(900.0, 2500.0) + rng.uniform(0, 6)) > 0.0, 8.0, 0.0)
        spindle = np.zeros_like(t)
        for i in range(1, len(t)):
            spindle[i] = spindle[i - 1] + (work[i] - spindle[i - 1]) * (1 - np.exp(-300.0 / 3000.0))
        head = 20.0 + rng.normal(0.0, 1.0) + np.cumsum(rng.normal(0.0, 0.1, len(t)))
        shown = spindle + rng.normal(0.0, 0.2, len(t))
        if alone:
            shown = 9.0 * (t / t[-1])
        value = PER_KELVIN * spindle + rng.normal(0.0, 0.5, len(t))
        rows += [
            f"{day * 86400 + s:.0f},d{day},displacement,0,0,0,1,{v:.3f},{h:.2f},{25.0 + c:.2f}\n"
            for s, v, h, c in zip(t, value - value[0], head, shown, strict=True)
        ]
    head_lines = '# format = "abbe-campaign/1"\n' + "".join(
        f'# [setups.d{day}]\n# free = ["zero"]\n' for day in range(DAYS)
    )
    columns = "time,setup,kind,Z,ux,uy,uz,value,head,cabinet\n"
    return head_lines + columns + "".join(rows)
