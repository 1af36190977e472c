"""Sparkplug B at a real Mosquitto, read by a decoder of somebody else's (npm)."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from abbe.daemon.mqtt.sparkplug.node import SparkplugNode
from abbe.daemon.mqtt.spool import Spool
from abbe.daemon.side_process import parent
from tests.daemon.mqtt.test_mqtt_broker import Gate
from tests.daemon.mqtt.test_mqtt_run import section as json_section
from tests.daemon.pipeline.test_live_control import running
from tests.daemon.pipeline.test_pipeline import compensating
from tests.support.daemon.broker import Mosquitto, Subscriber, mosquitto
from tests.support.daemon.sparkplug import Said, decoded, encoded
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

KILLS = 8


def status(moment: float, *, x: float = 1.5, t: float | None = 20.0, **more: Any) -> dict[str, Any]:
    """A run's status, as its JSON gives it; `moment` in s since 1970."""
    axis = {
        "unit": "mm", "indicated": x, "corrected": x + 0.01, "stale": False, "age_s": 0.5,
        "fault": "", "correction": 10.0, "correction_unit": "um", "uncertainty": None,
        "guard": "active", "written": True, "reference": None,
    }  # fmt: skip
    signal_status = {
        "value": t, "unit": "degC", "temperature": True, "stale": t is None, "age_s": 2.0,
        "fault": "", "typed_in": False,
    }  # fmt: skip
    return {
        "abbe": "1", "machine": "mill", "at": datetime.fromtimestamp(moment, UTC).isoformat(),
        "state": "corrected", "in_full": True, "computed_in_full": True, "alive": True,
        "ending": False, "writes": True, "status_word": {"word": 7, "bits": []}, "faults": {},
        "beyond": [], "axes": {"X": axis}, "signals": {"T": signal_status},
        "links": {"plc": {"state": "up", "failures": 0, "reconnects": 0}},
        "cycle": {"median_ms": 0.25, "p99_ms": 0.5, "missed": 0}, "owner": {"host": "pc"},
        "event_counts": {}, "switches": {"scale": "on"}, "tool_mm": [0.0, 0.0, -150.0],
        "checks": None,
    } | more  # fmt: skip


def event(text: str, moment: float = 1e9) -> dict[str, Any]:
    at = datetime.fromtimestamp(moment, UTC).isoformat()
    return {"at": at, "level": "WARNING", "part": "abbe.test", "text": text}


class Publishing:
    """An edge node at work, its spool, and what it said."""

    def __init__(self, folder: Path, port: int, **keys: Any) -> None:
        self.said: list[tuple[int, str]] = []
        self.spool = Spool(folder / "mqtt.sqlite", 50_000_000, lambda t: self.said.append((30, t)))
        task = {
            "host": "127.0.0.1", "port": port, "tls": False, "group": "Plant 2",
            "node": "abbe-mill", "device": "mill", "primary_host": None, "client_id": "abbe-mill",
            "user": None, "version": "5", "timeout": 60.0, "reconnect_min": 0.01,
            "reconnect_max": 0.04,
        } | keys  # fmt: skip
        self.node = SparkplugNode(task, self.spool, {}, lambda *s: self.said.append(s))

    @asynccontextmanager
    async def at_work(self) -> AsyncIterator[Publishing]:
        task = asyncio.create_task(self.node.run())
        try:
            yield self
        finally:
            self.node.end()
            await asyncio.wait({task}, timeout=60.0)
            task.cancel()
            await asyncio.wait({task})
            self.spool.close()


def kinds(heard: Subscriber) -> list[str]:
    return [topic.split("/")[2] for topic, _, _ in heard.heard if "/STATE/" not in topic]


