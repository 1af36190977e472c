"""Who may look and who may change over HTTP: tokens, roles, networks, TLS."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import ssl
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.daemon.config.sections.http import split_address
from abbe.daemon.config.tokens import Token, TokenFile, add_token, read_tokens, token_of
from abbe.daemon.http.gate import LOCAL, Gate
from tests.daemon.commands.test_commands import abbe
from tests.daemon.pipeline.test_live_control import running
from tests.daemon.pipeline.test_pipeline import EXAMPLE, compensating
from tests.support.daemon.observed import (
    PATIENCE,
    bearer,
    certificate,
    free_port,
    observed,
    token,
    until,
)

pytestmark = pytest.mark.integration


async def test_over_the_network_with_tokens_and_tls(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "abbe")
    chain, key = certificate(tmp_path)
    view, operate = token(tmp_path, "prometheus"), token(tmp_path, "cell", "operate")
    over = token(tmp_path, "visitor", days=1e-9)
    port = free_port()
    http = f'listen = ["127.0.0.1:{port}"]\ncertificate = "{chain.name}"\nkey = "{key.name}"\n'
    async with observed(tmp_path, http=http) as found:
        await found.run.until(compensating)
        base = f"https://127.0.0.1:{port}"
        trusting = ssl.create_default_context(cafile=chain)
        async with httpx.AsyncClient(verify=trusting, base_url=base, timeout=PATIENCE) as client:
            await until(lambda: any("listening at 127" in r.getMessage() for r in caplog.records))

            async def asked(path: str, secret: str = "", **more: str) -> int:
                headers = {**(bearer(secret) if secret else {}), **more}
                return (await client.get(path, headers=headers)).status_code

            assert await asked("/healthz") == 200
            assert await asked("/readyz") == 200
            for path in ("/metrics", "/api/v1/status", "/api/v1/cycles", "/", "/docs"):
                assert await asked(path) == 401, path
                assert await asked(path, view[:-1] + "x") == 401, path
                assert await asked(path, over) == 401, path
            for path in ("/metrics", "/api/v1/status", "/docs"):
                assert await asked(path, view) == 200, path
            # as a browser asks
            answer = await client.get("/", auth=("anybody", view))
            assert answer.status_code == 200
            asked_for = (await client.get("/")).headers.get_list("www-authenticate")
            assert [h.split()[0] for h in asked_for] == ["Basic", "Bearer"]
            # a header that a proxy would set is nobody's word here
            assert await asked("/metrics", **{"x-forwarded-for": "127.0.0.1"}) == 401

            effect = next(iter(found.run.service.configuration.model.switches))
            change = {"effect": effect, "to": "off"}

            async def switched(**way: object) -> httpx.Response:
                return await client.post("/api/v1/switch", json=change, **way)  # type: ignore[arg-type]

            assert (await switched()).status_code == 401
            assert (await switched(headers=bearer(view))).status_code == 403
            # what a browser sends on its own could be another page's doing
            assert (await switched(auth=("anybody", operate))).status_code == 403
            assert found.run.service.configuration.model.switches[effect] == "on"
            answer = await switched(headers=bearer(operate))
            assert answer.status_code == 200, answer.text
            assert answer.json()["switches"][effect] == "off"
            assert found.run.service.configuration.model.switches[effect] == "off"
            said = [r.getMessage() for r in caplog.records if "compensation:" in r.getMessage()]
            assert said[-1].endswith("by token cell at 127.0.0.1")

            wrong = await client.post("/api/v1/enter", json={}, headers=bearer(operate))
            assert wrong.status_code == 422
            refused = {"signal": "T_x1", "value": 21.0}
            answer = await client.post("/api/v1/enter", json=refused, headers=bearer(operate))
            assert answer.status_code == 409
            assert "not a signal that is typed in" in answer.json()["detail"]
            assert (await client.get("/api/v1/control", headers=bearer(view))).json()["said"] == ""

            # taken back: it counts no more with the next request
            done = await asyncio.to_thread(
                abbe, "token", "remove", str(found.run.config), "prometheus"
            )
            assert done.returncode == 0, done.stderr
            assert await asked("/metrics", view) == 401
            assert await asked("/metrics", operate) == 200
            (found.folder / "http-tokens.toml").write_text("not toml [", encoding="utf-8")
            assert await asked("/metrics", operate) == 401
        with pytest.raises(httpx.TransportError):  # nobody listens in, and nobody is fooled
            async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as plain:
                await plain.get("/healthz")
        with pytest.raises(httpx.ConnectError):
            async with httpx.AsyncClient(base_url=base) as strange:
                await strange.get("/healthz")
    warned = "\n".join(r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING)
    assert "http: 127.0.0.1 was refused: a token that is none, or no more" in warned
    assert "no token counts any more" in warned
    for secret in (view, operate, over):
        assert secret not in warned
        assert secret not in (tmp_path / "http-tokens.toml").read_text(encoding="utf-8")


async def test_only_from_the_networks_that_may(tmp_path: Path) -> None:
    secret, port = token(tmp_path, "a"), free_port()
    http = f'listen = ["127.0.0.1:{port}"]\nclients = ["192.168.7.0/24"]\n'
    async with observed(tmp_path, http=http) as found:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as client:

            async def refused() -> bool:
                try:
                    answer = await client.get("/healthz", headers=bearer(secret))
                except httpx.ConnectError:
                    return False
                assert answer.status_code == 403
                return True

            await until(refused)
        async with found.client() as client:
            assert (await client.get("/healthz")).status_code in (200, 503)


async def test_nothing_is_changed_without_control(tmp_path: Path) -> None:
    from tests.daemon.pipeline.test_live_control import SOCKET

    operate = token(tmp_path, "cell", "operate")
    async with observed(tmp_path, {SOCKET: ""}) as found, found.client() as client:
        effect = next(iter(found.run.service.configuration.model.switches))
        change = {"effect": effect, "to": "off"}
        answer = await client.post("/api/v1/switch", json=change)
        assert answer.status_code == 403
        answer = await client.post("/api/v1/switch", json=change, headers=bearer(operate))
        assert answer.status_code == 409
        assert "has no [control]" in answer.json()["detail"]
        assert found.run.service.configuration.model.switches[effect] == "on"


async def test_an_address_that_is_taken_is_tried_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The correction and the Unix socket go on; when it is free, it is had."""
    secret, port = token(tmp_path, "a"), free_port()
    server = await asyncio.start_server(lambda *_: None, "127.0.0.1", port)
    http = f'listen = ["127.0.0.1:{port}"]\n'
    async with observed(tmp_path, http=http) as found:
        await found.run.until(compensating)
        said = f"http: cannot listen at 127.0.0.1:{port}: Address already in use; tried again"
        await until(lambda: said in [r.getMessage() for r in caplog.records])
        server.close()
        await server.wait_closed()
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as client:

            async def answers() -> bool:
                try:
                    return (await client.get("/", headers=bearer(secret))).status_code == 200
                except httpx.TransportError:
                    return False

            await until(answers)


