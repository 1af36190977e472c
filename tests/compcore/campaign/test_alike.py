"""Rows of one name, of all names in one go."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from abbe.compcore.campaign import suspicions
from abbe.compcore.campaign.alike import alike
from abbe.compcore.campaign.campaign import Campaign, Kind


def test_each_row_stands_once_with_those_of_its_name() -> None:
    names = np.array(["b", "a", "b", "c", "a"])
    assert [rows.tolist() for rows in alike(names)] == [[1, 4], [0, 2], [3]]
    assert alike(names[:0]) == []


def test_many_set_ups_are_not_each_looked_for_among_all_rows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 400 set-ups of two rows no row is handed on more than a few times."""
    looked = 0
    real = suspicions._ratio

    def counted(measured: Any, predicted: Any, weight: Any, rows: Any) -> float | None:
        nonlocal looked
        looked += len(rows)
        return real(measured, predicted, weight, rows)

    monkeypatch.setattr(suspicions, "_ratio", counted)
    setup = np.repeat([f"s{i}" for i in range(400)], 2)
    n = len(setup)
    campaign = SimpleNamespace(
        conditions=SimpleNamespace(setup=setup), kind=np.full(n, Kind.DISPLACEMENT)
    )
    assert not list(
        suspicions.of_ratio(cast(Campaign, campaign), np.zeros(n), np.zeros(n), np.ones(n))
    )
    assert looked <= 4 * n
