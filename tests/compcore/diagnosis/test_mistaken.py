"""Mistakes of who wrote a campaign: each is found by what it did to a sound one, and none else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.units_of_set_ups import other_units
from abbe.compcore.diagnosis.mistaken import mistakes
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model

DATA = Path(__file__).parents[2] / "data" / "p02-bridge"
MODEL = load_model(DATA / "model.toml")
ONE = "c0_y_pos0"
"""A line along Y at the targets of two more."""


@pytest.fixture(scope="module")
def sound() -> Campaign:
    """Lines and diagonals of a bridge with six thermometers, made by another simulator."""
    return read_campaign(DATA / "fit.csv", MODEL.machine)


def moved(campaign: Campaign, setup: str, axis: str, change) -> Campaign:
    c = campaign.conditions
    q = np.where(c.setup == setup, change(c.positions[axis]), c.positions[axis])
    return replace(campaign, conditions=replace(c, positions={**c.positions, axis: q}))


def reading(campaign: Campaign, **signals: np.ndarray) -> Campaign:
    c = campaign.conditions
    return replace(campaign, conditions=replace(c, signals={**c.signals, **signals}))


def said(campaign: Campaign, model: Model = MODEL) -> list[str]:
    return [str(m.words) for m in mistakes(model, campaign)]


def test_a_sound_campaign_holds_none(sound: Campaign) -> None:
    assert not said(sound)
    assert not said(sound, Model(MODEL.machine, ()))
    assert not list(other_units(sound, MODEL.machine))


def test_a_thermometer_in_fahrenheit_from_a_row_on_stops_the_way(sound: Campaign) -> None:
    """Fitted with it, a scale of 10 ppm/K was one of −0.4, and the verdict complete."""
    names = [n for n, s in MODEL.machine.signals.items() if s.role == "scale"]
    value = sound.conditions.signals[names[0]]
    late = sound.conditions.time > np.median(sound.conditions.time)
    wrong = reading(sound, **{names[0]: np.where(late, 1.8 * value + 32.0, value)})
    with pytest.raises(InputError, match=f"{names[0]} reads .* was it switched"):
        to_the_verdict(MODEL, wrong)


@pytest.mark.parametrize("model", [MODEL, Model(MODEL.machine, ())], ids=["full", "bare"])
def test_one_set_up_in_inches(sound: Campaign, model: Model) -> None:
    wrong = moved(sound, ONE, "Y", lambda q: q / 25.4)
    (found,) = said(wrong, model)
    assert found.startswith(f"the positions of Y in the set-up {ONE} look like inches")
    assert "Multiply its column Y by 25.4" in found


def test_two_set_ups_in_inches(sound: Campaign) -> None:
    wrong = moved(moved(sound, ONE, "Y", lambda q: q / 25.4), "c0_x_pos1", "X", lambda q: q / 25.4)
    assert [w.split(" look")[0] for w in sorted(said(wrong))] == [
        "the positions of X in the set-up c0_x_pos1",
        f"the positions of Y in the set-up {ONE}",
    ]


def test_inches_at_targets_of_their_own_are_told_by_the_values(sound: Campaign) -> None:
    wrong = moved(sound, ONE, "Y", lambda q: (q * 0.93 + 7.3) / 25.4)
    assert not list(other_units(wrong, MODEL.machine))
    (found,) = said(wrong)
    assert "inches" in found
    assert "so the values ask" in found


def test_a_set_up_with_the_other_sign(sound: Campaign) -> None:
    turned = np.where(sound.conditions.setup == ONE, -sound.value, sound.value)
    (found,) = said(replace(sound, value=turned))
    assert found.startswith(f"the values of the set-up {ONE} have the other sign")
    assert "Multiply its column value by −1" in found


def test_exchanged_thermometers(sound: Campaign) -> None:
    signals = sound.conditions.signals
    (found,) = said(reading(sound, T_x=signals["T_y"], T_y=signals["T_x"]))
    assert found.startswith("T_x and T_y look exchanged (they read ")


def test_nothing_is_added_by_a_mistake(sound: Campaign) -> None:
    wrong = moved(sound, ONE, "Y", lambda q: q / 25.4)
    with pytest.raises(InputError, match="nothing was added: found .*look like inches"):
        to_the_verdict(MODEL, wrong)


def test_lines_that_are_no_mistake(sound: Campaign) -> None:
    """A short line with fine steps, and one over the other half of an axis about its zero."""
    short = moved(sound, ONE, "Y", lambda q: q / 20.0)
    assert not list(other_units(short, MODEL.machine))
    both = replace(MODEL.machine, axes={
        a: replace(x, travel=(-x.travel[1] - 1.0, x.travel[1] + 1.0))
        for a, x in MODEL.machine.axes.items()
    })  # fmt: skip
    half = moved(sound, ONE, "Y", lambda q: -q)
    assert not list(other_units(half, both))


def late(campaign: Campaign, seconds: float) -> Campaign:
    """The campaign with all thermometers as they read so many seconds before each row."""
    c = campaign.conditions
    before = {n: np.interp(c.time - seconds, c.time, v) for n, v in c.signals.items()}
    return reading(campaign, **before)


def test_a_logger_without_summer_time(sound: Campaign) -> None:
    (found,) = said(late(sound, 3600.0))
    assert found.startswith("the thermometers look 1 h late")


def test_a_late_logger_beside_a_base_point_of_the_last_hour(tmp_path: Path) -> None:
    """Readings so much later end before the last set-up, whose base point is an unknown."""
    lines = (DATA / "fit.csv").read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("#")]
    names, *rows = (line.split(",") for line in lines if not line.startswith("#"))
    bases: dict[str, np.ndarray] = {}
    for row in reversed(rows):
        cell = dict(zip(names, row, strict=True))
        base = {"c0_diag0": "B1", "c2_diag9": "A1"}.get(cell["setup"], "")
        row.append(base)
        if not base:
            continue
        # beyond a diagonal's end, what is measured along it of a point is its distance
        point = np.array([float(cell[a]) + float(cell[f"tool_{a.lower()}"]) for a in "XYZ"])
        along = np.array([float(cell[u]) for u in ("ux", "uy", "uz")])
        where = bases.setdefault(base, point - 1500.0 * along)
        far = float(np.linalg.norm(point - where)) + 1e-3 * float(cell["value"])
        row[names.index("kind")], row[names.index("value")] = "distance", f"{far:.6f}"
    for base, where in bases.items():
        head += [f"# [bases.{base}]", f"# position = {where.tolist()}"]
    path = tmp_path / "campaign.csv"
    table = [",".join(row) for row in ([*names, "base"], *rows)]
    path.write_text("\n".join([*head, *table]) + "\n", encoding="utf-8")
    (found,) = said(late(read_campaign(path, MODEL.machine), 3600.0))
    assert found.startswith("the thermometers look 1 h late")


@pytest.mark.parametrize("seconds", [900.0, -3600.0], ids=["a housing", "the other way"])
def test_thermometers_that_are_late_otherwise_are_no_mistake(
    sound: Campaign, seconds: float
) -> None:
    """Late in its housing, or later than its body: that is a lag, and a cause."""
    assert not said(late(sound, seconds))
