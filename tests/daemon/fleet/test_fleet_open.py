"""``abbe fleet open`` as it is typed: of which store it is, and nothing of a temporary folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.daemon.plant_store import MachineRecords, store
from tests.support.daemon.postgres import PostgreSQL
from tests.support.daemon.workbench import opened
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


async def test_a_machine_of_the_store_is_looked_at_here(server: PostgreSQL, tmp_path: Path) -> None:
    records = MachineRecords(tmp_path / "mill")
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
