"""The page on safety names tests that there are, and every promise names one."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")


def test_every_test_that_is_named_is_there() -> None:
    named = set(re.findall(r"`(tests/[\w/.]+)`", PAGE))
    assert len(named) > 15
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_every_promise_is_held_by_a_test() -> None:
    rows = [line for line in PAGE.splitlines() if re.match(r"\| \d+ \|", line)]
    assert len(rows) >= 20
    assert [row for row in rows if "`tests/" not in row] == []


def test_hazards_refer_to_promises_that_there_are() -> None:
    known = set(re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE))
    for row in re.findall(r"^\|.*\| [ABC] \| (.*?) \|", PAGE, re.MULTILINE):
        for number in re.findall(r"(?<![\d.])\b(\d{1,2})\b(?![\d.])", row):
            assert number in known, row
