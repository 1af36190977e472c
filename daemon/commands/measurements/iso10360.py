"""``abbe iso10360``: E0, E150 and R0 of a coordinate measuring machine by ISO 10360-2."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.artefacts.decision_rule import DecisionRule
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson, ErrorUnit, Force, Reduced, Report


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("iso10360")(iso10360)


def iso10360(
    files: Annotated[
        list[Path], typer.Argument(help="Measured lengths, CSV.", metavar="LENGTHS.csv")
    ],
    mpe: Annotated[
        str,
        typer.Option(
            help='Limit of E0, µm with L in mm: "1.9+L/300", "min(1.9+3L/1000, 5)".',
            metavar="A+L/K",
        ),
    ],
    mpe_150: Annotated[
        str | None, typer.Option("--mpe-150", help="Limit of E150.", metavar="A+L/K")
    ] = None,
    mpl_r0: Annotated[
        float | None,
        typer.Option(
            "--mpl-r0", callback=within(1e-3, 1e4, "µm"), help="Limit of the repeatability R0, µm."
        ),
    ] = None,
    decision: Annotated[
        DecisionRule,
        typer.Option(help="How uncertainty enters: not, to prove conformity, to disprove it."),
    ] = DecisionRule.SIMPLE,
    coverage: Annotated[
        float,
        typer.Option(
            callback=within(1.0, 4.0, ""), help="Factor k of the uncertainty; ISO 14253-1: 1.65."
        ),
    ] = 2.0,
    reduced: Reduced = None,
    unit: ErrorUnit = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Evaluate measured calibrated lengths by ISO 10360-2 against stated limits.

    An example: abbe iso10360 lengths.csv --mpe "1.9+L/300" --mpl-r0 1.5
    """
    from abbe.compcore.artefacts.permissible import PermissibleError
    from abbe.daemon.answers.measurements import iso10360 as answer
    from abbe.daemon.outputs import REPORT, check_outputs

    say = check_outputs(files, [(report, REPORT)], force=force, as_json=as_json)
    limits = answer.LengthLimits(
        PermissibleError.parse(mpe),
        None if mpe_150 is None else PermissibleError.parse(mpe_150, "mpe-150"),
        None if mpl_r0 is None else mpl_r0 * 1e-3,
        decision,
        coverage,
    )
    found = answer.evaluate(files, limits, reduced=reduced, unit=unit)
    if report is not None:
        from abbe.daemon.report.measurements.iso10360 import page

        page(found).write(report)
    if as_json:
        say(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        say(line)
    if report is not None:
        say(f"written: {report}")
