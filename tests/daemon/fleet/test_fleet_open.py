"""``abbe fleet open`` as it is typed: of which store it is, and nothing of a temporary folder."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.daemon.plant_store import CAMPAIGN, MachineRecords, settle, store
from tests.support.daemon.postgres import PostgreSQL
from tests.support.daemon.workbench import opened
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


def _rows() -> Iterator[str]:
    """Two runs along X that grow by 10 µm per m, read to 0.3 µm."""
    chance = random.Random(17)
    for i, x in enumerate([*range(0, 801, 50), *range(800, -1, -50)]):
        value = 0.01 * x + chance.gauss(0.0, 0.3)
        yield f"{i}.0,a,displacement,{x},0,0,1,0,0,{value:.2f}\n"


@pytest.mark.thorough
async def test_a_machine_of_the_store_is_looked_at_here(server: PostgreSQL, tmp_path: Path) -> None:
    records = MachineRecords(tmp_path / "mill")
    campaign = records.folder / "campaigns" / "x.csv"
    campaign.write_text(CAMPAIGN.partition("0.0,a,")[0] + "".join(_rows()), "utf-8")
    settle(campaign)
    with store(server, "looked_at"):
        records.uploader(server.port, "looked_at").once()
        url = f"postgresql://admin@127.0.0.1:{server.port}/looked_at"
        with opened("Mill 7", "--store", url, by="fleet open") as bench:
            bench.enter()
            state = bench.json("/api/state")
            assert state["views"] == ["compare", "learn", "watch"]
            assert state["first"] == "compare"
            assert state["take_out"] == "abbe fleet files 'Mill 7' --site 'Plant 2' -o FOLDER"
            head = bench.json("/api/head")
            place = "looked_at at 127.0.0.1: Plant 2, Mill 7"
            assert ["Plant's store", place] in head["facts"]
            assert [row[1] for row in head["files"]] == ["machine.toml", "x.csv"]
            await until(lambda: bench.json("/api/state")["compared"])
            bench.json("/api/learn", {})
            await until(lambda: bench.json("/api/state")["learned"])
            learned = json.dumps(bench.json("/api/learn"))
            assert "abbe add machine.toml" in learned
            assert "abbe-fleet-" not in learned
