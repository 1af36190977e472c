"""A run looked at over HTTP, by real clients over real sockets: it says what is."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import os
import signal
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import httpx
import pytest
from prometheus_client.openmetrics import parser as openmetrics
from prometheus_client.parser import text_string_to_metric_families

from abbe.daemon.guard import GuardState
from abbe.daemon.http.cycles.cycle_event import StreamedCycle
from abbe.daemon.http.exchange.packing import CyclePacker
from abbe.daemon.side_process import parent
from abbe.daemon.status.run_status import AxisStatus, RunStatus
from abbe.daemon.status.status_source import StatusSource
from abbe.drivers.link import LinkDownError, LinkState
from tests.daemon.pipeline.test_pipeline import EXAMPLE, SENSORS, compensating
from tests.support.daemon.observed import Observed, events, observed, until

pytestmark = pytest.mark.integration


async def status_of(client: httpx.AsyncClient) -> RunStatus:
    answer = await client.get("/api/v1/status")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/json"
    return RunStatus.model_validate_json(answer.content)


async def says(client: httpx.AsyncClient, state: str) -> RunStatus:
    """The status that says so: what is shown lies a moment behind the cycle."""

    async def is_said() -> bool:
        return (await status_of(client)).state == state

    await until(is_said)
    return await status_of(client)


async def lights(client: httpx.AsyncClient) -> tuple[int, int]:
    return (await client.get("/healthz")).status_code, (await client.get("/readyz")).status_code


async def shown(client: httpx.AsyncClient, wanted: tuple[int, int]) -> None:
    async def are_so() -> bool:
        return await lights(client) == wanted

    await until(are_so)


def resident() -> float:
    """Memory of this process, bytes."""
    pages = Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]
    return float(pages) * os.sysconf("SC_PAGE_SIZE")


@contextmanager
def down(found: Observed) -> Iterator[None]:
    link, values = found.run.link, dict(found.run.link.values)
    link.values.update(dict.fromkeys(values))
    link.write_error = LinkDownError("not written: cmm is down")
    link.status.become(LinkState.DOWN, "the cable was pulled")
    yield
    link.values.update(values)
    link.write_error = None
    link.status.become(LinkState.UP)


async def test_what_is_said_is_what_is(tmp_path: Path) -> None:
    async with observed(tmp_path) as found, found.client() as client:
        full = await found.run.until(compensating)
        await says(client, "corrected in full")
        assert await lights(client) == (200, 200)
        axes = {n: AxisStatus(**a) for n, a in (await client.get("/api/v1/axes")).json().items()}
        assert axes["X"].indicated == pytest.approx(350.0)
        assert axes["X"].correction == pytest.approx(1e3 * full.decision.correction[0], abs=0.05)
        assert set((await client.get("/api/v1/signals")).json()) == set(SENSORS)
        assert (await client.get("/api/v1/links")).json()["cmm"]["state"] == "up"
        assert (await client.get("/api/v1/faults")).json() == {}
        schema = (await client.get("/api/openapi.json")).json()
        text = json.dumps(schema, ensure_ascii=False)
        assert schema["openapi"].startswith("3.")
        for reference in set(_references(schema)):
            at = schema
            for part in reference.removeprefix("#/").split("/"):
                at = at[part]
        assert "± of the correction" in text
        docs, page = await client.get("/docs"), await client.get("/")
        for path in schema["paths"]:
            assert f"<code>{path}</code>" in docs.text
        assert "corrected in full" in page.text
        for answer in (docs, page):
            assert answer.headers["content-security-policy"].startswith("default-src 'none'")
            for word in ("<script", "<link", "<img", "src=", "://", "@import", "url("):
                assert word not in answer.text, word
        assert (await client.get("/nothing")).status_code == 404
        found.run.link.values["R_T_x1"] = 4.2e8
        await found.run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        assert await lights(client) == (200, 503)
        assert (await client.get("/readyz")).text == "X: NOT CORRECTED\n"
        faults = (await client.get("/api/v1/faults")).json()
        assert faults["signal T_x1"].startswith("broken wire")
        mode = found.socket.stat().st_mode
        assert stat.S_ISSOCK(mode)
        assert stat.S_IMODE(mode) == 0o660
    assert not found.socket.exists()


async def test_metrics_by_the_official_parsers(tmp_path: Path) -> None:
    """Each value again as the status has it; stale positions are not there at all."""
    async with observed(tmp_path) as found, found.client() as client:
        await found.run.until(compensating)
        await says(client, "corrected in full")
        wanted = {"accept": "application/openmetrics-text; version=1.0.0"}
        answer = await client.get("/metrics", headers=wanted)
        status = await status_of(client)
        assert answer.headers["content-type"].startswith("application/openmetrics-text")
        families = list(openmetrics.text_string_to_metric_families(answer.text))
        values = {
            (s.name, tuple(sorted(s.labels.items()))): s.value for f in families for s in f.samples
        }
        assert values["abbe_corrected_in_full", ()] == 1.0
        assert values["abbe_correction_meters", (("axis", "X"),)] == pytest.approx(
            1e-6 * (status.axes["X"].correction or math.nan), abs=1e-9
        )
        assert values["abbe_indicated_position_meters", (("axis", "Z"),)] == pytest.approx(-0.18)
        assert values["abbe_temperature_celsius", (("signal", "T_y1"),)] == pytest.approx(21.0)
        assert values["abbe_status_bit", (("bit", "COMPENSATING"),)] == 1.0
        state = (("abbe_guard_state", "active"), ("axis", "X"))
        assert values["abbe_guard_state", state] == 1.0
        assert values["abbe_process_resident_memory_bytes", ()] == pytest.approx(
            resident(), rel=0.2
        )
        spent = time.process_time()
        assert values["abbe_process_cpu_seconds_total", ()] == pytest.approx(spent, rel=0.2)
        buckets = [v for (name, _), v in values.items() if name.endswith("_seconds_bucket")]
        assert buckets == sorted(buckets)
        assert values["abbe_cycle_duration_seconds_count", ()] == buckets[-1] > 0
        (info,) = [s.labels for f in families if f.name == "abbe_run" for s in f.samples]
        model = next(f for f in status.files if f.role == "model")
        assert info["model_sha256"] == model.sha256
        old = await client.get("/metrics", headers={"accept": "text/plain"})
        assert old.headers["content-type"].startswith("text/plain")
        names = {f.name for f in text_string_to_metric_families(old.text)}
        assert {"abbe_cycles", "abbe_link_state", "abbe_http_requests"} <= names
        with down(found):
            await found.run.until(lambda r: "link cmm" in r.faults)
            await asyncio.sleep(0.3)  # a status serves for 0.2 s
            text = (await client.get("/metrics", headers=wanted)).text
        assert 'abbe_axis_stale{axis="X"} 1.0' in text
        assert "abbe_indicated_position_meters{" not in text
        assert 'abbe_fault{what="link cmm"} 1.0' in text
        assert 'abbe_link_state{abbe_link_state="down",link="cmm"} 1.0' in text


@pytest.mark.thorough
async def test_without_an_output_ready_is_what_is_computed_in_full(tmp_path: Path) -> None:
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8")
    start = text.index("[output]")
    outputs = text[start : text.index("[links.", start)]
    async with observed(tmp_path, {outputs: ""}) as found, found.client() as client:
        await found.run.until(compensating)
        await says(client, "computed, not written")
        assert await lights(client) == (200, 200)
        text = (await client.get("/metrics")).text
        assert "abbe_corrected_in_full 0.0" in text
        assert "abbe_computed_in_full 1.0" in text


async def test_every_cycle_is_streamed(tmp_path: Path) -> None:
    """In order, none missing, each as the run's own record has it."""
    async with observed(tmp_path) as found, found.client() as client:
        await found.run.until(compensating)
        cycles = []
        async with client.stream("GET", "/api/v1/cycles", params={"every": 0}) as response:
            assert response.headers["content-type"].startswith("text/event-stream")
            async for kind, number, data in events(response):
                assert kind == "cycle"
                cycles.append(StreamedCycle.model_validate_json(data))
                assert cycles[-1].cycle == int(number)
                if len(cycles) == 150:
                    break
        numbers = [c.cycle for c in cycles]
        assert numbers == list(range(numbers[0], numbers[0] + 150))
        records = {r.number: r for r in found.run.records}
        for cycle in cycles:
            record = records[cycle.cycle]
            x = found.run.service.pipeline.axes.index("X")
            assert cycle.indicated["X"] == pytest.approx(record.indicated[x])
            assert cycle.correction["Z"] == pytest.approx(
                1e3 * record.decision.correction[2], abs=1e-3
            )
            assert cycle.status_word == record.status
            assert cycle.signals["T_z1"] == pytest.approx(21.0)
            assert cycle.in_full
        refused = await client.get("/api/v1/cycles", params={"every": -1})
        assert refused.status_code == 422
        assert refused.json()["detail"].startswith("query.every: ")

        async def times(every: float, count: int) -> list[float]:
            got: list[float] = []
            async with client.stream("GET", "/api/v1/cycles", params={"every": every}) as response:
                async for _, _, data in events(response):
                    got.append(json.loads(data)["time"])
                    if len(got) == count:
                        break
            return got

        slow, quick = await asyncio.gather(times(0.2, 6), times(0.0, 100))
        gaps = [b - a for a, b in pairwise(slow)]
        assert min(gaps) >= 0.2 - 1e-3
        assert quick == sorted(quick)


