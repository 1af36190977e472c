"""A run that uploads: what arrives in a real PostgreSQL, and that no outage touches a cycle."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from abbe.daemon.fleet.store.roles import add_machine
from tests.daemon.mqtt.test_mqtt_run import mostly_in_full
from tests.daemon.pipeline.test_live_control import running
from tests.daemon.pipeline.test_pipeline import compensating
from tests.support.daemon.plant_store import store
from tests.support.daemon.postgres import PostgreSQL
from tests.support.drivers.opening import until

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]


@pytest.mark.thorough
@pytest.mark.timeout(300)
async def test_what_a_run_uploads_and_a_store_that_is_killed(
    server: PostgreSQL, tmp_path: Path
) -> None:
    with store(server, "run") as admin:
        add_machine(admin, "Bridge 1", "Plant 2", "bridge", "bridge_1", "")
        section = (
            "\n[records]\nevery = 0.1\n\n[fleet]\n"
            f'url = "postgresql://127.0.0.1:{server.port}/run"\nsite = "Plant 2"\n'
            'machine = "Bridge 1"\nuser = "bridge_1"\nevery = 1.0\nspan = 60\n'
            "reconnect_min = 0.1\nreconnect_max = 0.5\ntimeout = 5.0\n"
        )
        async with running(tmp_path, None, section) as run:
            await run.until(compensating)

            def status() -> bool:
                row = admin.execute(
                    "SELECT status->>'in_full' FROM abbe.machines WHERE name = 'Bridge 1' "
                    "AND seen > now() - interval '1 minute' AND model <> ''"
                ).fetchone()
                return row == ("true",)

            await until(status)
            logging.getLogger("abbe.test").warning("before")
            count = "SELECT count(*) FROM abbe.events WHERE message = %s"
            await until(lambda: admin.execute(count, ("before",)).fetchone() == (1,))
            server.kill()
            killed = len(run.records)
            logging.getLogger("abbe.test").warning("while it was away")
            await until(lambda: len(run.records) > killed + 100)
            server.begin()
            with server.connected(database="run") as again:
                asked = ("while it was away",)
                await until(lambda: again.execute(count, asked).fetchone() == (1,))
            assert mostly_in_full(run.records[killed:])
