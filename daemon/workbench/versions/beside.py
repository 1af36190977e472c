"""Two versions side by side: the same campaigns, what each leaves of them, in what they differ."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import sentences_in
from abbe.compcore.units import read_in, with_uncertainty
from abbe.daemon.answers.model.compare import with_changes
from abbe.daemon.report.model.compare import key_figures, told_apart, verdict_title, where_of
from abbe.daemon.report.page import Cell, in_words, plain
from abbe.daemon.workbench.campaigns.laid import LaidCampaigns
from abbe.daemon.workbench.residuals.rows import panels, rows_json, shown_rows, values_json
from abbe.daemon.workbench.versions.folder import ModelVersion

_PICTURES = 6
"""Along axes, where the two differ most."""


class SideBySide:
    """Answers about pairs of versions; the last one is kept."""

    def __init__(self) -> None:
        self._last: tuple[tuple[ModelVersion, ModelVersion, LaidCampaigns], bytes] | None = None

    def answer(self, left: ModelVersion, right: ModelVersion, laid: LaidCampaigns) -> bytes:
        """Two versions side by side, as JSON; worked out when it is asked for.

        Raises
        ------
        InputError
            Without a campaign, and for one that lacks a signal.
        """
        asked, last = (left, right, laid), self._last
        if last is not None and last[0] == asked:
            return last[1]
        for version in (left, right):
            require_signals(laid.rows, version.model)
        found = beside(left, right, laid.rows)
        text = json.dumps(found, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        self._last = asked, text.encode()
        return self._last[1]


def beside(left: ModelVersion, right: ModelVersion, campaign: Campaign) -> dict[str, Any]:
    """One object for the page, lengths µm, angles µrad.

    Parameters
    ----------
    left, right
        The versions.
    campaign
        What both are laid beside.
    """
    one, other = (
        with_changes(v.model, campaign, compare(v.model, campaign)) for v in (left, right)
    )
    rows = shown_rows(campaign, one.residual)
    found = {
        "sides": [
            {
                "name": version.path.name,
                "title": verdict_title(comparison),
                "holds": comparison.holds,
                "key": [list(figure) for figure in key_figures(comparison)],
            }
            for version, comparison in ((left, one), (right, other))
        ],
        "rows": rows_json(campaign, left.model.machine, rows),
        "before": values_json(campaign, rows, one.residual),
        "values": values_json(campaign, rows, other.residual),
        "of": int(np.isfinite(one.residual).sum()),
        "panels": _most_changed(campaign, rows, one, other),
        "groups": list(_groups(one, other)),
        "only": list(_only(left.model, right.model)),
        "columns": ["Cause", "parameter", left.path.name, right.path.name],
        "causes": list(_causes(left.model, right.model)),
    }
    answer: dict[str, Any] = plain({**found, "sentences": sentences_in(found)})
    return answer


def _most_changed(
    campaign: Campaign, rows: np.ndarray, one: Comparison, other: Comparison
) -> list[dict[str, Any]]:
    """Pictures along axes, those first in which the two differ most."""
    change = one.residual - other.residual
    ordered = [p for p in panels(campaign, rows, change) if p["by"] == "axis"]
    lengths = [p for p in ordered if p["part"] == 0][:_PICTURES]
    return lengths + [p for p in ordered if p["part"] == 1][:_PICTURES]


def _groups(one: Comparison, other: Comparison) -> Iterator[dict[str, Any]]:
    """What each leaves by component and by set-up."""
    for k, (first, second, unit) in enumerate(
        ((one.lengths, other.lengths, "µm"), (one.rotations, other.rotations, "µrad"))
    ):
        if not first.n:
            continue
        for (title, groups), (_, others) in zip(
            told_apart(one, first), told_apart(other, second), strict=False
        ):
            where = partial(where_of, rotations=bool(k))
            same = {str(where(g)): g for g in others}
            cells: list[list[Cell]] = [
                [where(g), g.rms, same[str(where(g))].rms] for g in groups if str(where(g)) in same
            ]
            yield {"title": title, "part": k, "unit": unit, "cells": in_words(cells, 3)}


def _only(left: Model, right: Model) -> Iterator[list[str]]:
    """The causes that only the left, and only the right version has."""
    one, other = ([term.effect.spec for term in model.terms] for model in (left, right))
    yield [spec for spec in one if spec not in other]
    yield [spec for spec in other if spec not in one]


def _causes(left: Model, right: Model) -> Iterator[list[str]]:
    """Every value in which the two differ: cause, parameter, value in each, empty: none."""
    known = [_values(model) for model in (left, right)]
    for key in dict.fromkeys([*known[0], *known[1]]):
        pair = [values.get(key, "") for values in known]
        if pair[0] != pair[1]:
            yield [*key, *pair]


def _values(model: Model) -> dict[tuple[str, str], str]:
    found: dict[tuple[str, str], str] = {}
    for term in model.terms:
        effect = term.effect
        units = {p.name: read_in(p) for p in effect.linear(model.machine)}
        units |= {p.name: read_in(p) for p in effect.nonlinear(model.machine)}
        for name, value in term.values.items():
            unit, factor = units.get(name, ("", 1.0))
            sd = None if value.sd is None else value.sd * factor
            text = with_uncertainty(value.value * factor, sd)
            found[effect.spec, name] = f"{text} {unit}".strip()
    return found
