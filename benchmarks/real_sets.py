"""Real measurements beside a spreadsheet's linear regression, on the same held-out rows.

``python -m benchmarks.real_sets`` begins every set in tests/data/real with the bare machine, as
``abbe diagnose --apply`` does, and writes the table of docs/validation.md.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from benchmarks.alternatives import spreadsheet
from benchmarks.measuring.report import write_section

ROOT = Path(__file__).parents[1]
REAL = ROOT / "tests" / "data" / "real"
CHECK = "check.csv"


@dataclass(frozen=True)
class Beside:
    """One campaign foretold by both.

    Attributes
    ----------
    name
        Folder and file.
    rows
        How many are judged.
    held_out
        In words: what was not fitted.
    unit
        Of the figures: ``µm`` or ``µrad``.
    nothing, spreadsheet, abbe
        Root mean squares of what is left of the held-out rows.
    effects
        What the model has in the end.
    """

    name: str
    rows: int
    held_out: str
    unit: str
    nothing: float
    spreadsheet: float
    abbe: float
    effects: tuple[str, ...]


def campaigns() -> list[str]:
    """Every campaign of every set that is fitted, as folder and file."""
    files = sorted(REAL.glob("*/*.csv"))
    return [f"{f.parent.name}/{f.name}" for f in files if f.name != CHECK]


def beside(name: str) -> Beside:
    """Begin with the bare machine, and foretell what is held out: another file, or blocks."""
    folder = (REAL / name).parent
    bare = load_model(folder / "model.toml")
    run = read_campaign(REAL / name, bare.machine)
    last = to_the_verdict(bare, run).last
    fitted = last.result.model
    if (folder / CHECK).exists():
        check = read_campaign(folder / CHECK, bare.machine)
        left = [
            compare(bare, check).residual,
            spreadsheet.regressed(run, check),
            compare(fitted, check).residual,
        ]
        return _stated(name, check, "another run or day", left, [e.spec for e in fitted.effects])
    out = last.held_out.left
    left = [run.value, spreadsheet.left_out(run, out.folds), out.residual]
    held = f"{len(out.folds)} blocks, each in its turn"
    return _stated(name, run, held, left, [e.spec for e in fitted.effects])


def _stated(
    name: str, judged: Campaign, held_out: str, left: Sequence[np.ndarray], effects: Sequence[str]
) -> Beside:
    unit = "µrad" if (judged.kind == Kind.ROTATION).all() else "µm"
    factor = 1e6 if unit == "µrad" else 1e3
    nothing, shop, ours = (factor * spreadsheet.rms(part) for part in left)
    return Beside(name, judged.n, held_out, unit, nothing, shop, ours, tuple(effects))


def section(found: Sequence[Beside]) -> str:
    """The table, as Markdown."""
    return "\n".join(_lines(found))


def _lines(found: Sequence[Beside]) -> Iterator[str]:
    yield "### Beside a spreadsheet"
    yield ""
    words = (
        "`python -m benchmarks.real_sets`: the sets that are shipped, each begun with the bare "
        f"machine; RMS of rows that were not fitted. {spreadsheet.SETTINGS}. Of blocks: which "
        "effects are in the model was found on all of them, their values on the others. Another "
        "run or day had no part in either."
    )
    yield textwrap.fill(words, 120, break_on_hyphens=False)
    yield ""
    yield "| campaign | rows | held out | nothing | spreadsheet | Abbe | effects |"
    yield "| --- | ---: | --- | ---: | ---: | ---: | ---: |"
    for one in found:
        figures = " | ".join(map(_figure, (one.nothing, one.spreadsheet, one.abbe)))
        yield (
            f"| {one.name} | {one.rows} | {one.held_out} | {figures} {one.unit} "
            f"| {len(one.effects)} |"
        )


def _figure(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def main() -> None:
    """Run all, print, write the section."""
    found = [beside(name) for name in campaigns()]
    text = section(found)
    print(text)
    write_section("real-sets", text, page=ROOT / "docs" / "validation.md")


if __name__ == "__main__":
    main()
