"""The OPC UA server, asked by another maker's client (node-opcua), and by raw sockets."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import socket
import struct
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from asyncua import Client, ua

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.daemon.config.sections.opcua_server import OpcuaServerSection, read_users
from abbe.daemon.opcua_server import process, serving
from abbe.daemon.opcua_server.space import NAMESPACE
from abbe.daemon.systemd.install import plan
from tests.daemon.mqtt.test_mqtt_sparkplug import event, status
from tests.daemon.pipeline.test_live_control import EXAMPLE, running
from tests.daemon.pipeline.test_pipeline import compensating
from tests.drivers.opcua.test_opcua_security import made
from tests.support.daemon.observed import free_port
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

ROOT = Path(__file__).parents[3]
SCRIPT = ROOT / "tests" / "support" / "drivers" / "opcua" / "client.js"
X = "mill/Monitoring/Axes/X"
LONG = 100.0


class Server:
    """The server and its end of the run."""

    def __init__(self, port: int, folder: Path) -> None:
        self.port, self.folder = port, folder
        self.url = f"opc.tcp://127.0.0.1:{port}"
        self.said: list[dict[str, Any]] = []
        self._writer: asyncio.StreamWriter | None = None

    def attach(self, writer: asyncio.StreamWriter, reader: asyncio.StreamReader) -> None:
        self._writer = writer
        self._reading = asyncio.create_task(self._read(reader))

    async def _read(self, reader: asyncio.StreamReader) -> None:
        with contextlib.suppress(OSError):
            while line := await reader.readline():
                self.said.append(json.loads(line))

    @property
    def listens(self) -> bool:
        return any("listens" in said.get("text", "") for said in self.said)

    def tell(self, **what: Any) -> None:
        assert self._writer is not None
        self._writer.write(json.dumps(what).encode() + b"\n")

    async def asked(self, *orders: dict[str, Any], **keys: Any) -> list[Any]:
        """What node-opcua is answered; or the error that it says, alone."""
        client = await self.begun(*orders, **keys)
        async with asyncio.timeout(LONG):
            said, _ = await client.communicate()
        return answers(said)

    async def begun(self, *orders: dict[str, Any], **keys: Any) -> asyncio.subprocess.Process:
        given = {"url": self.url, "folder": str(self.folder / "pki"), "orders": orders} | keys
        modules = ROOT / ".venv" / "opcua" / "node_modules"
        return await asyncio.create_subprocess_exec(
            "node", str(SCRIPT), json.dumps(given),
            env=os.environ | {"NODE_PATH": str(modules)},
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip


def answers(said: bytes) -> list[Any]:
    """What the client says of its orders; its library says things of its own besides."""
    lines = [line for line in said.decode().splitlines() if line[:1] in ("{", "[", '"')]
    return [found for found in map(json.loads, lines) if found != {"ready": True}]


@asynccontextmanager
async def server(folder: Path, *, apart: bool = False, **keys: Any) -> AsyncIterator[Server]:
    """A server that listens; in a process of its own where that is asked for."""
    port = free_port()
    task = {
        "host": "127.0.0.1", "port": port, "anonymous": True, "unencrypted": True, "clients": [],
        "trusted": [], "every": 60.0, "about": {"abbe": "1", "machine": "mill"},
    } | keys  # fmt: skip
    mine, its = socket.socketpair()
    found = Server(port, folder)
    running: Any
    if apart:
        running = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "abbe.daemon.opcua_server.process", str(its.fileno()),
            pass_fds=(its.fileno(),), cwd=ROOT,
        )  # fmt: skip
        found.pid = running.pid  # type: ignore[attr-defined]
        its.close()
        over = running.wait()
    else:
        over = running = asyncio.create_task(process.run(its.detach()))
    mine.setblocking(False)
    reader, writer = await asyncio.open_unix_connection(sock=mine)
    found.attach(writer, reader)
    writer.write(json.dumps(task).encode() + b"\n")
    try:
        await until(lambda: found.listens, LONG)
        yield found
    finally:
        writer.close()
        await asyncio.wait_for(over, LONG)
        found._reading.cancel()


def node(path: str) -> str:
    return f"ns=2;s={path}"


@pytest.mark.thorough
async def test_values_statuses_stamps_units_and_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = round(time.time(), 3)
    async with server(tmp_path) as found:
        found.tell(status=status(now))
        axis = [node(f"{X}/{n}") for n in ("ActPos", "ActPosCorrected", "Correction", "Guard")]
        temperature = node("mill/Monitoring/Temperatures/T")
        sure = node(f"{X}/CorrectionUncertainty")
        await asyncio.sleep(0.1)
        watching = await found.begun({"subscribe": axis[0], "count": 3})
        listening = await found.begun({"events": True, "count": 2})
        for client in (watching, listening):
            assert client.stdout is not None
            async with asyncio.timeout(LONG):
                while b"ready" not in await client.stdout.readline():
                    pass
        machines, below, values, unit, refused = await found.asked(
            {"browse": node("Machines")},
            {"browse": node(X)},
            {"read": [*axis, temperature, sure, node("mill/Monitoring/Correction/InFull")]},
            {"unit": node(f"{X}/Correction/EngineeringUnits")},
            {"write": axis[0]},
        )
        assert machines == ["mill"]
        assert set(below) >= {"ActPos", "ActPosCorrected", "Correction", "Guard", "Written"}
        assert [v["value"] for v in values] == [1.5, 1.51, 10.0, "active", 20.0, None, True]
        known = ["Good"] * 5
        assert [v["status"] for v in values] == [*known, "BadOutOfService", "Good"]
        # a value is as old as its source says, to the millisecond
        assert values[0]["source"] == pytest.approx(now - 0.5, abs=0.002)
        assert values[2]["source"] == pytest.approx(now, abs=0.002)
        assert values[4]["source"] == pytest.approx(now - 2.0, abs=0.002)
        # UNECE's 4H is µm
        namespace = "http://www.opcfoundation.org/UA/units/un/cefact"
        assert unit == {"number": 0x3448, "namespace": namespace, "name": "um"}
        assert refused == {"error": refused["error"]}
        assert "BadServiceUnsupported" in refused["error"]

        stale = status(now + 1, x=2.5)
        stale["axes"]["X"] |= {"stale": True, "corrected": None, "guard": "holding"}
        stale["signals"]["T"] |= {"stale": True}
        found.tell(status=stale)
        for text in ("first µ", "second"):
            found.tell(event=event(text, now))
        (values,) = await found.asked({"read": [*axis, temperature]})
        old = "UncertainLastUsableValue"
        assert [v["status"] for v in values] == [old, "BadOutOfService", old, "Good", old]
        assert values[0]["value"] == 2.5
        # the run falls silent: its last words stay, and say so
        monkeypatch.setattr(process, "_SILENT", 0.0)
        silent = "UncertainNoCommunicationLastUsableValue"
        async with asyncio.timeout(LONG):
            seen = answers((await watching.communicate())[0])[0]
        assert [(v["value"], v["status"]) for v in seen] == [
            (1.5, "Good"), (2.5, old), (2.5, silent),
        ]  # fmt: skip
        assert seen[2]["source"] == pytest.approx(now + 0.5, abs=0.002)
        async with asyncio.timeout(LONG):
            events = answers((await listening.communicate())[0])[0]
        assert [e["text"] for e in events] == ["first µ", "second"]
        assert {(e["severity"], e["source"]) for e in events} == {(600, "mill")}


async def test_only_users_and_only_encrypted(tmp_path: Path) -> None:
    keys = made(tmp_path, "abbe")
    users = tmp_path / "users"
    users.write_text("# who may read\nplant:sécret:1\n", "utf-8")
    users.chmod(0o600)
    secured = {
        "certificate": keys["certificate"], "key": keys["private_key"], "users": str(users),
        "anonymous": False, "unencrypted": False,
    }  # fmt: skip
    read = {"read": [node(f"{X}/ActPos")]}
    plant = {"user": "plant", "password": "sécret:1"}
    async with server(tmp_path, **secured) as found:
        found.tell(status=status(time.time()))
        for mode, policy in (
            ("Sign", "Basic256Sha256"),
            ("Sign", "Aes128_Sha256_RsaOaep"),
            ("SignAndEncrypt", "Aes256_Sha256_RsaPss"),
        ):
            ((value,),) = await found.asked(read, mode=mode, policy=policy, **plant)
            assert (value["value"], value["status"]) == (1.5, "Good")
        signed = {"mode": "Sign", "policy": "Basic256Sha256"}
        (answer,) = await found.asked(read, **signed, user="plant", password="secret")
        assert "BadUserAccessDenied" in answer["error"]
        # the library opens a channel without security where no such endpoint is
        client = Client(found.url, timeout=60)
        client.set_user("plant")
        client.set_password("sécret:1")
        with pytest.raises(ua.UaStatusCodeError) as refused:
            await client.connect()
        assert refused.value.code == ua.StatusCodes.BadSecurityPolicyRejected


@pytest.mark.parametrize(
    ("text", "mode", "why"),
    [
        ("a:b\n", 0o644, "chmod 600"),
        ("a:b\na:c\n", 0o600, "twice"),
        ("nobody\n", 0o600, "line 1"),
        ("# none\n", 0o600, "no user"),
    ],
)
def test_a_file_of_users_that_is_none(tmp_path: Path, text: str, mode: int, why: str) -> None:
    path = tmp_path / "users"
    path.write_text(text, "utf-8")
    path.chmod(mode)
    with pytest.raises(InputError, match=why):
        read_users(path)


@pytest.mark.parametrize(
    ("section", "why"),
    [
        ("", "certificate and key are needed"),
        ("unencrypted = true", "nobody may read"),
        ('certificate = "there"\nanonymous = true', "go together"),
        ('unencrypted = true\nanonymous = true\nlisten = "0.0.0.0:4840"', "listens in"),
        ('unencrypted = true\nanonymous = true\nlisten = "localhost"', "not an address"),
        ('unencrypted = true\nusers = "there"', "others may read"),
        ('unencrypted = true\nusers = "nowhere"', "no such file"),
        ('certificate = "there"\nkey = "there"\nanonymous = true', "cannot be used"),
        ('unencrypted = true\nanonymous = true\nclients = ["hall"]', "not a network"),
    ],
)
def test_what_cannot_work(tmp_path: Path, section: str, why: str) -> None:
    path = configured(tmp_path, section)
    with pytest.raises(InputError, match=why) as raised:
        load_config(path)
    assert "config.toml" in str(raised.value)


def test_the_page_tells_every_key_and_a_confined_service_may_be_asked(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "opcua-server.md").read_text("utf-8")
    assert [key for key in OpcuaServerSection.model_fields if f"`{key}`" not in page] == []
    source = configured(tmp_path / "source", "unencrypted = true\nanonymous = true")
    made_of = plan(load_config(source), "mill", tmp_path / "root", tmp_path / "abbe")
    texts = [str(text) for path, text in made_of.files.items() if path.suffix == ".conf"]
    assert any("IPAddressAllow=localhost" in t or "localhost" in t for t in texts)
    assert any("SystemCallFilter=setpriority" in t for t in texts)


def configured(folder: Path, section: str) -> Path:
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    (folder / "there").write_text("plant:secret\n", "utf-8")
    path = folder / "config.toml"
    path.write_text(path.read_text("utf-8") + f"\n[opcua_server]\n{section}\n", "utf-8")
    return path


async def test_a_run_offers_itself(tmp_path: Path) -> None:
    """A whole run: what its server says is what its cycle says; without it nothing is loaded."""
    port = free_port()
    section = (
        f'\n[opcua_server]\nlisten = "127.0.0.1:{port}"\nunencrypted = true\n'
        "anonymous = true\nevery = 0.5\n"
    )
    async with running(tmp_path, None, section) as run:
        record = await run.until(compensating)
        async with asyncio.timeout(LONG):
            while True:
                with contextlib.suppress(OSError, asyncio.TimeoutError, ua.UaError):
                    async with Client(f"opc.tcp://127.0.0.1:{port}", timeout=15) as client:
                        name = run.service.configuration.model.machine.name
                        path = f"{name}/Monitoring/Axes/X/Correction"
                        read = client.get_node(ua.NodeId(path, 2)).read_value
                        value = await read()
                        break
                await asyncio.sleep(0.2)
        assert value == pytest.approx(1e3 * record.decision.correction[0], abs=0.1)


async def test_nothing_but_reading_is_answered(tmp_path: Path) -> None:
    """By the same library as the server's, which would let all of it through."""
    async with server(tmp_path) as found, Client(found.url, timeout=60) as client:
        ask = client.uaclient
        variable = ua.NodeId("mill/Notification/LastMessage/Text", 2)
        value = ua.DataValue(ua.Variant("forged"))
        requests = (
            client.get_node(variable).write_value(value),
            client.nodes.objects.add_object(ua.NodeId(0, 2), ua.QualifiedName("mine", 2)),
            client.delete_nodes([client.get_node(variable)]),
            client.nodes.server.call_method(ua.NodeId(ua.ObjectIds.Server_GetMonitoredItems), 1),
            ask.register_server(ua.RegisteredServer()),
        )
        for request in requests:
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await request
            assert refused.value.code == ua.StatusCodes.BadServiceUnsupported
        assert (await client.get_namespace_array())[2] == NAMESPACE