async def test_nobody_asks_and_nothing_is_worked_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    survey, pack = StatusSource.__call__, CyclePacker.__call__
    monkeypatch.setattr(StatusSource, "__call__", lambda s: made.append("status") or survey(s))
    monkeypatch.setattr(
        CyclePacker, "__call__", lambda s, r, d: made.append("cycle") or pack(s, r, d)
    )
    async with observed(tmp_path) as found:
        await found.run.until(compensating)
        listening = len(found.run.service.pipeline.listeners)
        made.clear()
        number = found.run.records[-1].number
        await found.run.until(lambda r: r.number > number + 100)
        assert made == []
        assert len(found.run.service.pipeline.listeners) == listening
        async with found.client() as client:
            # many ask at once: one status serves them all
            await asyncio.gather(*(client.get("/api/v1/status") for _ in range(20)))
            assert 1 <= made.count("status") <= 3
            async with client.stream("GET", "/api/v1/cycles") as response:
                async for _ in events(response):
                    break
        assert "cycle" in made
        await until(lambda: len(found.run.service.pipeline.listeners) == listening)
        made.clear()
        number = found.run.records[-1].number
        await found.run.until(lambda r: r.number > number + 50)
        assert made == []


@pytest.mark.thorough
async def test_a_cycle_that_hangs_is_not_healthy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("abbe.daemon.status.status_source._HANGS", 0.3)
    async with observed(tmp_path) as found, found.client() as client:
        await found.run.until(compensating)
        found.run.link.delay = 4.0
        await shown(client, (503, 503))
        assert "abbe_cycle_alive 0.0" in (await client.get("/metrics")).text
        found.run.link.delay = 0.0
        await shown(client, (200, 200))


