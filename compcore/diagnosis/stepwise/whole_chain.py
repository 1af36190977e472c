"""Where all joints of an arm lie, and how they sag, at once: before what imitates it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.judging.second_order import beyond_first_order
from abbe.compcore.diagnosis.screening.candidates import PLAIN
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel
from abbe.compcore.diagnosis.stepwise.whole_body import worth_it
from abbe.compcore.diagnosis.uncatalogued.chosen import grown
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.effects import RotaryLocation
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.gravity import GravityFlexure
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.revise import identity

_JOINTS = 3
"""Rotary axes, one carried by the other, that make an arm."""


def whole_chain(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add where all joints of an arm lie, and how the tool sits on it, if worth it.

    Every joint lies a little elsewhere than it was drawn, leans, and counts from elsewhere: the
    geometric parameters of every text on the calibration of robots. Taken one by one, the first
    ones say what others should have said, and are held there by what came after: a wobble of the
    wrist, a weight. All are fitted at once, composed in full where errors no longer add up; then
    those go without which left-out blocks are foretold as well.

    Parameters
    ----------
    growing
        The model; where every place is in it nothing is done.
    diagnosis
        What it lacks.

    Returns
    -------
    Whether they were added.
    """
    model = growing.last.result.model
    if not growing.bodies or not _is_arm(model.machine):
        return False
    known = {identity(e) for e in model.effects}
    missing: dict[object, Effect] = {}
    for effect in (f.candidate.effect for f in diagnosis.ranked):
        if effect.kind in PLAIN and identity(effect) not in known:
            missing.setdefault(identity(effect), effect)
    places = list(missing.values())
    moved = [e for e in places if isinstance(e, RotaryLocation)]
    if len(moved) < _JOINTS or not growing.once(places):
        return False
    growing.progress("where all joints lie")
    whole = grown(model, places)[-1][0]
    try:
        result = fit(whole, growing.campaign, near=True)
    except FitError:
        return False
    if beyond_first_order(result.thin, result.chi2 / max(1, result.dof)):
        full = fit(replace(model, composition="exact"), growing.campaign, near=True)
        growing.make("composed", None, full, LeftOutErrors.of(full))
        whole = replace(whole, composition="exact")
    if growing.better(whole, places, 1.0 - WORTH) is None:
        return False
    more = grown(growing.last.result.model, worth_it(growing, growing.last.result.model, places))
    found = growing.better(more[-1][0], [one for _, one in more], 1.0 - WORTH)
    if found is None:
        return False
    growing.make_together("added with the others", "added with the others", more, *found)
    return True


def whole_weight(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add how all joints of an arm that are parallel sag and weigh on each other, if worth it.

    Where one of them sags under what it carries, so do the others, and the outer ones twist the
    inner ones. Taken alone, a sag leaves what waves of the other joints' positions say as well.

    Parameters
    ----------
    growing
        The model, of which one sag was added.
    diagnosis
        What it lacks.

    Returns
    -------
    Whether they were added.
    """
    machine = growing.last.result.model.machine
    sagging = [e for e in growing.added if isinstance(e, GravityFlexure) and e.gravity is None]
    if not sagging or not _is_arm(machine):
        return False
    known = {identity(e) for e in growing.last.result.model.effects}
    alike = {
        a
        for a in machine.structure.tool_side
        for e in sagging
        if np.linalg.norm(np.cross(machine.axis(a).direction, machine.axis(e.axis).direction)) < 0.1
    }
    weights = [
        e
        for e in (f.candidate.effect for f in diagnosis.ranked)
        if isinstance(e, GravityFlexure)
        and e.gravity is None
        and e.axis in alike
        and (e.by is None or e.by in alike)
        and identity(e) not in known
    ]
    return len(weights) > 1 and growing.add_once_together(weights, 1.0 - WORTH)


def _is_arm(machine: Machine) -> bool:
    """Whether joints carry joints that carry the tool."""
    side = machine.structure.tool_side
    return sum(machine.axis(a).rotary for a in side) >= _JOINTS
