"""``abbe iso10360``: E0, E150 and R0 of a coordinate measuring machine by ISO 10360-2."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.compcore.artefacts.decision_rule import DecisionRule
from abbe.daemon.arguments.answer_options import AnswerOptions
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.groups import grouped
from abbe.daemon.arguments.options import ErrorUnit, Reduced

if TYPE_CHECKING:
    from abbe.daemon.report.page import Page


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("iso10360")(grouped(iso10360))


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
    *,
    telling: AnswerOptions,
) -> None:
    """Evaluate measured calibrated lengths by ISO 10360-2 against stated limits.

    An example: abbe iso10360 lengths.csv --mpe "1.9+L/300" --mpl-r0 1.5
    """
    from abbe.compcore.artefacts.permissible import PermissibleError
    from abbe.daemon.answers.measurements import iso10360 as answer

    say = telling.checked(files)
    limits = answer.LengthLimits(
        PermissibleError.parse(mpe),
        None if mpe_150 is None else PermissibleError.parse(mpe_150, "mpe-150"),
        None if mpl_r0 is None else mpl_r0 * 1e-3,
        decision,
        coverage,
    )
    found = answer.evaluate(files, limits, reduced=reduced, unit=unit)

    def page() -> Page:
        from abbe.daemon.report.measurements.iso10360 import page

        return page(found)

    telling.tell(say, page, lambda: answer.as_json(found), lambda: answer.as_text(found))
