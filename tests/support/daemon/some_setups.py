"""A part of a campaign: fewer set-ups, for tests that need no more."""

from __future__ import annotations

from pathlib import Path


def some_setups(campaign: Path, out: Path, *, every: int) -> Path:
    """A campaign with every so-manieth of its set-ups, and all rows of the master points."""
    lines = campaign.read_text(encoding="utf-8").splitlines()
    head = next(i for i, text in enumerate(lines) if not text.startswith("#"))
    column = lines[head].split(",").index("setup")
    names = list(dict.fromkeys(row.split(",")[column] for row in lines[head + 1 :]))
    kept = {n for i, n in enumerate(names) if i % every == 0 or n.startswith("master")}
    rows = [row for row in lines[head + 1 :] if row.split(",")[column] in kept]
    listed: list[str] = []
    skipped = False
    for text in lines[:head]:
        if text.startswith("# ["):
            name = text.removeprefix("# [setups.").removesuffix("]")
            skipped = text.startswith("# [setups.") and name not in kept
        if not skipped:
            listed.append(text)
    out.write_text("\n".join([*listed, lines[head], *rows]) + "\n", encoding="utf-8")
    return out
