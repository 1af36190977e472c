"""A mill's OPC UA server by node-opcua, as a process of its own, and links to it."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.link import OpcuaLink

ROOT = Path(__file__).parents[4]
URI = "http://example.org/mill"
_SERVER = Path(__file__).with_name("server.js")
_MODULES = ROOT / ".venv" / "opcua" / "node_modules"


@dataclass
class Mill:
    """The server.

    Attributes
    ----------
    port
        Its TCP port.
    namespace
        Number of the namespace `URI` in it.
    certificate
        File with its certificate.
    """

    process: subprocess.Popen[str]
    port: int
    namespace: int
    certificate: Path

    @property
    def url(self) -> str:
        """Where it is."""
        return f"opc.tcp://127.0.0.1:{self.port}"

    def say(self, state: int | None = None, **values: Mapping[str, Any]) -> dict[str, Any]:
        """Have it say something else of its variables from now on."""
        order: dict[str, Any] = {"say": values}
        if state is not None:
            order["state"] = state
        return self._order(order)

    def set_clock(self, ahead: float) -> None:
        """Set its clock, s ahead of ours; what it says as `clock` stays right."""
        self._order({"ahead": ahead})

    def forget_subscriptions(self) -> int:
        """Have it delete all subscriptions; how many there were."""
        found: int = self._order({"forget": True})["subscriptions"]
        return found

    def _order(self, order: Mapping[str, Any]) -> dict[str, Any]:
        stdin, stdout = self.process.stdin, self.process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(json.dumps(order) + "\n")
        stdin.flush()
        found: dict[str, Any] = json.loads(_answer(stdout))
        return found

    def kill(self) -> None:
        """End it as a loss of power does."""
        self.process.kill()
        self.process.wait()


def _answer(said: IO[str]) -> str:
    """Its next line that is for us; the library warns in lines of its own."""
    while line := said.readline():
        if line.startswith("{"):
            return line
    raise AssertionError("node-opcua does not run: make .venv/.debian installs it")


@contextmanager
def mill(folder: Path, port: int = 0, other_namespaces: int = 0) -> Iterator[Mill]:
    """A server, over when the context is; its keys are kept in `folder`."""
    process = subprocess.Popen(
        ["node", _SERVER, folder, str(port), str(other_namespaces)],
        env=os.environ | {"NODE_PATH": str(_MODULES)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None
        ready = json.loads(_answer(process.stdout))
        yield Mill(process, ready["port"], ready["namespace"], Path(ready["certificate"]))
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


def section(url: str, channels: Mapping[str, Any], **keys: Any) -> OpcuaConfig:
    """A link's section; a channel may be given as the variable's name only."""
    nodes = {
        name: {"node": f"nsu={URI};s=Mill/{what}"} if isinstance(what, str) else what
        for name, what in channels.items()
    }
    keys = {"reconnect_min": 0.05, "reconnect_max": 0.2, "timeout": 5.0} | keys
    return OpcuaConfig.model_validate({"url": url, "channels": nodes} | keys)


def node(name: str, **keys: Any) -> dict[str, Any]:
    """A channel's section."""
    return {"node": f"nsu={URI};s=Mill/{name}"} | keys


@asynccontextmanager
async def linked(url: str, channels: Mapping[str, Any], **keys: Any) -> AsyncIterator[OpcuaLink]:
    """An open link."""
    link = OpcuaLink("mill", section(url, channels, **keys))
    try:
        await link.open()
        yield link
    finally:
        await link.close()
