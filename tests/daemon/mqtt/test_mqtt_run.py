"""A run that publishes: what is heard at a real Mosquitto, and that no outage touches a cycle."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.side_process import parent
from tests.daemon.pipeline.test_live_control import running
from tests.daemon.pipeline.test_pipeline import compensating
from tests.support.daemon.broker import Subscriber, mosquitto
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

ROOT = Path(__file__).parents[3]


def section(port: int, more: str = "") -> str:
    return (
        f'\n[mqtt]\nurl = "mqtt://127.0.0.1:{port}"\ntopic = "plant/{{machine}}"\nevery = 0.5\n'
        f"reconnect_min = 0.1\nreconnect_max = 0.5\ntimeout = 2.0\n{more}"
    )


def mostly_in_full(records: list[CycleRecord]) -> bool:
    """A busy computer may hold the correction for a moment; a broker may not."""
    return sum(map(compensating, records)) > 0.9 * len(records) > 20


async def test_what_a_run_publishes_and_its_process_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(parent, "_FIRST_DELAY", 0.1)
    started: list[int] = []
    real = asyncio.create_subprocess_exec

    async def noted(*arguments: object, **options: object) -> asyncio.subprocess.Process:
        process = await real(*arguments, **options)  # type: ignore[arg-type]
        started.append(process.pid)
        return process

    monkeypatch.setattr(asyncio, "create_subprocess_exec", noted)
    caplog.set_level(logging.INFO, "abbe")
    strange = logging.makeLogRecord(
        {"name": "abbe.test", "levelno": 30, "levelname": "WARNING", "msg": "a\x00 \ud800 µ"}
    )
    heard = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with heard.listening(broker):
            async with running(tmp_path, None, section(broker.port)) as run:
                await run.until(compensating)
                await until(lambda: any(s["in_full"] for s in heard.bodies("/state")))
                for handler in logging.getLogger("abbe").handlers:
                    # not by the logger: pytest-xdist cannot hand on what is no UTF-8
                    handler.handle(strange)
                await until(lambda: any("µ" in e["text"] for e in heard.bodies("/events")))
                status = run.service
                axes = heard.bodies("/corrections")[-1]["axes"]
                assert set(axes) == set(status.pipeline.axes)
                record = run.records[-1]
                for name, value in zip(DIRECTIONS, record.decision.correction, strict=True):
                    assert axes[name]["correction"] == pytest.approx(1e3 * value, abs=0.1)
                signals = heard.bodies("/temperatures")[-1]["signals"]
                assert {s["unit"] for s in signals.values() if s["temperature"]} == {"degC"}
                health = heard.bodies("/health")[-1]
                assert health["links"]["cmm"]["state"] == "up"
                assert health["mqtt"] == {"lost": 0, "refused": 0}
                count = len(run.records)
                os.kill(started[-1], signal.SIGKILL)
                # the broker says that nobody is there, then there is somebody again
                lives = [True, False, True]
                await until(lambda: [x["online"] for x in heard.bodies("/online")] == lives)
                await until(lambda: len({e["series"] for e in heard.bodies("/state")}) == 2)
                assert mostly_in_full(run.records[count:])
            await until(lambda: len(heard.bodies("/online")) == 4)
    topics = {topic.rpartition("/")[0] for topic, _, _ in heard.heard}
    assert topics == {f"plant/{run.service.configuration.model.machine.name}"}
    assert heard.bodies("/online")[-1]["online"] is False
    # at least once: what was on its way when the process was killed comes again, as it was
    said_twice: dict[tuple[str, int], set[bytes]] = {}
    for topic, data, _ in heard.heard:
        if not topic.endswith("/online"):
            body = json.loads(data)
            said_twice.setdefault((body["series"], body["id"]), set()).add(data)
    assert {len(bodies) for bodies in said_twice.values()} == {1}
    said = [r.getMessage() for r in caplog.records if r.name == "abbe.mqtt"]
    assert sum("connected to" in text for text in said) == 2
    with pytest.raises(ProcessLookupError):
        os.kill(started[-1], 0)


async def test_no_outage_touches_a_cycle(tmp_path: Path) -> None:
    """Nobody there, a broker that hangs, one that comes back: all in full, and all of it comes."""
    heard = Subscriber()
    with mosquitto(tmp_path, keeps=True) as broker:
        # what comes before it hears again is kept for it
        async with heard.listening(broker, stays=True):
            pass
        broker.end()
        async with running(tmp_path, None, section(broker.port)) as run:
            await run.until(compensating)
            first = len(run.records)
            logging.getLogger("abbe.test").warning("nobody was there")
            await until(lambda: len(run.records) > first + 100)
            broker.begin()
            async with heard.listening(broker, stays=True):
                await until(lambda: heard.bodies("/state"))
                broker.freeze(frozen=True)
                logging.getLogger("abbe.test").warning("it hung")
                frozen = len(run.records)
                await until(lambda: len(run.records) > frozen + 200)
                broker.freeze(frozen=False)
                await until(lambda: any("it hung" in e["text"] for e in heard.bodies("/events")))
            meanwhile = run.records[first:]
            assert mostly_in_full(meanwhile)
    texts = [event["text"] for event in heard.bodies("/events")]
    assert texts.index("nobody was there") < texts.index("it hung")


def test_nothing_of_it_is_there_for_those_who_do_not_ask(tmp_path: Path) -> None:
    code = (
        "import asyncio, sys\nfrom pathlib import Path\n"
        "from tests.daemon.pipeline.test_live_control import running\n"
        "from tests.daemon.pipeline.test_pipeline import compensating\n"
        "async def run():\n"
        "    async with running(Path(sys.argv[1])) as found:\n"
        "        await found.until(compensating)\n"
        "asyncio.run(run())\n"
        "there = {m.partition('.')[0] for m in sys.modules}\n"
        "print(sorted(there & {'aiomqtt', 'paho', 'asyncua', 'google'}))\n"
        "ours = ('abbe.daemon.mqtt', 'abbe.drivers.opcua')\n"
        "print([m for m in sys.modules if m.startswith(ours)])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["[]", "[]"], done.stderr
