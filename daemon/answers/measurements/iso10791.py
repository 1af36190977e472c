"""The answer of ``abbe iso10791`` as JSON and as text: lengths µm, angles µrad."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.files.importers.rotary.rotary_test import RotaryTestOptions
from abbe.compcore.files.importers.rotary.rtest import import_rtest
from abbe.compcore.files.recognised import CAMPAIGN, recognised
from abbe.compcore.iso10791.error_motions import AngleCurve
from abbe.compcore.iso10791.evaluate import (
    RotaryAxisResult,
    RotaryEvaluation,
    evaluate_rotary,
)
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.model.as_built import ON_THE_TABLE
from abbe.compcore.units import in_digits
from abbe.daemon.answers.as_built import line_json, spindle_json

WAYS = {0: "", 1: "↑", -1: "↓"}
"""The way in which angles were approached, as a sign behind an error motion's name."""


@dataclass(frozen=True, eq=False)
class RotaryAnswer:
    """The evaluation of one or more files."""

    files: tuple[str, ...]
    campaign: Campaign
    evaluation: RotaryEvaluation


def evaluate(
    machine: Machine,
    paths: Sequence[Path],
    placing: ForeignPlacing | None = None,
    options: RotaryTestOptions | None = None,
) -> RotaryAnswer:
    """Read tests of rotary axes (campaigns, or what `import_rtest` takes) and evaluate them.

    Raises
    ------
    InputError
        For a bad file, and when no rotary axis turned in it.
    """
    campaigns = [
        read_campaign(path, machine)
        if recognised(path) is CAMPAIGN
        else import_rtest(path, machine, placing, options)
        for path in paths
    ]
    campaign = join_campaigns(campaigns)
    try:
        evaluation = evaluate_rotary(machine, campaign)
    except InputError as error:
        raise error.at(file=paths[0]) from None
    return RotaryAnswer(tuple(map(str, paths)), campaign, evaluation)


def as_json(answer: RotaryAnswer) -> dict[str, Any]:
    """One object for ``--json``; what is not known is null."""
    evaluation = answer.evaluation
    result = evaluation.result
    return {
        "files": list(answer.files),
        "n": result.problem.n,
        "left": evaluation.left * 1e3,
        "unit": "um",
        "axes": [_axis(found) for found in evaluation.axes],
        "rotary_axes": [line_json(found.line) for found in evaluation.axes],
        "spindle": spindle_json(evaluation.spindle),
        "only_together": [
            {"parameters": list(t.names), "text": t.words()} for t in evaluation.together
        ],
        "undetermined": [u.text for u in result.undetermined if not u.convention],
    }


def _axis(found: RotaryAxisResult) -> dict[str, Any]:
    opposite = found.side == "workpiece"
    location = {}
    for name, value in found.location.items():
        unit, factor = ("um", 1e3) if name[2] in "XYZ" else ("urad", 1e6)
        location[name] = {
            "value": value.value * factor,
            "sd": None if value.sd is None else value.sd * factor,
            "unit": unit,
            "on_the_table": -value.value * factor if opposite else None,
        }
    return {
        "axis": found.axis,
        "side": found.side,
        "location": location,
        "readings": [
            {
                "setup": r.setup,
                "direction": r.direction,
                "unit": "um",
                "range": r.range * 1e3,
                "low": r.low * 1e3,
                "high": r.high * 1e3,
            }
            for r in found.ranges
        ],
        "error_motions": [_curve(c, opposite=opposite) for c in found.motions],
    }


def shown(curve: AngleCurve) -> tuple[str, float]:
    """Unit and factor of an error motion, for people."""
    return ("µrad", 1e6) if curve.motion.rotation else ("µm", 1e3)


def _curve(curve: AngleCurve, *, opposite: bool) -> dict[str, Any]:
    unit, factor = shown(curve)
    return {
        "motion": str(curve.motion),
        "unit": unit.replace("µ", "u"),
        "at_sphere": curve.at_sphere,
        "way": curve.way,
        "range": curve.range * factor,
        "angle": [float(a) for a in curve.angle * 57.29577951308232],
        "value": [float(v) for v in curve.value * factor],
        "on_the_table": [float(-v) for v in curve.value * factor] if opposite else None,
    }


def location_lines(found: RotaryAxisResult) -> Iterator[str]:
    """``E_X0C = +10.0 ± 0.1 µm (on the table itself −10.0)``, without the zero angle."""
    own = own_component(found.axis)
    for name, value in found.location.items():
        if name[2] == own:
            continue  # where the sphere is left free, where the axis stands at 0 is free too
        unit, factor = ("µm", 1e3) if name[2] in "XYZ" else ("µrad", 1e6)
        text = f"{name} = {value.value * factor:+.2f}"
        text += "" if value.sd is None else f" ± {in_digits(value.sd * factor, 2)}"
        text += f" {unit}"
        if found.side == "workpiece":
            text += f" (on the table itself {-value.value * factor:+.2f})"
        yield text


def as_text(answer: RotaryAnswer) -> Iterator[str]:
    """Lines for people."""
    evaluation = answer.evaluation
    result = evaluation.result
    spheres = len(answer.campaign.setups)
    yield (
        f"Rotary axes, ISO 10791-6: {result.problem.n} readings at {spheres} "
        f"sphere{'s' * (spheres > 1)}; {in_digits(evaluation.left * 1e3, 2)} µm rms left"
    )
    for found in evaluation.axes:
        yield f"{found.axis}, on the {found.side}'s side of the bed"
        for r in found.ranges:
            yield (
                f"  read {r.direction:<10} {r.range * 1e3:>8.2f} µm "
                f"({r.low * 1e3:+.2f} … {r.high * 1e3:+.2f}), {r.setup}"
            )
        for line in location_lines(found):
            yield f"  {line}"
        for words in found.line.words():
            yield f"  {words}"
        if found.motions:
            yield f"  error motions left, greatest less least{_where(found)}"
            parts = []
            for curve in found.motions:
                unit, factor = shown(curve)
                name = f"{curve.motion}{WAYS[curve.way]}"
                parts.append(f"{name} {curve.range * factor:.2f} {unit}")
            yield "    " + ", ".join(parts)
    if any(found.side == "workpiece" for found in evaluation.axes):
        yield ON_THE_TABLE
    if evaluation.spindle is not None:
        yield "the spindle in the head"
        for words in evaluation.spindle.words():
            yield f"  {words}"
    for sums in evaluation.together:
        if sums.matters:
            yield f"ONLY TOGETHER: {sums.words()}"
    for u in result.undetermined:
        if not u.convention:
            yield f"NOT DETERMINED: {u.text}"
    yield (
        "entered in the controller, a place is no error any more; X, Y, Z err in these readings too"
    )


def _where(found: RotaryAxisResult) -> str:
    if any(c.at_sphere for c in found.motions):
        return " (of the sphere: one sphere does not tell tilts from radial and axial motion)"
    return ""
