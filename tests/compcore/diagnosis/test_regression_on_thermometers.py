"""Many thermometers, noise that stays for hours: no worse than a regression on all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.regression import regression
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.diagnosis.uncatalogued.chosen import judged_along
from abbe.compcore.effects import make_effect
from abbe.compcore.files.campaign_file import read_campaigns
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from benchmarks.thermal import learners

F64 = NDArray[np.float64]

NAMES = ("T_air", "T_head", "T_rear", "T_left", "T_right", "T_bed")
HEAD = '# format = "abbe-campaign/1"\n# [setups.X]\n# free = ["zero"]\n'


def lathe() -> Model:
    lines = ['format = "abbe-model/1"', "[machine]", 'name = "lathe"', 'structure = "w b Z X t"']
    lines += ["[machine.axes.X]", "travel = [-100.0, 100.0]"]
    lines += ["[machine.axes.Z]", "travel = [0.0, 300.0]"]
    for name in NAMES:
        role = "ambient" if name == "T_air" else "structure"
        lines += [f"[machine.signals.{name}]", 'unit = "degC"', f'role = "{role}"']
    return parse_model(TomlSource("\n".join(lines) + "\n"))


def stays(n: int, kept: float, rng: np.random.Generator) -> F64:
    """Noise of variance 1 of which a part is kept from one reading to the next."""
    out = np.empty(n)
    fresh = rng.normal(0.0, np.sqrt(1.0 - kept**2), n)
    out[0] = rng.normal()
    for i in range(1, n):
        out[i] = kept * out[i - 1] + fresh[i]
    return out


def days(
    folder: Path,
    rng: np.random.Generator,
    shift: F64,
    count: int,
    *,
    noise: float = 1.5,
    alike: float = 0.7,
    kept: float = 0.9,
) -> list[Path]:
    """Days read every ten minutes for eight hours; thermometers that differ by `alike`, K.

    Above all they follow the same air; the machine moves by `shift`, µm/K, noise of which the part
    `kept` stays from reading to reading.
    """
    paths = []
    for _ in range(count):
        t = 600.0 * np.arange(48)
        air = 2.0 * np.sin(2.0 * np.pi * 1.3 * t / 86_400.0 + rng.uniform(0.0, 6.0))
        air += stays(len(t), 0.97, rng)
        read = np.array(
            [22.0 + rng.normal(0.0, 0.5) + air + alike * stays(len(t), 0.95, rng) for _ in NAMES]
        )
        value = shift @ read + noise * stays(len(t), kept, rng) + rng.normal(0.0, 0.3, len(t))
        shown = np.round(read / 0.05) * 0.05
        text = HEAD + "time,setup,kind,X,Z,ux,uy,uz,value,sd," + ",".join(NAMES) + "\n"
        for s, v, cells in zip(t, value - value[0], shown.T, strict=True):
            signals = ",".join(f"{c:.2f}" for c in cells)
            text += f"{s:.0f},X,displacement,0,0,1,0,0,{v:.3f},0.3,{signals}\n"
        paths.append(folder / f"day-{len(list(folder.iterdir()))}.csv")
        paths[-1].write_text(text, encoding="utf-8")
    return paths


@pytest.fixture
def model() -> Model:
    return lathe()


def campaign(model: Model, paths: list[Path]) -> Campaign:
    return read_campaigns(paths, model.machine)


LEANS = 0.7 * np.array([0.3, -0.5, 0.4, 2.0, -2.0, 0.2])
"""A headstock that leans by the difference of its left and right, and by little else."""


def test_two_that_say_nothing_one_by_one_are_taken_together(tmp_path: Path, model: Model) -> None:
    rng = np.random.default_rng(12)
    seen = campaign(model, days(tmp_path, rng, LEANS, 4))
    later = campaign(model, days(tmp_path, rng, LEANS, 6))
    last = to_the_verdict(model, seen).last.result.model
    read = {s for e in last.effects for s in e.signals_needed()}
    assert {"T_left", "T_right"} <= read
    foretold = learners.rms(compare(last, later).residual, later)
    sheet = learners.rms(later.value - learners.spreadsheet(seen, later), later)
    assert foretold < 1.1 * sheet


def test_a_regression_takes_what_moves_the_machine(tmp_path: Path, model: Model) -> None:
    rng = np.random.default_rng(3)
    shift = np.array([0.0, 0.0, 0.0, 4.0, -3.0, 0.0])
    seen = campaign(model, days(tmp_path, rng, shift, 6, noise=0.2))
    effects = regression(fit(model, seen))
    read = [e.signals_needed()[0] for e in effects]
    assert {"T_left", "T_right"} <= set(read)
    assert all(e.kind == "thermal_offset" for e in effects)


def test_of_thermometers_that_read_the_same_one_is_taken(tmp_path: Path, model: Model) -> None:
    rng = np.random.default_rng(5)
    seen = campaign(model, days(tmp_path, rng, np.full(6, 0.5), 6, noise=0.2, alike=0.01))
    assert len(regression(fit(model, seen))) == 1


def test_what_follows_a_temperature_is_not_judged_by_passes(model: Model) -> None:
    warm = make_effect("formula", {"channel": "dX", "terms": ["Z*T_air"]})
    plain = make_effect("formula", {"channel": "dX", "terms": ["Z**2"]})
    assert judged_along([warm], model.machine) == ()
    assert judged_along([plain], model.machine) == ("Z",)