@pytest.mark.thorough
async def test_a_program_that_is_not_trusted(tmp_path: Path) -> None:
    keys, stranger = made(tmp_path, "abbe"), made(tmp_path, "stranger")
    secured = {
        "certificate": keys["certificate"], "key": keys["private_key"], "unencrypted": False,
        "trusted": [stranger["certificate"]],
    }  # fmt: skip
    async with server(tmp_path, **secured) as found:
        (answer,) = await found.asked({"read": ["i=2258"]}, mode="Sign", policy="Basic256Sha256")
        assert "BadCertificateUntrusted" in answer["error"]
    secured["trusted"] = []
    async with server(tmp_path, **secured) as found:
        (answer,) = await found.asked({"read": ["i=2258"]}, mode="Sign", policy="Basic256Sha256")
        assert answer[0]["status"] == "Good"


@pytest.mark.thorough
async def test_floods(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Raw sockets that send anything, without end or nothing at all: a client is still answered."""
    monkeypatch.setattr(serving, "_ACTIVATED_WITHIN", 1.0)
    hello = b"HELF" + struct.pack("<I", 32) + struct.pack("<IIIII", 0, 65535, 65535, 0, 0)
    hello += struct.pack("<i", -1)
    floods = [
        b"MSGF" + struct.pack("<I", 0x7FFFFFFF) + bytes(2_000_000),
        b"OPNF" + struct.pack("<I", 0) * 5000,
        hello * 2000,
        hello + b"MSGC" + struct.pack("<I", 8024) + bytes(8016) + b"MSGC" * 100_000,
        os.urandom(500_000),
        b"GET / HTTP/1.1\r\n\r\n" * 1000,
        b"",
    ]
    async with server(tmp_path) as found:
        found.tell(status=status(time.time()))
        tasks = [asyncio.create_task(_pour(found.port, data)) for data in floods * 3]
        await asyncio.wait(tasks, timeout=LONG)
        (values,) = await found.asked({"read": [node(f"{X}/ActPos")]}, retry=50)
        assert values[0]["value"] == 1.5
        for task in tasks:
            task.cancel()


async def _pour(port: int, data: bytes) -> None:
    with contextlib.suppress(OSError, TimeoutError):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(data)
        async with asyncio.timeout(20.0):
            # who has nothing to say is sent away, too
            while await reader.read(65536):
                pass
        writer.close()


@pytest.mark.thorough
async def test_its_memory_is_bounded_and_it_ends_with_the_run(tmp_path: Path) -> None:
    async with server(tmp_path, apart=True) as found:
        pid = found.pid  # type: ignore[attr-defined]
        before = _memory(pid)
        data = b"MSGF" + struct.pack("<I", 0x7FFFFFFF) + bytes(4_000_000)
        await asyncio.gather(*(_pour(found.port, data) for _ in range(20)))
        assert _memory(pid) - before < 32_000_000
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def _memory(pid: int) -> int:
    return int(Path(f"/proc/{pid}/statm").read_text("ascii").split()[1]) * 4096
