"""Arguments and options that several commands share, each written once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Force = Annotated[
    bool, typer.Option("--force", help="Overwrite also what is no file of Abbe; never an input.")
]
Renew = Annotated[
    bool,
    typer.Option(
        "--renew",
        help="What the model knew from other campaigns counts, too, but for what has changed.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object.")]
Report = Annotated[
    Path | None, typer.Option("--report", help="A page with pictures.", metavar="FILE.html")
]
PageIn = Annotated[
    str,
    typer.Option("--language", help="Of what is printed, and of the page: en, de.", metavar="CODE"),
]
PrintedIn = Annotated[
    str, typer.Option("--language", help="Of what is printed: en, de.", metavar="CODE")
]
VersionsReport = Annotated[
    Path | None,
    typer.Option(
        "--report", help="A page with the error, version by version.", metavar="FILE.html"
    ),
]

WorkbenchPort = Annotated[
    int, typer.Option(help="Port on 127.0.0.1; 0: any that is free.", max=65_535, min=0)
]
OpenBrowser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser.")]

ConfigFile = Annotated[Path, typer.Argument(help="Configuration file.", metavar="CONFIG.toml")]
ModelFile = Annotated[Path, typer.Argument(help="Model file.", metavar="MODEL.toml")]
CampaignFiles = Annotated[list[Path], typer.Argument(help="Campaigns.", metavar="CAMPAIGN.csv")]
ActiveModel = Annotated[
    Path | None,
    typer.Option(
        "--active", help="Compensation that was active while measuring.", metavar="MODEL.toml"
    ),
]
HoldoutFiles = Annotated[
    list[Path] | None,
    typer.Option("--holdout", help="Campaigns that are not fitted, to see the error fall."),
]

NewModel = Annotated[Path, typer.Option("-o", "--out", help="The model.", metavar="MODEL.toml")]
NextModel = Annotated[
    Path, typer.Option("-o", "--out", help="The next version of the model.", metavar="NEXT.toml")
]
MachineName = Annotated[str, typer.Option("--name", help="The machine's name.")]

Reduced = Annotated[
    bool | None,
    typer.Option("--reduced/--not-reduced", help="Measured lengths are reduced to 20 °C, or not."),
]
Squareness = Annotated[
    list[str] | None,
    typer.Option(
        "--squareness",
        help="Squareness beside the map: YX=0.05mm/m, 50urad, 10arcsec. May be repeated.",
    ),
]
ErrorUnit = Annotated[str | None, typer.Option("--unit", help="Unit of columns of errors.")]