def configured(folder: Path, http: str) -> Path:
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8")
    text = text.replace('"model.toml"', f'"{EXAMPLE / "model.toml"}"')
    path = folder / "config.toml"
    path.write_text(f"{text}\n[http]\n{http}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("http", "why"),
    [
        ('listen = ["localhost:80"]', "not an address to listen at"),
        ('listen = ["127.0.0.1"]', "not an address to listen at"),
        ('listen = ["::1:80"]', "not an address to listen at"),
        ('listen = ["127.0.0.1:99999"]', "not an address to listen at"),
        ('listen = ["127.0.0.1:80"]', "there is no token"),
        ('listen = ["0.0.0.0:80"]', "in the clear is everybody's"),
        ('listen = ["[fd00::1]:80"]', "in the clear is everybody's"),
        ('certificate = "a.crt"', "belong together"),
        ('certificate = "a.crt"\nkey = "a.key"', "no such file"),
        ('certificate = "config.toml"\nkey = "config.toml"', "cannot be used"),
        ('clients = ["10.0.0.1/8"]\nlisten = ["127.0.0.1:80"]', "not a network"),
        ('clients = ["10.0.0.0/8"]', "limits what does not listen"),
        ('socket = "config.toml"', "is there already and is no socket"),
        (f'socket = "{"x" * 120}"', "too long for a socket's path"),
        ("port = 80", "port"),
        ("listen = 80", "listen"),
    ],
)
def test_what_cannot_be_is_said_with_its_place(tmp_path: Path, http: str, why: str) -> None:
    path = configured(tmp_path, http)
    with pytest.raises(InputError) as raised:
        load_config(path)
    said = str(raised.value)
    assert why in said
    assert "config.toml, line " in said
    assert "http" in said


def test_another_ones_key_is_refused(tmp_path: Path) -> None:
    certificate(tmp_path, "one")
    certificate(tmp_path, "two")
    path = configured(tmp_path, 'certificate = "one.crt"\nkey = "two.key"')
    with pytest.raises(InputError, match="certificate and key cannot be used"):
        load_config(path)


