"""``abbe uncertainty``: how sure a part program's results are, on a machine known so well."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.answer_options import AnswerOptions
from abbe.daemon.arguments.groups import grouped
from abbe.daemon.arguments.options import ModelFile
from abbe.daemon.arguments.spread.options import SpreadOptions

if TYPE_CHECKING:
    from abbe.daemon.report.page import Page


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("uncertainty")(grouped(uncertainty))


def uncertainty(
    model: ModelFile,
    part: Annotated[
        Path,
        typer.Argument(help="Part program: TOML, or a CSV of points.", metavar="PART.toml|csv"),
    ],
    draws: Annotated[
        int, typer.Option(help="Virtual measurements.", min=1000, max=10_000_000)
    ] = 10_000,
    seed: Annotated[int, typer.Option(help="The same gives the same draws.", min=0)] = 1,
    instruments: Annotated[
        str,
        typer.Option(
            help="At hand, to say which measurement would lower it; `all`, `none` or as for plan."
        ),
    ] = "laser,straightness,angle,level,ball-bar,step-gauge,ball-plate",
    *,
    spreading: SpreadOptions,
    telling: AnswerOptions,
) -> None:
    """Say how sure a part program's results are: a virtual CMM, task by task.

    The model's parameters are drawn from their covariance, with temperatures, probe and part; every
    draw measures the part, and the features are evaluated. ISO/TS 15530-4 in spirit.

    An example: abbe uncertainty model.toml part.toml --report part.html
    """
    from abbe.compcore.planning.instruments import instruments_called
    from abbe.compcore.virtual_cmm.simulation import BLOCK
    from abbe.daemon.answers.uncertainty import answer

    say = telling.checked([model, part])
    names = [] if instruments == "none" else [w.strip() for w in instruments.split(",")]
    at_hand = instruments_called(names)
    place = spreading.place(-(-draws // BLOCK))
    measurement = answer.require_possible(model, part)
    found = answer.evaluate(measurement, (model, part), draws, seed, place, at_hand)

    def page() -> Page:
        from abbe.daemon.report.measurements.uncertainty import page

        return page(found, model, part)

    telling.tell(say, page, lambda: answer.as_json(found), lambda: answer.as_text(found))
