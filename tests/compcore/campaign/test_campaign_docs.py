"""What docs/campaigns.md says of the format is what the reader does."""

import re
from pathlib import Path

import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.files.campaign_csv.columns import RESERVED
from abbe.compcore.files.importers.lines.iso230_table import import_iso230_table
from tests.support.compcore.campaign_texts import read_text

PAGE = (Path(__file__).parents[3] / "docs" / "campaigns.md").read_text(encoding="utf-8")


def test_the_example_is_read(tmp_path):
    example = PAGE.split("```\n")[1]
    campaign = read_text(tmp_path, example)
    assert campaign.n == 5
    assert set(campaign.kind) == {Kind.DISPLACEMENT, Kind.ROTATION, Kind.DISTANCE}
    assert campaign.tools["T1"].free == ("z",)


@pytest.mark.parametrize(
    "word",
    [*sorted(RESERVED), *(k.name.lower() for k in Kind), "zero", "slope", "frame", "X_dir", "(C)"],
)
def test_every_word_of_the_format_is_explained(word):
    assert f"`{word}`" in PAGE or f"`{word}` `" in PAGE


def test_the_layouts_of_tables_are_read(tmp_path):
    block = next(b for b in re.findall(r"```\n(.*?)```", PAGE, re.S) if "target,1+" in b)
    starts = [m.start() for m in re.finditer(r"\S+", block.splitlines()[0])]
    for i, start in enumerate(starts):
        end = starts[i + 1] if i + 1 < len(starts) else None
        lines = [line[start:end].strip() for line in block.splitlines()[:3]]
        path = tmp_path / f"{i}.csv"
        path.write_text("\n".join(lines) + "\n")
        assert import_iso230_table(path, "X").n >= 2
