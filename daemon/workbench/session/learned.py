"""What the page *Learn* shows: the answer of ``abbe diagnose``, and any cause tried by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from abbe.compcore.diagnosis.explain import explained, formula, headline
from abbe.compcore.diagnosis.findings import Established, measured_kinds
from abbe.compcore.diagnosis.next_measurement.measure_next import Advice
from abbe.compcore.diagnosis.pictures import CANDIDATES
from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.diagnosis.screening.pool import WeighedCandidate
from abbe.compcore.diagnosis.screening.what_if import WhatIf
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.diagnosis.words import advice_text, diagnosis_words
from abbe.compcore.errors import InputError
from abbe.compcore.units import read_in
from abbe.daemon.answers.typed import Adding
from abbe.daemon.report.model.cause_parameters import parameter_rows
from abbe.daemon.report.model.diagnosis import (
    said_in_the_shop,
    structure_words,
    verdict_title,
)
from abbe.daemon.report.page import in_words, plain
from abbe.daemon.workbench.residuals.rows import panels, rows_json, shown_rows, values_json

_REACH = 2.0
"""A slider goes so many times as far as the value that the data say."""
_DECADES = 20.0
"""Ratio of a slider's ends from which it goes by ratios."""
_TABLED = 10


def learned(
    diagnosis: Diagnosis, advice: Sequence[Advice] | None, adding: Adding
) -> dict[str, Any]:
    """One object for the page; `advice` None: what to measure next is not known yet."""
    problem = diagnosis.result.problem
    residual = diagnosis.result.residual
    rows = shown_rows(problem.campaign, residual)
    figures = diagnosis.figures()
    lines = list(diagnosis_words(diagnosis, diagnosis.noise, (), adding.command, adding.fitting))
    # what is printed of each cause stands at the cause
    said = lines[: lines.index("")] if "" in lines else lines
    found = {
        "title": verdict_title(diagnosis),
        "verdict": diagnosis.verdict,
        "said": said,
        "causes": [
            _cause(e, diagnosis, figures[f"cause {i}"](), adding)
            for i, e in enumerate(diagnosis.established, start=1)
        ],
        "structure": [
            {
                "said": structure_words(s, diagnosis),
                "figure": figures[f"structure {i}"](),
                "spec": formula(s),
            }
            for i, s in enumerate(diagnosis.structure, start=1)
        ],
        "advice": None if advice is None else [advice_text(a) for a in advice],
        "tested": diagnosis.tests,
        "candidates": [
            {
                "spec": f.candidate.effect.spec,
                "said": headline(f.candidate.effect),
                "evidence": round(f.evidence.value, 1) if np.isfinite(f.evidence.value) else None,
            }
            for f in diagnosis.ranked
        ],
        "figure": figures[CANDIDATES]() if CANDIDATES in figures else None,
        "rows": rows_json(problem.campaign, problem.model.machine, rows),
        "values": values_json(problem.campaign, rows, residual),
        "of": problem.n,
        "panels": panels(problem.campaign, rows, residual),
        **_level(diagnosis),
    }
    answer: dict[str, Any] = plain(found)
    return answer


def _level(diagnosis: Diagnosis) -> dict[str, Any]:
    """RMS and noise floor in the unit in which people are told."""
    unit, _, factor = diagnosis.unit
    level = diagnosis.noise
    floor = level.value("rotation") if diagnosis.of_rotations else None
    if not diagnosis.of_rotations and level.lengths is not None:
        floor = level.lengths.value
    return {
        "unit": unit,
        "rms": diagnosis.rms * factor,
        "floor": None if floor is None else floor * factor,
    }


def _cause(
    established: Established, diagnosis: Diagnosis, figure: Mapping[str, Any], adding: Adding
) -> dict[str, Any]:
    effect = established.effect
    return {
        "spec": effect.spec,
        "said": said_in_the_shop(diagnosis, established),
        "explanation": explained(established, diagnosis),
        "instrument": effect.scope == "instrument",
        "parameters": parameter_rows(diagnosis, established),
        "figure": figure,
        "aliases": in_words(
            [
                [a.found.candidate.effect.spec, headline(a.found.candidate.effect), a.separation]
                for a in established.aliases[:_TABLED]
            ],
            3,
        ),
        "command": adding.command(effect.spec),
    }