def test_without_the_packages_it_is_said_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("abbe.daemon.config.sections.http.importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"HTTP needs fastapi and .*pip install 'abbe\[http\]'"):
        load_config(configured(tmp_path, ""))


def test_addresses() -> None:
    assert split_address("127.0.0.1:8470") == ("127.0.0.1", 8470)
    assert split_address("[::1]:1") == ("::1", 1)


def test_tokens_are_made_listed_and_taken_back(tmp_path: Path) -> None:
    path = configured(tmp_path, 'listen = ["127.0.0.1:8470"]')
    done = abbe("token", "add", str(path), "prometheus")
    assert done.returncode == 0, done.stderr
    secret = done.stdout.strip()
    assert len(secret) >= 43
    file = tmp_path / "http-tokens.toml"
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert secret not in file.read_text(encoding="utf-8")
    (kept,) = read_tokens(file).values()
    assert kept.sha256 == hashlib.sha256(secret.encode()).hexdigest()
    load_config(path)  # now somebody could ask
    assert abbe("token", "add", str(path), "prometheus").returncode == 1
    assert abbe("token", "add", str(path), "-rf", "--days", "1").returncode == 2
    for words, why in (
        (("add", str(path), "a/b"), "cannot name a token"),
        (("add", str(path), "b", "--role", "root"), "not a role"),
        (("remove", str(path), "c"), "no such token"),
        (("list", str(EXAMPLE / "config.toml")), "a section [http]"),
    ):
        done = abbe("token", *words)
        assert done.returncode == 1, words
        assert why in done.stderr
        assert "Traceback" not in done.stderr
    assert abbe("token", "add", str(path), "b", "--role", "operate", "--days", "7").returncode == 0
    listed = abbe("token", "list", str(path)).stdout.splitlines()
    assert listed[0].startswith("prometheus: view, made ")
    assert ", until " in listed[1]
    assert abbe("token", "remove", str(path), "prometheus").returncode == 0
    assert list(read_tokens(file)) == ["b"]
    # a damaged file is named with its line, and nothing is written over it
    file.write_text(file.read_text(encoding="utf-8").replace("sha256", "sha255"), encoding="utf-8")
    before = file.read_bytes()
    done = abbe("token", "add", str(path), "d")
    assert done.returncode == 1
    assert "http-tokens.toml, line " in done.stderr
    assert file.read_bytes() == before


def test_a_token_counts_for_its_time_only(tmp_path: Path) -> None:
    file = tmp_path / "tokens.toml"
    secret = add_token(file, "a", "view", days=1.0)
    tokens = read_tokens(file)
    found = token_of(secret, tokens)
    assert found is not None
    assert found[0] == "a"
    assert token_of(secret + "x", tokens) is None
    assert token_of("", tokens) is None
    late = datetime.now(UTC) - timedelta(seconds=1)
    over = {n: Token(**{**t.model_dump(), "expires": late}) for n, t in tokens.items()}
    assert token_of(secret, over) is None
    naive = {
        n: Token(**{**t.model_dump(), "expires": datetime(2001, 1, 1)}) for n, t in over.items()
    }
    assert token_of(secret, naive) is None


def test_the_gate_says_a_refusal_once_a_minute_for_each_address(tmp_path: Path) -> None:
    said: list[str] = []
    gate = Gate(
        TokenFile(tmp_path / "none"), ["10.0.0.0/8", "fd00::/8"], lambda _, t: said.append(t)
    )
    for number in range(1000):
        headers = [(b"authorization", f"Bearer {number}".encode())]
        visitor = gate.visitor({"headers": headers, "client": (f"10.0.0.{number % 2}", 1)})
        assert visitor.role is None
    assert gate.refused == 1000
    assert len(said) == 2
    for odd in (
        b"Bearer",
        b"Basic !!!",
        b"Basic Og==",
        b"Digest x",
        b"\xff\xfe",
        b"Bearer " + b"x" * 9999,
    ):
        assert gate.visitor({"headers": [(b"authorization", odd)], "client": None}).role is None
    assert gate.visitor({"headers": [], LOCAL: True}).role == "view"
    assert gate.welcome("10.1.2.3")
    assert gate.welcome("::ffff:10.1.2.3")
    assert gate.welcome("fd00::5")
    assert not gate.welcome("11.1.2.3")
    assert not gate.welcome("nonsense")


async def test_without_http_there_is_no_process_and_no_socket(tmp_path: Path) -> None:
    async with running(tmp_path) as run:
        await run.until(compensating)
        assert not (tmp_path / "http.sock").exists()
