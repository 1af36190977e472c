"""Abbe: how a machine errs, learned from measurements, laid beside others, and taken away.

The whole loop, in the order in which it is walked::

    import abbe

    model = abbe.load_model("machine.toml")                     # structure, sensors, effects
    campaign = abbe.read_campaigns(["day1.csv"], model)
    print(abbe.noise_floor(campaign, model))                    # what no model can beat

    result = abbe.fit(model, campaign)                          # every parameter ± its uncertainty
    print(result.report())
    result.plot()                                               # pictures of `abbe fit --report`

    check = abbe.read_campaigns(["day2.csv"], model)            # measurements that were not fitted
    abbe.compare(result.model, check).lengths.rms               # mm

    found = abbe.diagnose(result.model, campaign)               # which physical cause is missing
    better = abbe.add_effect(model, found.established[0].effect)
    abbe.save_model(abbe.fit(better, campaign).model, "better.toml")

    where = abbe.Conditions.at({"X": x, "Y": 0.0, "Z": -100.0}, signals={"T_x": 21.5})
    error = result.model.predict(where).translation             # (n, 3) mm, actual − indicated
    sd, _ = abbe.prediction_sd(result.model, where)

    live = abbe.Compensator(result.model)                       # microseconds a point
    control = abbe.make_controller("csv", model)                # or as the controller's own tables
    tables = abbe.project_tables(result.model, control.capability, signals={"T_x": 20.0})

Lengths are mm, angles rad, temperatures °C, time s; error = actual − indicated. A name is imported
when it is first used; what is not exported here stands in the rooms of `abbe.compcore`,
`abbe.drivers` and `abbe.daemon`. `docs/python.md` walks the loop on a machine of the repository.
"""

from __future__ import annotations

from importlib import import_module

# not from typing, which takes as long to import as all else before a command catches Ctrl-C
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from abbe.compcore.campaign.campaign import Campaign, Kind
    from abbe.compcore.campaign.noise import NoiseFloor, noise_floor
    from abbe.compcore.comparison.compare import Comparison, compare
    from abbe.compcore.compensator.compensator import Compensator
    from abbe.compcore.diagnosis import advise
    from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose
    from abbe.compcore.effects.base import Effect
    from abbe.compcore.effects.registry import effect_kinds, make_effect
    from abbe.compcore.errors import AbbeError, FitError, InputError
    from abbe.compcore.files.campaign_file import read_campaigns, write_campaign
    from abbe.compcore.files.map_file import load_map
    from abbe.compcore.files.model_file import load_model, save_model
    from abbe.compcore.files.model_toml.fit_record import recorded
    from abbe.compcore.files.switched_points import read_switched
    from abbe.compcore.fitting.design.superposition import uncompensated
    from abbe.compcore.fitting.fit import FitResult, fit
    from abbe.compcore.fitting.frame import ReferenceFrame
    from abbe.compcore.iso230.evaluate import Iso230, evaluate_iso230
    from abbe.compcore.machine.conditions import Conditions
    from abbe.compcore.machine.machine import Axis, Machine, Signal
    from abbe.compcore.machine.structure import Structure
    from abbe.compcore.maps.convention import Convention
    from abbe.compcore.maps.conventions.identify import identify
    from abbe.compcore.maps.conventions.subject import MapSubject, ModelSubject
    from abbe.compcore.maps.to_model import import_map
    from abbe.compcore.model.error_map import error_map
    from abbe.compcore.model.model import Model, Term, Value
    from abbe.compcore.model.motion_curves import motion_curves
    from abbe.compcore.model.revise import add_effect, remove_effect
    from abbe.compcore.model.sensitivity import prediction_sd
    from abbe.compcore.tables.of_model import project_tables
    from abbe.drivers.controllers import controller_kinds, make_controller

_ROOMS = {
    "abbe.compcore.campaign.campaign": ("Campaign", "Kind"),
    "abbe.compcore.campaign.noise": ("NoiseFloor", "noise_floor"),
    "abbe.compcore.comparison.compare": ("Comparison", "compare"),
    "abbe.compcore.compensator.compensator": ("Compensator",),
    "abbe.compcore.diagnosis": ("advise",),
    "abbe.compcore.diagnosis.verdict": ("Diagnosis", "diagnose"),
    "abbe.compcore.effects.base": ("Effect",),
    "abbe.compcore.effects.registry": ("effect_kinds", "make_effect"),
    "abbe.compcore.errors": ("AbbeError", "FitError", "InputError"),
    "abbe.compcore.files.campaign_file": ("read_campaigns", "write_campaign"),
    "abbe.compcore.files.model_toml.fit_record": ("recorded",),
    "abbe.compcore.files.map_file": ("load_map",),
    "abbe.compcore.files.model_file": ("load_model", "save_model"),
    "abbe.compcore.fitting.design.superposition": ("uncompensated",),
    "abbe.compcore.fitting.fit": ("FitResult", "fit"),
    "abbe.compcore.fitting.frame": ("ReferenceFrame",),
    "abbe.compcore.iso230.evaluate": ("Iso230", "evaluate_iso230"),
    "abbe.compcore.machine.conditions": ("Conditions",),
    "abbe.compcore.machine.machine": ("Axis", "Machine", "Signal"),
    "abbe.compcore.machine.structure": ("Structure",),
    "abbe.compcore.maps.convention": ("Convention",),
    "abbe.compcore.maps.conventions.identify": ("identify",),
    "abbe.compcore.maps.conventions.subject": ("MapSubject", "ModelSubject"),
    "abbe.compcore.files.switched_points": ("read_switched",),
    "abbe.compcore.maps.to_model": ("import_map",),
    "abbe.compcore.model.error_map": ("error_map",),
    "abbe.compcore.model.model": ("Model", "Term", "Value"),
    "abbe.compcore.model.motion_curves": ("motion_curves",),
    "abbe.compcore.model.revise": ("add_effect", "remove_effect"),
    "abbe.compcore.model.sensitivity": ("prediction_sd",),
    "abbe.compcore.tables.of_model": ("project_tables",),
    "abbe.drivers.controllers": ("controller_kinds", "make_controller"),
}
"""Where each exported name stands; the same as the imports above, which only type checkers run."""

_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "AbbeError",
    "Axis",
    "Campaign",
    "Comparison",
    "Compensator",
    "Conditions",
    "Convention",
    "Diagnosis",
    "Effect",
    "FitError",
    "FitResult",
    "InputError",
    "Iso230",
    "Kind",
    "Machine",
    "MapSubject",
    "Model",
    "ModelSubject",
    "NoiseFloor",
    "ReferenceFrame",
    "Signal",
    "Structure",
    "Term",
    "Value",
    "add_effect",
    "advise",
    "compare",
    "controller_kinds",
    "diagnose",
    "effect_kinds",
    "error_map",
    "evaluate_iso230",
    "fit",
    "identify",
    "import_map",
    "load_map",
    "load_model",
    "make_controller",
    "make_effect",
    "motion_curves",
    "noise_floor",
    "prediction_sd",
    "project_tables",
    "read_campaigns",
    "read_switched",
    "recorded",
    "remove_effect",
    "save_model",
    "uncompensated",
    "write_campaign",
]


def __getattr__(name: str) -> Any:
    """An exported name, imported from its room at its first use."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
