"""``abbe history``: the versions of a model, and how its error fell."""

from __future__ import annotations

import json
from typing import Any

import typer

from abbe.daemon.arguments.options import AsJson, Force, ModelFile, Report


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("history")(history)


def history(
    model: ModelFile,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Show the error falling version by version, down to the noise floor, and the effects now."""
    from abbe.compcore.files.model_file import load_model
    from abbe.daemon.answers.typed import fitting
    from abbe.daemon.outputs import REPORT, check_outputs
    from abbe.daemon.report.model.history import history_page, versions_of

    say = check_outputs([model], [(report, REPORT)], force=force, as_json=as_json)
    loaded = load_model(model)
    versions = versions_of(loaded)
    effects = [t.effect.spec for t in loaded.terms]
    if report is not None:
        history_page(loaded, versions, model).write(report)
    if as_json:
        say(
            json.dumps({"unit": "um", "versions": versions, "effects": effects}, ensure_ascii=False)
        )
        return
    if not versions:
        say(f"not fitted yet: {fitting(model)}")
    largest = max((float(v["rms"]) for v in versions if "rms" in v), default=0.0)
    for i, version in enumerate(versions, start=1):
        say(_line(i, version, largest))
    say("effects:")
    for term in loaded.terms:
        say(f"  {term.effect.spec}" + ("" if term.fitted else "  (not fitted)"))
    if report is not None:
        say(f"written: {report}")


def _line(number: int, version: dict[str, Any], largest: float) -> str:
    what = f"+ {version['added']}" if "added" in version else ""
    what = f"− {version['removed']}" if "removed" in version else what
    if "rms" not in version:
        return f"{number:3}  {version.get('date', ''):25} not refitted  {what}"
    rms = float(version["rms"])
    bar = "█" * max(1, round(30 * rms / largest)) if largest > 0.0 else ""
    floor = f", noise floor {version['noise_floor']:.2f}" if "noise_floor" in version else ""
    held = f", held out {version['holdout_rms']:.2f}" if "holdout_rms" in version else ""
    return (
        f"{number:3}  {version.get('date', ''):25} {rms:7.3f} µm rms{floor}{held}  {bar:30}  {what}"
    )
