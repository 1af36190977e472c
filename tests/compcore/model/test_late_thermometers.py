"""Thermometers that follow late: said where an expansion is surely negative behind a lag."""

from __future__ import annotations

import pytest

from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.late_thermometers import late_thermometers
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.model.revise import with_effect
from tests.compcore.campaign.test_steady_thermometers import MACHINE, TIME, WARM, campaign


def fitted(kind: str, keys: dict[str, object], **values: tuple[float, float]) -> Model:
    _, effect = with_effect(Model(MACHINE, ()), kind, keys)
    return Model(MACHINE, (Term(effect, {n: Value(*v, True) for n, v in values.items()}),))


SCREW = {"axis": "X", "signal": "T_x"}


@pytest.mark.parametrize(
    ("kind", "keys", "values", "late"),
    [
        ("screw_heating", SCREW | {"tau": "fit"}, {"k": (-16e-6, 1e-6), "tau": (650, 60)}, True),
        ("screw_heating", SCREW | {"tau": "fit"}, {"k": (-6e-6, 2e-6), "tau": (650, 60)}, False),
        ("screw_heating", SCREW | {"tau": "fit"}, {"k": (14e-6, 1e-6), "tau": (650, 60)}, False),
        ("screw_heating", SCREW, {"k": (-16e-6, 1e-6)}, False),  # no lag: a turned sign
        (
            "thermal_offset",
            {"direction": "X", "signal": "T_x", "tau": "fit"},
            {"k": (-0.9, 0.01), "tau": (650, 60)},
            False,  # a column leans one way or the other
        ),
    ],
)
def test_what_is_negative_behind_a_lag(kind, keys, values, late) -> None:
    found = list(late_thermometers(fitted(kind, keys, **values)))
    assert len(found) == late
    assert all("most likely T_x follows late" in words for words in found)


def test_a_thermometer_in_its_housing() -> None:
    """The scale follows at once; what reads it is 20 minutes behind."""
    read = WARM.copy()
    for i in range(1, len(TIME)):
        part = 1.0 - 2.718281828 ** (-(TIME[i] - TIME[i - 1]) / 1200.0)
        read[i] = read[i - 1] + part * (WARM[i] - read[i - 1])
    model, _ = with_effect(Model(MACHINE, ()), "scale_expansion", {"axis": "X", "signals": ["T_x"]})
    model, _ = with_effect(model, "screw_heating", SCREW | {"tau": "fit"})
    late = fit(model, campaign(read, WARM))
    assert late.chi2_per_dof < 1.3
    assert any("most likely T_x follows late" in words for words in late.suspicions)
    prompt = fit(model, campaign(WARM, WARM))
    assert not any("follows late" in words for words in prompt.suspicions)


def test_a_screw_that_shrinks_at_once_is_none() -> None:
    (effect,) = fitted("screw_heating", SCREW).effects
    assert effect.misnamed({"k": -16e-6})
    assert not effect.misnamed({"k": 11.5e-6})