def what_if(diagnosis: Diagnosis, spec: str) -> WhatIf:
    """One of the candidates, ready to be tried.

    Raises
    ------
    InputError
        For a cause that was not tested, or of which the campaign shows nothing.
    """
    found = _of_spec(diagnosis, spec)
    pool, basis = diagnosis.pool, diagnosis.basis
    machine = diagnosis.result.problem.model.machine
    variance = max(basis.chi2 - found.screened.drop, 0.0) / max(1, basis.dof - found.screened.rank)
    effect = found.candidate.effect
    return WhatIf(
        effect,
        pool.estimates(basis, found, variance),
        partial(pool.columns, found.key),
        basis,
        diagnosis.result.problem.weight,
        len(effect.linear(machine)),
    )


def _of_spec(diagnosis: Diagnosis, spec: str) -> WeighedCandidate:
    keys = {c.effect.spec: key for key, c in enumerate(diagnosis.pool.candidates)}
    if spec not in keys:
        raise InputError("is none of the causes that were tested", field="cause", found=spec)
    # what was established stands at the best place of its time constants and periods
    for f in [*(e.found for e in diagnosis.established), *diagnosis.ranked]:
        if f.candidate.effect.spec == spec:
            return f
    raise InputError(
        "this campaign shows nothing of it: whatever its values, the model says the same",
        field="cause",
        found=spec,
    )


def tried(
    trial: WhatIf, diagnosis: Diagnosis, values: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """What would be left; `values` in the units that people read, default as they would be fitted.

    Raises
    ------
    InputError
        For a parameter that is missing, unknown, or no number.
    """
    names = [e.name for e in trial.best]
    if values is None:
        inside = {e.name: e.value for e in trial.best}
    else:
        if set(values) != set(names) or not np.isfinite(list(values.values())).all():
            raise InputError("needs a number for each parameter", field="values",
                             found=", ".join(values), expected=", ".join(names))  # fmt: skip
        inside = {e.name: _within(e, values[e.name] / read_in(e)[1], trial)
                  for e in trial.best}  # fmt: skip
    left = trial.left(inside)
    problem = diagnosis.result.problem
    rows = shown_rows(problem.campaign, diagnosis.result.residual)
    chosen = left[np.isin(problem.campaign.kind, measured_kinds(diagnosis.whole))]
    rms = float(np.sqrt(np.nanmean(chosen**2))) * diagnosis.unit[2]
    return {"values": values_json(problem.campaign, rows, left), "rms": round(rms, 4)}


def sliders(trial: WhatIf) -> list[dict[str, Any]]:
    """One slider for each parameter, in the units that people read."""
    return [_slider(e, trial) for e in trial.best]


def _slider(estimate: Estimate, trial: WhatIf) -> dict[str, Any]:
    unit, factor = read_in(estimate)
    low, high = _ends(estimate, trial)
    value = estimate.value * factor
    return {
        "name": estimate.name,
        "unit": unit,
        "what": estimate.description,
        "value": value,
        "low": low * factor,
        "high": high * factor,
        "by_ratio": low > 0.0 and high > _DECADES * low,
        "plausible": [e * factor for e in estimate.range],
        "amount": estimate in trial.best[: trial.linear],
    }


def _ends(estimate: Estimate, trial: WhatIf) -> tuple[float, float]:
    """The least and the greatest value that may be tried."""
    low, high = estimate.range
    if estimate in trial.best[: trial.linear]:
        # the range of any sound machine is wide: near the value of this one it says more
        reach = _REACH * abs(estimate.value) or max(abs(low), abs(high))
        return -reach, reach
    return min(low, estimate.value), max(high, estimate.value)


def _within(estimate: Estimate, value: float, trial: WhatIf) -> float:
    low, high = _ends(estimate, trial)
    return min(max(value, low), high)
