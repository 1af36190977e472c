"""``abbe diagnose``, ``fit`` and ``compare`` as typed: seconds and memory, by the number of rows.

``python -m benchmarks.diagnosis_command`` writes the section of docs/performance.md; ``--fast``
takes the small campaigns only and writes nothing.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from benchmarks.hidden.campaigns.campaign import draw, model_text, simulate
from benchmarks.hidden.causes.catalogued import catalogue
from benchmarks.measuring.report import machine, write_section
from benchmarks.measuring.used import Used
from benchmarks.screening import count

ROWS = (2_117, 4_335, 10_000, 80_000, 1_000_000)
LINES = 1_896
"""Rows of the day's lines, the rest are visits to the master point."""
TARGETS = {2_117: "2 s, 300 MB", 4_335: "4 s, 500 MB", 80_000: "60 s, 2 GB"}
ROOM = 4e9
"""The other's matrix may take so many bytes; with its copies it takes three times that."""
COMMANDS = {
    "diagnose": ("diagnose", "model.toml", "campaign.csv"),
    "fit": ("fit", "model.toml", "campaign.csv", "-o", "fitted.toml"),
    "compare": ("compare", "fitted.toml", "campaign.csv"),
}
TURNS = 3


def written(folder: Path, rows: int) -> int:
    """Write a model and a day's campaign of about so many rows; returns how many they are."""
    drawn = draw(1, "bridge")
    causes = catalogue(drawn.axes, drawn.travels, np.random.default_rng(0))
    hidden = [(causes[name], causes[name].size) for name in ("backlash", "thermal_tilt")]
    text = simulate(drawn, 1, hidden, dense=max(1, round(rows / LINES))).text
    (folder / "campaign.csv").write_text(text, encoding="utf-8")
    (folder / "model.toml").write_text(model_text(drawn), encoding="utf-8")
    return sum(not line.startswith("#") for line in text.splitlines()) - 1


def pursued(folder: Path) -> None:
    """What one would do without Abbe's diagnosis: scikit-learn's orthogonal matching pursuit.

    Over the candidates' columns with what the model imitates taken out, both given.
    """
    from sklearn.linear_model import OrthogonalMatchingPursuit

    model = load_model(folder / "model.toml")
    result = fit(model, read_campaign(folder / "campaign.csv", model.machine))
    tried = candidates(model, result.problem.campaign)
    columns = np.empty((result.problem.n, count(tried, model)), order="F")
    at = 0
    for c in tried:
        for nonlinear in c.choices:
            own = result.residualise(result.effect_columns(c.effect, nonlinear))
            columns[:, at : at + own.shape[1]] = own
            at += own.shape[1]
    size = np.linalg.norm(columns, axis=0)
    columns /= np.where(size > 1e-6 * size.max(), size, np.inf)
    OrthogonalMatchingPursuit(n_nonzero_coefs=4).fit(columns, result.weighted)


def other(folder: Path, rows: int) -> tuple[Used | None, float]:
    """The pursuit as a script of its own; and the bytes of its matrix."""
    model = load_model(folder / "model.toml")
    tried = candidates(model, read_campaign(folder / "campaign.csv", model.machine))
    size = 8.0 * rows * count(tried, model)
    if size > ROOM:
        return None, size
    script = f"from pathlib import Path; from benchmarks.{Path(__file__).stem} import pursued; "
    script += f"pursued(Path({str(folder)!r}))"
    return Used.by(sys.executable, "-c", script, folder=Path(__file__).parents[1]), size


def row(rows: int) -> tuple[str, int]:
    """One row of the table, and the number of rows of its campaign."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        n = written(folder, rows)
        turns = TURNS if n < 50_000 else 1
        abbe = (sys.executable, "-m", "abbe.daemon")
        used = {k: Used.least(turns, *abbe, *words, folder=folder) for k, words in COMMANDS.items()}
        their, size = other(folder, n)
        cells = [f"{u.wall:.1f} | {u.cpu:.1f} | {u.memory:.0f}" for u in used.values()]
        if their is None:
            cells.append(f"– | needs {size / 1e9:.0f} GB | –")
        else:
            ratio = used["diagnose"].cpu / their.cpu
            cells.append(f"{their.cpu:.1f} | {their.memory:.0f} | **{ratio:.2f}**")
    return f"| {n:,} | {' | '.join(cells)} | {TARGETS.get(rows, '')} |", n


HEAD = (
    "| rows | diagnose, s | CPU s | MB | fit, s | CPU s | MB | compare, s | CPU s | MB "
    "| pursuit, CPU s | MB | ratio | target |\n|" + " ---: |" * 14
)

TEXT = f"""## The commands as typed

`benchmarks/diagnosis_command.py`: `abbe diagnose`, `abbe fit` and `abbe compare`, from the start of
the process to its end, reading and imports included: a bridge CMM measured through a day (as
under *Every candidate tested*; two causes hidden; lines with more and more points), least of
{TURNS} turns where there are fewer than 50,000 rows; Python keeps its compiled files, as it does
for a user. *CPU s*: user and system time of the process with the threads that it sets itself; other
programs shared the two cores, which stretches the time on the clock, and by less the processor's.
*Pursuit*: a script that reads the same files, fits, computes and projects all candidates' columns
with Abbe's functions and gives them to scikit-learn's `OrthogonalMatchingPursuit` for four columns;
it knows neither groups of columns nor descriptions, aliases, cross-validation or what to measure
next. *Ratio*: CPU s of `abbe diagnose` to the script's.

Of a campaign of more than 10,000 rows `diagnose` tells causes apart on 8,000, evenly from every
set-up, and measures what it found on all: time then grows with reading and fitting only."""


def main() -> None:
    """Measure and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fast", action="store_true")
    options = parser.parse_args()
    rows = []
    loads = [os.getloadavg()[0]]
    for wanted in ROWS[:2] if options.fast else ROWS:
        text, _ = row(wanted)
        rows.append(text)
        loads.append(os.getloadavg()[0])
        print(text, flush=True)
    if not options.fast:
        parts = [
            TEXT,
            "\n".join([HEAD, *rows]),
            f"{machine()}; load of the host {min(loads):.1f} to {max(loads):.1f}.",
        ]
        write_section("commands", "\n\n".join(parts))


if __name__ == "__main__":
    main()
