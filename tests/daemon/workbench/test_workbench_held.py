"""What the page *Tables* says of a set: as its record has it, and as its files are."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.errors import AbbeError
from abbe.daemon.config import Configuration, load_config
from abbe.daemon.workbench.tables.held import headline, held
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import SLOW, Place, fill


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Configuration, Path]:
    folder = tmp_path_factory.mktemp("held")
    fill(folder)
    store = {"driver": "modbus", "host": "127.0.0.1", "port": 1}
    Place(folder, SimulatedProcess("controller", "modbus"), store, SLOW).configure(**SLOW)
    return load_config(folder / "mill.toml"), folder / "new"


def test_what_is_drawn_is_what_the_record_says(made: tuple[Configuration, Path]) -> None:
    """The record's figures, worked out again from the files alone."""
    configuration, folder = made
    found = held(configuration, folder)
    left = json.loads((folder / "abbe-tables.json").read_text())["remaining"]
    assert len(found["where"]) == 3
    for figure in found["where"]:
        clouds = {trace["name"]: trace["y"] for trace in figure["data"]}
        for name in ("no compensation", "csv"):
            # some of the points are drawn: none is above the record's largest
            assert 0.8 * left[name]["max"] < max(clouds[name]) <= left[name]["max"] * 1.001
    assert found["where_note"] == ""
    assert "0.064 µm" in found["title"]


def test_without_the_model_it_is_said_that_nothing_is_drawn(
    made: tuple[Configuration, Path], tmp_path: Path
) -> None:
    configuration, folder = made
    path = tmp_path / "abbe-tables.json"
    record = json.loads((folder / "abbe-tables.json").read_text())
    for file in record["files"]:
        (tmp_path / file).write_text((folder / file).read_text())
    record["model"]["sha256"] = "0" * 64
    path.write_text(json.dumps(record))
    found = held(configuration, tmp_path)
    assert found["where"] == []
    assert "is not at hand any more" in found["where_note"]


def damaged(record: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """A record with each of its parts taken out, and with something else in its place."""
    for key in record:
        yield key, {k: v for k, v in record.items() if k != key}
        for wrong in (None, 3, "x", [], {}, {"x": None}):
            yield f"{key}={wrong}", record | {key: wrong}
    for key, part in record.items():
        for inner in part if isinstance(part, dict) else ():
            yield f"{key}.{inner}", record | {key: {k: v for k, v in part.items() if k != inner}}
            for wrong in (None, "x", [], {}):
                yield f"{key}.{inner}={wrong}", record | {key: part | {inner: wrong}}


@pytest.mark.thorough
def test_a_damaged_record_is_one_sentence(made: tuple[Configuration, Path], tmp_path: Path) -> None:
    configuration, folder = made
    record = json.loads((folder / "abbe-tables.json").read_text())
    for file in record["files"]:
        (tmp_path / file).write_text((folder / file).read_text())
    said = []
    for what, wrong in damaged(record):
        (tmp_path / "abbe-tables.json").write_text(json.dumps(wrong))
        try:
            held(configuration, tmp_path)
        except AbbeError as error:
            said.append(f"{what}: {error}")
    assert len(said) > 60
    assert [text for text in said if "abbe-tables.json" not in text and "csv" not in text] == []


def test_the_headline_says_along_what_it_counts() -> None:
    """A SCARA robot: 0.1 of 2.3 µm along Z, where the arm stood 288 µm elsewhere."""
    assert headline("XYZ", 1.3, 10.0) == "With these tables 1.3 µm are left of 10 µm, at most"
    alone = "Along Z alone, with these tables 0.1 µm are left of 2.3 µm, at most"
    assert headline(("Z",), 0.1, 2.3) == alone
    assert headline(("X", "Z"), 0.1, 2.3).startswith("Along X, Z alone")
