"""docs/decisions: one record a number, and the number in its heading."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

RECORDS = sorted((Path(__file__).parents[2] / "docs" / "decisions").glob("*.md"))


def test_a_number_stands_for_one_record() -> None:
    assert len(RECORDS) > 20
    counts = Counter(path.name[:4] for path in RECORDS)
    assert [number for number, count in counts.items() if count > 1] == []


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.name)
def test_the_heading_has_the_number_of_the_file(path: Path) -> None:
    name = re.fullmatch(r"(\d{4})-[a-z0-9-]+\.md", path.name)
    heading = re.match(r"# (\d+)\. \S", path.read_text("utf-8"))
    assert name, path.name
    assert heading, path.name
    assert int(name[1]) == int(heading[1])
