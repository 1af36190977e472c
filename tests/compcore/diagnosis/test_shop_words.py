"""Causes in the shop's words: every kind of the catalogue, and sizes as the shop counts them."""

from __future__ import annotations

import pytest

from abbe.compcore.comparison.approach import SideDifference
from abbe.compcore.diagnosis.shop_words import in_the_shop, kinds_said
from abbe.compcore.effects.registry import effect_kinds, make_effect
from abbe.compcore.machine.structure import Structure
from tests.support.compcore.catalogue import ROWS

OF_THE_CATALOGUE = ("E_", "backlash", "kind", "parameter", "lateral", "shape")


def test_every_kind_of_the_catalogue_has_its_words():
    assert set(effect_kinds()) - kinds_said() == set()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.label)
def test_words_name_who_and_how_much_and_nothing_of_the_catalogue(row):
    effect = make_effect(row.kind, dict(row.keys))
    words = in_the_shop(effect, 7.0, "µm")
    assert "µm" in words
    assert words[0] == words[0].upper()
    where = effect.where()
    assert not [w for w in OF_THE_CATALOGUE if w in words.replace(str(where.get("channel")), "")]
    for key in ("axis", "signal", "setup"):
        if key in where and row.kind not in ("overhang_sag",):
            assert str(where[key]) in words, words


@pytest.mark.parametrize(
    ("kind", "where", "values", "words"),
    [
        ("backlash", {"axis": "Z"}, [(0.0054, "mm")],
         "Z stands 5.4 µm elsewhere when it comes from above"),
        ("backlash", {"axis": "X", "shape": "spline:4"}, [(1.0, "mm")] * 4,
         "X stands 6 µm elsewhere when it comes from the plus side"),
        ("reversal_angle", {"axis": "Y", "about": "X"}, [(-12e-6, "rad")],
         "Y cocks about X when it reverses: 12 µrad"),
        ("thermal_tilt", {"axis": "Y", "about": "X", "signals": ["T_f", "T_r"]}, [(1.0, "rad/K")],
         "Y leans about X when T_f and T_r differ, 3 µm at the tool"),
        ("warm_up", {"direction": "X"}, [(0.004, "mm")], "X creeps by 3 µm after switch-on"),
    ],
)  # fmt: skip
def test_sizes(kind, where, values, words):
    """Of a machine whose Z stands upright."""
    assert in_the_shop(make_effect(kind, where), 3.0, "µm", values) == words


@pytest.mark.parametrize(
    ("structure", "axis", "side"),
    [
        ("w b Y X Z t", "Z", "from above"),
        # a lathe's Z lies, and a horizontal spindle's
        ("w (C') b Z X t", "Z", "from the plus side"),
        ("w B' X' Z' b Y W (C) t", "W", "from the plus side"),
        ("w B' X' Z' b Y W (C) t", "Y", "from above"),
        ("w C' X' b Y Z B (C) t", "C", "from the plus side"),
    ],
)
def test_above_is_said_of_what_stands_upright(structure, axis, side):
    play = make_effect("backlash", {"axis": axis})
    upright = Structure.parse(structure).upright
    words = in_the_shop(play, 3.0, "µm", [(0.0054, "mm")], upright)
    assert words == f"{axis} stands 5.4 µm elsewhere when it comes {side}"
    seen = SideDifference(axis, axis, 5.4e-3, 1e-4, 0.5, upright)
    assert str(seen.short) == f"{axis} stands 5.4 µm elsewhere when it comes {side}"
