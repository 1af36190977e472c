"""Days in one file: a body that warms each day anew, and nights of which nobody knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.nights import stretches_between_nights
from abbe.compcore.files.campaign_file import read_campaigns
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit

DAY = 86400.0
TAU = 1800.0
MODEL = """format = "abbe-model/1"
[machine]
structure = "w (C') b Z X t"
[machine.axes]
X = { travel = [0, 200] }
Z = { travel = [0, 400] }
[machine.signals.T_spindle]
role = "spindle"
[[effects]]
kind = "thermal_offset"
direction = "X"
signal = "T_spindle"
tau = "fit"
"""


def day(number: int, rows: int, seed: int) -> list[str]:
    """A day's rows: the thermometer warms from 20 to 35 °C by e^(−t/1 h), the body follows it."""
    t = 60.0 * np.arange(rows)
    slow = 3600.0
    signal = 35.0 - 15.0 * np.exp(-t / slow)
    # τ·y' = T − y from y(0) = T(0), in closed form
    weight = slow / (slow - TAU)
    body = 35.0 - 15.0 * (weight * np.exp(-t / slow) + (1.0 - weight) * np.exp(-t / TAU))
    noise = np.random.default_rng(seed).normal(0.0, 0.3, rows)
    value = 5.0 * (body - 20.0) + 10.0 * number + noise
    return [
        f"{DAY * number + at:.0f},day{number},displacement,0,0,1,0,0,{v:.3f},0.3,{s:.4f}"
        for at, v, s in zip(t, value, signal, strict=True)
    ]


def campaign(path: Path, days: range) -> Path:
    head = ['# format = "abbe-campaign/1"']
    head += [line for k in days for line in (f"# [setups.day{k}]", '# free = ["zero"]')]
    head.append("time,setup,kind,X,Z,ux,uy,uz,value,sd,T_spindle")
    rows = [row for k in days for row in day(k, 120, k)]
    path.write_text("\n".join([*head, *rows]) + "\n", "utf-8")
    return path


def test_a_body_begins_each_day_as_cool_as_its_thermometer(tmp_path: Path) -> None:
    (tmp_path / "lathe.toml").write_text(MODEL, "utf-8")
    model = load_model(tmp_path / "lathe.toml")
    one = fit(model, read_campaigns(campaign(tmp_path / "one.csv", range(4)), model.machine))
    each = [campaign(tmp_path / f"{k}.csv", range(k, k + 1)) for k in range(4)]
    apart = fit(model, read_campaigns(each, model.machine))
    for result in (one, apart):
        term = result.model.terms[0]
        assert term.values["k"].value == pytest.approx(5e-3, rel=0.01)
        assert term.values["tau"].value == pytest.approx(TAU, rel=0.02)
        assert result.chi2 / result.dof < 1.2


def test_pauses_are_no_nights() -> None:
    lines = np.concatenate([np.arange(60) * 60.0 + k * 4.0 * 3600.0 for k in range(3)])
    assert not stretches_between_nights(lines).any()
    # one reading every eight hours is how it was measured
    assert not stretches_between_nights(np.arange(10) * 8.0 * 3600.0).any()
    assert not stretches_between_nights(np.zeros(3)).any()
    assert stretches_between_nights(np.zeros(0)).size == 0


def test_stretches_are_numbered_in_time_whatever_the_order_of_rows() -> None:
    time = np.array([DAY + 60.0, 0.0, 60.0, DAY, 2.0 * DAY, 2.0 * DAY + 60.0])
    assert stretches_between_nights(time).tolist() == [1, 0, 0, 1, 2, 2]
