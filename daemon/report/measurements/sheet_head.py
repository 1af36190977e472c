"""The head of a page about tables whose tops state conditions: ``# operator = …``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.campaign.measuring_conditions import stated
from abbe.compcore.files.importers.sheets.words import read_sheet
from abbe.daemon.report.head import PageHead, facts_of, file_on_page


def sheet_head(part: str, paths: Sequence[str | Path]) -> PageHead:
    """What the tables' tops say of date, machine, operator and so on, and the tables themselves."""
    conditions = [stated(read_sheet(Path(path)).comments) for path in paths]
    return PageHead(facts_of(conditions), [file_on_page(part, path) for path in paths])
