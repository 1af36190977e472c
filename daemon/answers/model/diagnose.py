"""The answer of ``abbe diagnose``: as JSON (formats.md); lengths in µm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.campaign.suspicions import of_campaign, of_signals, of_values
from abbe.compcore.comparison.compare import Comparison
from abbe.compcore.diagnosis.explain import description, explanation, formula
from abbe.compcore.diagnosis.findings import Established
from abbe.compcore.diagnosis.judging.aliases import Alias
from abbe.compcore.diagnosis.next_measurement.measure_next import Advice
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.diagnosis.words import noise_of
from abbe.compcore.model.model import Value
from abbe.daemon.answers import as_built
from abbe.daemon.answers.model.fit import finite


def as_json(
    diagnosis: Diagnosis, noise: NoiseFloor, advice: Sequence[Advice], given: Comparison
) -> dict[str, Any]:
    """One object for ``--json``; `given` is the model as it was given beside the same campaign."""
    floor = noise_of(diagnosis, noise)
    _, unit, factor = diagnosis.unit
    return {
        "verdict": diagnosis.verdict,
        "unit": unit,
        "as_given": _as_given(diagnosis, given),
        "rms": finite(diagnosis.rms, factor),
        "noise_floor": None if floor is None else floor * factor,
        "changed": _changed(diagnosis),
        "chi2_per_dof": finite(diagnosis.whole.chi2_per_dof),
        "chi2_per_dof_after": finite(diagnosis.left),
        "tested": diagnosis.tests,
        "rows": diagnosis.whole.problem.n,
        "rows_tested": diagnosis.result.problem.n,
        "clock": diagnosis.whole.problem.campaign.clocked,
        "candidates": [_candidate(e, diagnosis) for e in diagnosis.established]
        + [c for s in diagnosis.structure if (c := _empirical(s, diagnosis)) is not None],
        "structure": [
            {
                "depends_on": list(s.depends_on),
                "form": description(s),
                "strength": round(s.drop / diagnosis.basis.chi2, 4),
                "channel": str(s.pattern.error_motion),
                "p_value": s.evidence.p_value,
            }
            for s in diagnosis.structure
        ],
        "strays": [
            {
                "file": s.file,
                "line": s.line,
                "setup": s.setup,
                "unit": "urad" if s.rotation else "um",
                "off": finite(s.off, 1e6 if s.rotation else 1e3),
                "size": finite(s.size),
            }
            for s in diagnosis.strays
        ],
        "measure_next": [
            {
                "what": a.what,
                "cause": a.cause,
                "separates": a.separates,
                "separation": finite(a.separation),
                "separation_now": finite(a.separation_now),
                "uncertainty_falls_by": finite(a.uncertainty_falls_by),
            }
            for a in advice
        ],
    }


def _as_given(diagnosis: Diagnosis, given: Comparison) -> dict[str, Any]:
    """The model with the values that it came with: nothing fitted but the instruments' placing."""
    part = given.rotations if diagnosis.of_rotations else given.lengths
    problem = given.problem
    mistaken, said = [m.words for m in diagnosis.mistakes], {m.text for m in diagnosis.mistakes}
    suspicions = (
        # a model that was never fitted need not agree
        [
            *of_campaign(problem.campaign, problem.model.machine),
            *of_values(problem.campaign, given.measured),
            *of_signals(problem.campaign, problem.model.machine, problem.model.measured_signals),
        ]
        if diagnosis.standing is None
        else [*diagnosis.standing.suspicions, *given.suspicions]
    )
    return {
        "rms": finite(part.rms, diagnosis.unit[2]),
        "chi2_per_dof": finite(part.chi2_per_dof),
        "suspicions": list(dict.fromkeys([*mistaken, *(s for s in suspicions if s not in said)])),
    }


def _changed(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The effects of the given model that no longer hold."""
    if diagnosis.standing is None:
        return []
    return [
        {
            "kind": change.effect.kind,
            "where": change.effect.where(),
            "spec": change.effect.spec,
            "since": diagnosis.standing.since,
            "evidence": finite(change.evidence),
            "p_value": change.p_value,
            "confusable_with": list(change.aliases),
            "parameters": {
                p.name: {"was": p.before, "is": p.after, "by": p.by, "sd": p.sd, "unit": p.unit}
                for p in change.parameters
            },
        }
        for change in diagnosis.standing.changes
    ]


def _candidate(established: Established, diagnosis: Diagnosis) -> dict[str, Any]:
    effect = established.found.candidate.effect
    return {
        "kind": effect.kind,
        "where": effect.where(),
        "spec": effect.spec,
        "scope": effect.scope,
        "rms_after": finite(established.rms_after, diagnosis.unit[2]),
        "p_value": established.found.evidence.p_value,
        "cross_validated_gain": finite(established.cross_validated_gain),
        "evidence": finite(established.found.evidence.value),
        "parameters": {
            e.name: {"value": e.value, "sd": e.sd, "unit": e.unit, "plausible": e.plausible}
            for e in established.estimates
        },
        "on_the_table": as_built.seen_json(
            diagnosis.result.problem.model.machine,
            effect,
            {e.name: Value(e.value, e.sd, e.measured) for e in established.estimates},
        ),
        "confusable_with": [_alias(a) for a in established.aliases],
        "explanation": explanation(established, diagnosis),
    }


def _alias(alias: Alias) -> dict[str, Any]:
    effect = alias.found.candidate.effect
    return {
        "kind": effect.kind,
        "where": effect.where(),
        "spec": effect.spec,
        "scope": effect.scope,
        "separation": finite(alias.separation),
        "cosine": finite(alias.cosine),
    }


def _empirical(structure: ResidualPattern, diagnosis: Diagnosis) -> dict[str, Any] | None:
    """A pattern that a short formula says, as a candidate marked as empirical."""
    spec = formula(structure)
    if spec is None:
        return None
    n = diagnosis.result.problem.n
    rest = max(0.0, diagnosis.basis.chi2 - structure.drop)
    scaled = diagnosis.rms * math.sqrt(rest / diagnosis.basis.chi2)
    terms = ",".join(t.replace(" ", "") for t in structure.pattern.terms)
    return {
        "kind": "formula",
        "where": {"channel": str(structure.pattern.error_motion), "terms": terms.split(",")},
        "spec": spec,
        "scope": "machine",
        "empirical": True,
        "rms_after": finite(scaled, diagnosis.unit[2]),
        "p_value": structure.evidence.p_value,
        "cross_validated_gain": finite(structure.drop / diagnosis.basis.chi2 - 1.0 / n),
        "evidence": finite(structure.evidence.value),
        "parameters": {},
        "confusable_with": [],
        "explanation": (
            f"Empirical: {description(structure)}. It describes what is left over and names no "
            "cause; find the physics behind it before you trust it outside this campaign."
        ),
    }