def _references(part: object) -> list[str]:
    if isinstance(part, dict):
        found = [part["$ref"]] if isinstance(part.get("$ref"), str) else []
        return found + [r for value in part.values() for r in _references(value)]
    if isinstance(part, list):
        return [r for value in part for r in _references(value)]
    return []


async def test_the_process_killed_and_frozen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Whatever happens to it, the correction goes on, and it is begun anew."""
    monkeypatch.setattr(parent, "_SILENT", 6.0)
    monkeypatch.setattr(parent, "_FIRST_DELAY", 0.1)
    started: list[int] = []
    real = asyncio.create_subprocess_exec

    async def noted(*arguments: object, **options: object) -> asyncio.subprocess.Process:
        process = await real(*arguments, **options)  # type: ignore[arg-type]
        started.append(process.pid)
        return process

    monkeypatch.setattr(asyncio, "create_subprocess_exec", noted)
    caplog.set_level(logging.WARNING, "abbe")
    async with observed(tmp_path) as found:
        await found.run.until(compensating)
        for number in (signal.SIGKILL, signal.SIGSTOP):
            before, count = len(started), len(found.run.records)
            os.kill(started[-1], number)
            await until(lambda before=before: len(started) > before)
            await found.serving()
            meanwhile = found.run.records[count:]
            # a busy computer may hold the correction for a moment; what was killed does not
            assert sum(map(compensating, meanwhile)) > 0.5 * len(meanwhile) > 5
        last = started[-1]
    with pytest.raises(ProcessLookupError):
        os.kill(last, 0)
    said = [r.getMessage() for r in caplog.records if "begun anew" in r.getMessage()]
    assert "has ended (exit status -9)" in said[0]
    assert "says nothing for 6 s" in said[1]
