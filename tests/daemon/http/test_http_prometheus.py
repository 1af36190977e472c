"""A real Prometheus scrapes a run over TLS with a token; promtool finds nothing to complain of."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from tests.daemon.pipeline.test_pipeline import compensating
from tests.support.daemon.observed import (
    PATIENCE,
    bearer,
    certificate,
    free_port,
    observed,
    token,
    until,
)
from tests.support.daemon.plant_files import ALERTS, named, questions, scraped
from tests.support.daemon.prometheus_tools import PrometheusTools

pytestmark = pytest.mark.integration


@asynccontextmanager
async def scraping(
    prometheus: str, folder: Path, port: int, ca: Path, secret: str
) -> AsyncIterator[httpx.AsyncClient]:
    """A Prometheus that asks a run four times a second; a client of it."""
    (folder / "token").write_text(secret, encoding="utf-8")
    job = {
        "job_name": "abbe",
        "scrape_interval": "250ms",
        "scrape_timeout": "250ms",
        "scheme": "https",
        "authorization": {"credentials_file": str(folder / "token")},
        "tls_config": {"ca_file": str(ca)},
        "static_configs": [{"targets": [f"127.0.0.1:{port}"]}],
    }
    file = folder / "prometheus.yml"
    asked = {"rule_files": [str(ALERTS)], "scrape_configs": [job]}
    asked["global"] = {"evaluation_interval": "250ms"}
    file.write_text(json.dumps(asked), encoding="utf-8")  # JSON is YAML
    its = free_port()
    process = await asyncio.create_subprocess_exec(
        prometheus, f"--config.file={file}", f"--storage.tsdb.path={folder / 'data'}",
        f"--web.listen-address=127.0.0.1:{its}", "--log.level=error",
        stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
    )  # fmt: skip
    try:
        base = f"http://127.0.0.1:{its}/api/v1"
        async with httpx.AsyncClient(base_url=base, timeout=PATIENCE) as client:
            yield client
    finally:
        process.terminate()
        with contextlib.suppress(ProcessLookupError):
            await process.wait()


async def value(client: httpx.AsyncClient, query: str) -> float | None:
    """What Prometheus has of a query; None before it has anything."""
    try:
        answer = await client.get("/query", params={"query": query})
    except httpx.TransportError:
        return None
    if answer.status_code == 503:  # it begins
        return None
    found = answer.json().get("data", {}).get("result", [])
    return float(found[0]["value"][1]) if found else None


async def test_a_real_prometheus(tmp_path: Path) -> None:
    prometheus, promtool = PrometheusTools.found()
    chain, key = certificate(tmp_path)
    secret, port = token(tmp_path, "prometheus"), free_port()
    http = f'listen = ["127.0.0.1:{port}"]\ncertificate = "{chain.name}"\nkey = "{key.name}"\n'
    async with (
        observed(tmp_path, http=http) as found,
        scraping(prometheus, tmp_path, port, chain, secret) as client,
    ):
        await found.run.until(compensating)

        async def is_so(query: str, wanted: float) -> bool:
            return await value(client, query) == pytest.approx(wanted, abs=1e-9)

        await until(lambda: is_so('up{job="abbe"}', 1.0))
        await until(lambda: is_so("abbe_corrected_in_full", 1.0))
        assert await value(client, 'abbe_temperature_celsius{signal="T_x1"}') == pytest.approx(21.0)
        error = found.run.records[-1].decision.correction[1]
        seen = await value(client, 'abbe_correction_meters{axis="Y"}')
        assert seen == pytest.approx(1e-3 * error, abs=1e-8)
        kinds = (await client.get("/targets/metadata", params={"metric": "abbe_cycles"})).json()
        assert kinds["data"][0]["type"] == "counter"
        # a broken wire is an alarm a moment later, and is over a moment after it is mended
        ohms = found.run.link.values["R_T_x1"]
        found.run.link.values["R_T_x1"] = 4.2e8
        await until(lambda: is_so('abbe_signal_stale{signal="T_x1"}', 1.0))
        await until(lambda: is_so("abbe_corrected_in_full", 0.0))
        for alert in ("AbbeSignalStale", "AbbeNotCorrected"):
            await until(lambda alert=alert: is_so(f'ALERTS{{alertname="{alert}"}}', 1.0))
        found.run.link.values["R_T_x1"] = ohms
        await until(lambda: is_so("abbe_corrected_in_full", 1.0))
        rules = (await client.get("/rules")).json()["data"]["groups"][0]["rules"]
        assert {rule["health"] for rule in rules} == {"ok"}
        for panel, question in questions():
            answer = (await client.get("/query", params={"query": question})).json()
            assert answer["status"] == "success", (panel, answer)
        async with found.client() as own:
            text = await own.get("/metrics", headers={"accept": "text/plain", **bearer(secret)})
    # those of check points: tests/daemon/checks/test_live_checks.py
    of_checks = {name for name in named() if name.startswith("abbe_check_")}
    assert named() - of_checks - scraped(text.text) == set()
    check = [promtool, "check", "metrics"]
    done = await asyncio.to_thread(
        subprocess.run, check, input=text.content, capture_output=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout + done.stderr == b""
