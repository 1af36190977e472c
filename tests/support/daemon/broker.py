"""A real Mosquitto in a process of its own, and a subscriber that shares nothing with Abbe's."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import ssl
import struct
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.support.daemon.observed import certificate, free_port

ROOT = Path(__file__).parents[3]
UNPACKED = ROOT / ".venv" / "unpacked" / "usr"
PATIENCE = 30.0
SECRET = "of the broker's"


class Mosquitto:
    """The broker: begun, killed, begun again at the same port.

    Attributes
    ----------
    port
        Where it listens.
    ca
        Certificate that vouches for it; None: it speaks in the clear.

    Parameters
    ----------
    keeps
        Whether it keeps who subscribed over its own end, and what came for them while they were
        away.
    """

    def __init__(
        self,
        folder: Path,
        *,
        tls: bool = False,
        acl: str = "",
        more: str = "",
        keeps: bool = False,
    ) -> None:
        self.port = free_port()
        self.ca: Path | None = None
        self._folder = folder
        lines = [f"listener {self.port} 127.0.0.1", "log_dest none"]
        lines.append(f"persistence {'true' if keeps else 'false'}")
        if keeps:
            lines += [f"persistence_location {folder}/", "queue_qos0_messages true"]
        if os.geteuid() == 0:
            lines.append("user root")
        if tls:
            self.ca, key = certificate(folder, "broker")
            lines += [f"certfile {self.ca}", f"keyfile {key}", "tls_version tlsv1.2"]
        if acl:
            (folder / "acl").write_text(acl, "utf-8")
            (folder / "passwords").write_text(f"abbe:{SECRET}\nreader:{SECRET}\n", "utf-8")
            subprocess.run(
                [UNPACKED / "bin" / "mosquitto_passwd", "-U", folder / "passwords"],
                env=_environment(), check=True, timeout=PATIENCE,
            )  # fmt: skip
            lines += [f"acl_file {folder / 'acl'}", f"password_file {folder / 'passwords'}"]
        lines.append(f"allow_anonymous {'false' if acl else 'true'}")
        (folder / "mosquitto.conf").write_text("\n".join([*lines, more]) + "\n", "utf-8")
        self.process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        """Start it; returns when it listens."""
        self.process = subprocess.Popen(
            [UNPACKED / "sbin" / "mosquitto", "-c", self._folder / "mosquitto.conf"],
            env=_environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        deadline = time.monotonic() + PATIENCE
        while not _listens(self.process.pid, self.port):
            assert self.process.poll() is None, "Mosquitto does not run"
            assert time.monotonic() < deadline
            time.sleep(0.002)

    def kill(self) -> None:
        """End it as a loss of power does."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def end(self) -> None:
        """End it as a service is ended: what it keeps is on the disk."""
        if self.process is not None:
            self.process.terminate()
            self.process.wait(PATIENCE)

    def freeze(self, *, frozen: bool) -> None:
        """Have it take connections and never answer, as the kernel goes on; or go on."""
        assert self.process is not None
        self.process.send_signal(signal.SIGSTOP if frozen else signal.SIGCONT)


@contextmanager
def mosquitto(folder: Path, **keys: Any) -> Iterator[Mosquitto]:
    """A broker that runs, over when the context is."""
    if not (UNPACKED / "sbin" / "mosquitto").exists():
        target = ".venv/unpacked/usr/sbin/mosquitto"
        subprocess.run(["make", target], cwd=ROOT, check=False, capture_output=True, timeout=90)
    if not (UNPACKED / "sbin" / "mosquitto").exists():
        pytest.skip("Debian's package mosquitto cannot be had here")
    broker = Mosquitto(folder, **keys)
    broker.begin()
    try:
        yield broker
    finally:
        broker.kill()


class Subscriber:
    """A client of MQTT 3.1.1 (OASIS), as far as it takes to listen with quality 0.

    Attributes
    ----------
    heard
        Topic, payload and whether it was a retained one, in the order in which they came.
    deaf
        Set when the broker has gone.
    """

    def __init__(self) -> None:
        self.heard: list[tuple[str, bytes, bool]] = []
        self.deaf = asyncio.Event()
        self._subscribed = asyncio.Event()

    def bodies(self, topic: str) -> list[dict[str, Any]]:
        """What came on topics that end so, as JSON."""
        return [json.loads(body) for name, body, _ in self.heard if name.endswith(topic)]

    @asynccontextmanager
    async def listening(
        self, broker: Mosquitto, topics: str = "#", user: str = "", *, stays: bool = False
    ) -> AsyncIterator[None]:
        """Hear everything while the context is open; on entry the broker has taken that.

        One who `stays` goes on to be subscribed after it, and then hears what came meanwhile.
        """
        context = ssl.create_default_context(cafile=broker.ca) if broker.ca else None
        reader, writer = await asyncio.open_connection("127.0.0.1", broker.port, ssl=context)
        flags = (0xC0 if user else 0x00) | (0x00 if stays else 0x02)
        body = _text("MQTT") + bytes([4, flags, 0, 0]) + _text(f"subscriber-{os.getpid()}")
        if user:
            body += _text(user) + _text(SECRET)
        writer.write(b"\x10" + _length(body) + body)
        kind, answer = await _packet(reader)
        assert (kind >> 4, answer[1]) == (2, 0), answer
        body = struct.pack("!H", 1) + _text(topics) + b"\x00"
        writer.write(b"\x82" + _length(body) + body)
        self._subscribed.clear()
        self.deaf.clear()
        hearing = asyncio.create_task(self._hear(reader))
        subscribed = asyncio.create_task(self._subscribed.wait())
        try:
            async with asyncio.timeout(PATIENCE):
                await asyncio.wait({hearing, subscribed}, return_when=asyncio.FIRST_COMPLETED)
            yield
        finally:
            writer.close()
            for task in (hearing, subscribed):
                task.cancel()
            with contextlib.suppress(asyncio.CancelledError, OSError):
                await hearing

    async def _hear(self, reader: asyncio.StreamReader) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError, OSError):
            while True:
                kind, body = await _packet(reader)
                if kind >> 4 == 9:
                    self._subscribed.set()
                elif kind >> 4 == 3:
                    end = 2 + int.from_bytes(body[:2], "big")
                    self.heard.append((body[2:end].decode(), body[end:], bool(kind & 1)))
        self.deaf.set()


def _environment() -> dict[str, str]:
    libraries = ":".join(str(folder) for folder in (UNPACKED / "lib").glob("*-linux-gnu*"))
    return os.environ | {"LD_LIBRARY_PATH": libraries}


def _listens(process: int, port: int) -> bool:
    """Whether it has a socket that listens there, by the kernel's table."""
    rows = Path(f"/proc/{process}/net/tcp").read_text("ascii").splitlines()[1:]
    return any(r.split()[1].endswith(f":{port:04X}") and r.split()[3] == "0A" for r in rows)


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("!H", len(data)) + data


def _length(body: bytes) -> bytes:
    left, found = len(body), bytearray()
    while True:
        left, digit = divmod(left, 128)
        found.append(digit | (0x80 if left else 0))
        if not left:
            return bytes(found)


async def _packet(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    kind = (await reader.readexactly(1))[0]
    length = shift = 0
    while True:
        digit = (await reader.readexactly(1))[0]
        length |= (digit & 0x7F) << shift
        shift += 7
        if not digit & 0x80:
            return kind, await reader.readexactly(length)
