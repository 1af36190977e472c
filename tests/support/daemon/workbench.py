"""The workbench in a process of its own, as a person starts it, and requests to it."""

from __future__ import annotations

import http.client
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email.message import Message
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

ABBE = Path(sys.executable).with_name("abbe")


@dataclass(frozen=True)
class Answered:
    """What came back."""

    status: int
    headers: Message
    body: bytes


@dataclass
class OpenedWorkbench:
    """A workbench that listens.

    Attributes
    ----------
    process
        The process.
    address
        Where one browser may enter.
    """

    process: subprocess.Popen[str]
    address: str
    cookie: str = field(default="")

    @property
    def port(self) -> int:
        port = urlsplit(self.address).port
        assert port is not None
        return port

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def ask(
        self, method: str, path: str, body: bytes | None = None, **headers: str | None
    ) -> Answered:
        """A request exactly as it stands; `headers` with ``_`` for ``-``, None leaves one out."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        said: dict[str, str | None] = {"host": f"127.0.0.1:{self.port}", "cookie": self.cookie}
        if body is not None:
            said |= {"content-type": "application/json", "origin": self.origin}
            said["content-length"] = str(len(body))
        said |= {name.replace("_", "-"): value for name, value in headers.items()}
        for name, value in said.items():
            if value:
                connection.putheader(name, value)
        try:
            connection.endheaders(body)
            with connection.getresponse() as response:
                return Answered(response.status, response.headers, response.read())
        finally:
            connection.close()

    def enter(self) -> None:
        """Take the cookie."""
        parts = urlsplit(self.address)
        entered = self.ask("GET", f"{parts.path}?{parts.query}")
        assert entered.status == 303
        self.cookie = str(entered.headers["set-cookie"]).partition(";")[0]

    def json(self, path: str, body: dict[str, Any] | None = None) -> Any:
        """What a page gets."""
        sent = None if body is None else json.dumps(body).encode()
        answered = self.ask("GET" if sent is None else "POST", path, sent)
        assert answered.status == 200, answered.body
        return json.loads(answered.body)


@contextmanager
def opened(*arguments: str | Path, by: str = "open") -> Iterator[OpenedWorkbench]:
    """``abbe open`` (or `by` another command) with some arguments, until the block ends."""
    process = subprocess.Popen(
        [ABBE, *by.split(), *map(str, arguments), "--no-browser"], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        lines = iter(process.stdout.readline, "")
        found = next(filter(None, (re.search(r"http\S+", line) for line in lines)), None)
        assert found is not None
        yield OpenedWorkbench(process, found[0])
    finally:
        if process.poll() is None:
            process.kill()
        process.stdout.close()
        process.wait()