def told(messages: list[Said]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every metric of data, by the name that the last birth gave to its alias."""
    names: dict[int, str] = {}
    for said in messages:
        if said.kind == "NBIRTH":
            names = {}
        if said.kind in ("NBIRTH", "DBIRTH"):
            names |= {m["alias"]: m["name"] for m in said.metrics if "alias" in m}
        elif said.kind.endswith("DATA"):
            for metric in said.metrics:
                assert "name" not in metric
                yield names[metric["alias"]], metric


def check_order(messages: list[Said]) -> None:
    """Births, numbers and deaths are as the specification has them."""
    number = birth = None
    for said in messages:
        assert not said.retained
        if said.kind == "NDEATH":
            # a death is that of the birth before, and the number that counts data is not in it
            assert [m["name"] for m in said.metrics] == ["bdSeq"]
            assert "seq" not in said.payload or said.payload["seq"] == 0
            if birth is not None:
                assert said.metrics[0]["value"] == birth
            number = birth = None
            continue
        if said.kind == "NBIRTH":
            number = -1
            birth = said.values["bdSeq"]
            assert said.values["Node Control/Rebirth"] is False
        assert number is not None, "data before a birth"
        number = (number + 1) % 256
        assert said.payload["seq"] == number, said


async def test_birth_data_and_death(tmp_path: Path) -> None:
    heard = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with heard.listening(broker):
            publishing = Publishing(tmp_path, broker.port)
            async with publishing.at_work():
                publishing.node.put_event(event("before the first status"))
                publishing.node.put_status(status(1e9), 0)
                await until(lambda: kinds(heard)[-2:] == ["NDATA", "DDATA"])
                at_birth = len(heard.heard)
                publishing.node.put_status(status(1e9 + 5), 0)
                publishing.node.put_status(status(1e9 + 10, x=2.5, t=None), 3)
                publishing.node.put_event(event("µ \ud800", 1e9 + 11))
                await until(lambda: len(heard.heard) >= at_birth + 3)
            await until(lambda: kinds(heard)[-1] == "NDEATH")
    messages = decoded(heard.heard)
    check_order(messages)
    topics = {said.kind: said.topic for said in messages}
    assert topics["NBIRTH"] == "spBv1.0/Plant 2/NBIRTH/abbe-mill"
    assert topics["DDATA"] == "spBv1.0/Plant 2/DDATA/abbe-mill/mill"
    born = messages[0].values | messages[1].values
    assert [said.kind for said in messages[:2]] == ["NBIRTH", "DBIRTH"]
    assert (born["bdSeq"], born["Axes/X/Indicated"], born["Axes/X/Corrected"]) == (0, 1.5, 1.51)
    assert (born["State/In Full"], born["State/Status Word"]) == (True, 7)
    assert (born["Compensations/scale"], born["Tool/Z"]) == ("on", -150.0)
    (x,) = [m for m in messages[1].metrics if m["name"] == "Axes/X/Indicated"]
    assert x["properties"]["engUnit"]["value"] == "mm"
    assert x["timestamp"] == 1_000_000_000_000 - 500
    # only what has changed is said again, as what is so now
    later = list(told(messages))[len(list(told(messages[:at_birth]))) :]
    assert {name for name, _ in later} == {
        "Axes/X/Indicated", "Axes/X/Corrected", "Signals/T", "Publishing/Lost",
        "Events/Text", "Events/Level", "Events/Part", "Events/Number",
    }  # fmt: skip
    values = dict(later)
    assert not any(metric.get("isHistorical") for metric in values.values())
    assert values["Axes/X/Indicated"]["value"] == 2.5
    assert values["Signals/T"]["value"] is None
    assert values["Signals/T"]["properties"]["Quality"]["value"] == 0
    assert values["Events/Text"]["value"] == "µ ?"
    # what was said before anybody could be told comes, and as something of before
    first = [m for name, m in told(messages[:at_birth]) if name == "Events/Text"]
    assert [(m["value"], m["isHistorical"]) for m in first] == [("before the first status", True)]


@pytest.mark.thorough
async def test_nothing_is_lost_though_no_broker_acknowledges_data(tmp_path: Path) -> None:
    """A broker killed again and again: each event comes, each connection has its own births."""
    heard = Subscriber()
    sent = 0
    with mosquitto(tmp_path) as broker:
        async with Gate(broker).standing() as gate:
            gate.open = False
            publishing = Publishing(tmp_path, gate.port, timeout=5.0)

            def put(count: int) -> None:
                nonlocal sent
                for _ in range(count):
                    sent += 1
                    publishing.node.put_event(event(f"{sent}", 1e9 + sent))
                    publishing.node.put_status(status(1e9 + sent, x=float(sent)), 0)

            async with publishing.at_work():
                for _ in range(KILLS):
                    said = len(heard.heard)
                    # who subscribes later has missed what the broker took: that is MQTT's
                    async with heard.listening(broker):
                        gate.open = True
                        put(25)
                        await until(lambda said=said: len(heard.heard) > said + 10)
                        gate.open = False
                        broker.kill()
                        await asyncio.sleep(0)
                        gate.cut()
                        put(5)
                        await until(heard.deaf.is_set)
                    broker.begin()
                async with heard.listening(broker):
                    gate.open = True
                    await until(lambda: not publishing.spool.oldest(1) and gate.connections)
                await asyncio.sleep(0)
    messages = decoded(heard.heard)
    births = [said.values["bdSeq"] for said in messages if said.kind == "NBIRTH"]
    assert len(births) > KILLS
    # attempts that came to nothing have their number, too
    assert all(one < two for one, two in pairwise(births))
    check_order(messages)
    metrics = list(told(messages))
    texts = [m["value"] for name, m in metrics if name == "Events/Text"]
    assert list(dict.fromkeys(texts)) == [str(n) for n in range(1, sent + 1)]
    # what comes a second time was not known to have come: it is of before
    seen = set()
    for name, metric in metrics:
        if name == "Events/Number":
            if metric["value"] in seen:
                assert metric["isHistorical"]
            seen.add(metric["value"])
    assert publishing.spool.lost == 0


async def test_a_rebirth_is_asked_for(tmp_path: Path) -> None:
    """By another's command: the connection's number, everything anew; nothing else is heard."""
    heard = Subscriber()
    ask = {"name": "Node Control/Rebirth", "type": "Boolean", "value": True}
    rebirth = encoded({"timestamp": 1, "metrics": [ask]})
    refused = encoded({"timestamp": 1, "metrics": [{**ask, "value": False}]})
    strange = encoded({"timestamp": 1, "metrics": [{**ask, "name": "Node Control/Reboot"}]})
    with mosquitto(tmp_path) as broker:
        async with heard.listening(broker):
            publishing = Publishing(tmp_path, broker.port)
            async with publishing.at_work():
                publishing.node.put_status(status(1e9), 0)
                await until(lambda: kinds(heard)[-1:] == ["DDATA"])
                async with aiomqtt.Client("127.0.0.1", broker.port) as host:
                    command = "spBv1.0/Plant 2/NCMD/abbe-mill"
                    for body in (b"", b"\xff" * 99, bytes(200_000), refused, strange, rebirth):
                        await host.publish(command, body, qos=1)
                    await until(lambda: kinds(heard).count("DBIRTH") == 2)
                    publishing.node.put_status(status(1e9 + 1, x=9.0), 0)
                    await until(lambda: kinds(heard)[-1] == "DDATA")
                    for _ in range(300):
                        await host.publish(command, rebirth, qos=0)
                    publishing.node.put_event(event("in spite of a flood"))
                    await until(lambda: not publishing.spool.oldest(1))
                    # a metric that no birth has named asks for one by itself
                    both = {"plc": {"state": "up", "failures": 0, "reconnects": 0}}
                    new = status(1e9 + 2, links=both | {"new": both["plc"]})
                    publishing.node.put_status(new, 0)
                    await until(lambda: not publishing.node._reborn)
                    await until(lambda: not publishing.spool.oldest(1))
            await until(lambda: kinds(heard)[-1] == "NDEATH")
    messages = decoded([h for h in heard.heard if "/NCMD/" not in h[0]])
    check_order(messages)
    births = [said for said in messages if said.kind == "NBIRTH"]
    assert {said.values["bdSeq"] for said in births} == {0}
    assert "Links/new/State" in births[-1].values
    second = [said for said in messages if said.kind == "DBIRTH"][1]
    assert second.values["Axes/X/Indicated"] == 1.5
    strangers = [text for _, text in publishing.said if "is not heard" in text]
    assert len(strangers) == 1


async def test_the_primary_host_is_waited_for(tmp_path: Path) -> None:
    heard = Subscriber()
    topic = "spBv1.0/STATE/scada"

    def state(online: bool, at: int) -> bytes:
        return json.dumps({"online": online, "timestamp": at}).encode()

    with mosquitto(tmp_path) as broker:
        async with (
            heard.listening(broker),
            aiomqtt.Client("127.0.0.1", broker.port) as host,
        ):
            publishing = Publishing(tmp_path, broker.port, primary_host="scada")
            async with publishing.at_work():
                publishing.node.put_status(status(1e9), 0)
                await until(lambda: publishing.said)
                for body in (b"ONLINE", b"[" * 900, b'{"online": 1, "timestamp": 1}'):
                    await host.publish(topic, body, qos=1, retain=True)
                await host.publish("spBv1.0/STATE/another", state(True, 1), qos=1, retain=True)
                await asyncio.sleep(0.1)
                assert "NBIRTH" not in kinds(heard)
                await host.publish(topic, state(True, 1000), qos=1, retain=True)
                await until(lambda: kinds(heard)[-1:] == ["DDATA"])
                # of before: it says nothing any more
                await host.publish(topic, state(False, 999), qos=1)
                publishing.node.put_event(event("one"))
                await until(lambda: not publishing.spool.oldest(1))
                await host.publish(topic, state(False, 1001), qos=1, retain=True)
                await until(lambda: kinds(heard)[-1] == "NDEATH")
                publishing.node.put_event(event("two"))
                await until(lambda: publishing.node.connections > 1)
                assert publishing.spool.oldest(1)
                await host.publish(topic, state(True, 1002), qos=1, retain=True)
                await until(lambda: not publishing.spool.oldest(1))
            await until(lambda: kinds(heard)[-1] == "NDEATH")
    messages = decoded(heard.heard)
    check_order(messages)
    births = [said.values["bdSeq"] for said in messages if said.kind == "NBIRTH"]
    assert births == [0, 1]
    events = {
        m["value"]: bool(m.get("isHistorical")) for n, m in told(messages) if n == "Events/Text"
    }
    assert events == {"one": False, "two": True}


@pytest.mark.parametrize("version", ["5", "3.1.1"])
async def test_the_broker_says_that_it_died(tmp_path: Path, version: str) -> None:
    """And the number of a connection goes on over a restart, by the file of what waits."""
    heard = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with Gate(broker).standing() as gate, heard.listening(broker):
            for _ in range(2):
                await lived(Publishing(tmp_path, gate.port, version=version), gate, heard)
            await until(lambda: kinds(heard).count("NDEATH") == 4)
    messages = decoded(heard.heard)
    lives = [
        (said.kind, next(m["value"] for m in said.metrics if m["name"] == "bdSeq"))
        for said in messages
        if said.kind in ("NBIRTH", "NDEATH")
    ]
    assert lives == [(kind, n) for n in range(4) for kind in ("NBIRTH", "NDEATH")]
    check_order(messages)


async def lived(publishing: Publishing, gate: Gate, heard: Subscriber) -> None:
    """Born, cut off, born again."""
    async with publishing.at_work():
        publishing.node.put_status(status(1e9), 0)
        await until(lambda: not publishing.spool.oldest(1))
        born = kinds(heard).count("NBIRTH")
        gate.cut()
        await until(lambda: kinds(heard).count("NBIRTH") > born)
        await until(lambda: not publishing.spool.oldest(1))


async def test_a_run_publishes_and_its_process_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parent, "_FIRST_DELAY", 0.1)
    started: list[int] = []
    real = asyncio.create_subprocess_exec

    async def noted(*arguments: object, **options: object) -> asyncio.subprocess.Process:
        process = await real(*arguments, **options)  # type: ignore[arg-type]
        started.append(process.pid)
        return process

    monkeypatch.setattr(asyncio, "create_subprocess_exec", noted)
    heard = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with heard.listening(broker):
            text = section(broker)
            async with running(tmp_path, None, text) as run:
                await run.until(compensating)
                await until(lambda: "DDATA" in kinds(heard))
                os.kill(started[-1], signal.SIGKILL)
                await until(lambda: kinds(heard).count("NBIRTH") == 2)
                logging.getLogger("abbe.test").warning("after it")
                await until(lambda: b"after it" in b"".join(body for _, body, _ in heard.heard))
            await until(lambda: kinds(heard).count("NDEATH") == 2)
    messages = decoded(heard.heard)
    check_order(messages)
    births = [said.values["bdSeq"] for said in messages if said.kind == "NBIRTH"]
    assert births == [0, 1]
    device = next(said for said in messages if said.kind == "DBIRTH")
    machine = run.service.configuration.model.machine.name
    assert device.topic == f"spBv1.0/plant/DBIRTH/abbe-{machine}/{machine}"
    assert device.values.keys() >= {"Axes/X/Corrected", "Axes/Z/Correction", "State/In Full"}
    dead = [said for said in messages if said.kind == "NDEATH"]
    assert [said.metrics[0]["value"] for said in dead] == [0, 1]


def section(broker: Mosquitto) -> str:
    text = json_section(broker.port, 'format = "sparkplug"\ngroup = "plant"\n')
    return text.replace('topic = "plant/{machine}"\n', "")
