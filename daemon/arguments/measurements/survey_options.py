"""Options of the commands that plan measurements, each written once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within

Instruments = Annotated[
    str | None, typer.Option(help="Instruments at hand: laser,ball-bar,…; all: every one.")
]
TimeThere = Annotated[str, typer.Option(help="Time there is: 4h, 90min.")]
PlanOut = Annotated[Path | None, typer.Option("-o", "--out", help="The plan.", metavar="PLAN.toml")]
Tools = Annotated[
    list[str] | None,
    typer.Option(help="A tool's offset, mm; may be repeated.", metavar="NAME=x,y,z"),
]
KeepOutBoxes = Annotated[
    list[str] | None,
    typer.Option(help="A box the tool must not enter, mm; may be repeated.", metavar="x,y,z:x,y,z"),
]
AlongAxes = Annotated[
    bool,
    typer.Option(
        "--along-axes",
        help="Only set-ups in which one axis moves, as the files of "
        "instruments that are not linked have them.",
    ),
]
ToolRadius = Annotated[
    float, typer.Option(callback=within(0.0, 1000.0, "mm"), help="Tool with its holder, mm.")
]
TableRadius = Annotated[
    float,
    typer.Option(
        callback=within(0.0, 10_000.0, "mm"),
        help="Rotary table with what is on it lower than a touched sphere, mm; --tool-radius is "
        "then that of the spindle.",
    ),
]
PlateAtHand = Annotated[
    Path | None,
    typer.Option(
        help="The ball plate at hand, which the machine touches itself: ball,cx,cy,cz.",
        metavar="PLATE.csv",
    ),
]
GaugeAtHand = Annotated[
    Path | None,
    typer.Option(
        help="The gauge block or step gauge at hand, which the machine touches itself: face,at.",
        metavar="GAUGE.csv",
    ),
]
