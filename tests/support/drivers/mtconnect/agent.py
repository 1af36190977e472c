"""An MTConnect agent on a real socket: buffer, sequence numbers, documents; or bytes as told."""

from __future__ import annotations

import contextlib
import re
import socketserver
import threading
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import asynccontextmanager, contextmanager
from datetime import UTC, datetime, timedelta
from typing import Any
from urllib.parse import parse_qs, urlsplit

from abbe.drivers.mtconnect.config import MtconnectConfig
from abbe.drivers.mtconnect.link import MtconnectLink

ITEMS = {
    "Xact": ("SAMPLE", "POSITION", "MILLIMETER", "Position"),
    "Yact": ("SAMPLE", "POSITION", "MILLIMETER", "Position"),
    "Zact": ("SAMPLE", "POSITION", "MILLIMETER", "Position"),
    "Ppos": ("SAMPLE", "PATH_POSITION", "MILLIMETER_3D", "PathPosition"),
    "Stemp": ("SAMPLE", "TEMPERATURE", "CELSIUS", "Temperature"),
    "Cact": ("SAMPLE", "ANGLE", "DEGREE", "Angle"),
    "mode": ("EVENT", "CONTROLLER_MODE", "", "ControllerMode"),
}


def http(body: str | bytes, status: str = "200 OK", more: str = "") -> bytes:
    """An answer with its length."""
    raw = body.encode() if isinstance(body, str) else body
    head = f"HTTP/1.1 {status}\r\nContent-Type: text/xml\r\nContent-Length: {len(raw)}\r\n{more}"
    return head.encode() + b"\r\n" + raw


class MillAgent:
    """What a mill's agent keeps and answers.

    Attributes
    ----------
    asked
        Targets, in the order they came.
    silent
        Whether it leaves out, without a word, what it does not keep any more.
    instead
        Answers in its place: the bytes, piece by piece; None: the agent itself answers.
    connections
        How many were taken.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.instance, self.first, self.size, self.version = 1001, 1, 64, "1.7"
        self.units: dict[str, str] = {}
        self.header = ""
        self.creation_digits = 6
        self.silent = False
        self.clock = timedelta()
        self.asked: list[str] = []
        self.connections = 0
        self.instead: Callable[[str], Iterable[bytes] | None] = lambda target: None
        self.port = 0
        self.forget()

    def forget(self) -> None:
        """Begin as after a start: all items unavailable."""
        self.kept: list[tuple[int, str, str]] = []
        self.current: dict[str, tuple[int, str, str]] = {}
        self.following = 1
        for item in ITEMS:
            self.say(**{item: "UNAVAILABLE"})

    def say(self, age: float = 0.0, more: str = "", **values: object) -> None:
        """Observe: id = text, by an adapter that stamps it so many s ago."""
        with self.lock:
            for item, text in values.items():
                at = datetime.now(UTC) + self.clock - timedelta(seconds=age)
                stamp = at.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
                name = ITEMS[item][3]
                element = (
                    f'<{name} dataItemId="{item}" sequence="{self.following}" '
                    f'timestamp="{stamp}" {more}>{text}</{name}>'
                )
                seen = (self.following, item, element)
                self.kept = [*self.kept, seen][-self.size :]
                self.current[item] = seen
                self.following += 1

    def _document(self, kind: str, body: str, following: int | None = None) -> str:
        made = (datetime.now(UTC) + self.clock).strftime("%Y-%m-%dT%H:%M:%S.%f")
        made = made[: 19 + (self.creation_digits + 1 if self.creation_digits else 0)] + "Z"
        first = self.kept[0][0]
        header = (
            f'<Header creationTime="{made}" sender="mill" instanceId="{self.instance}" '
            f'version="{self.version}.0.1" bufferSize="{self.size}" firstSequence="{first}" '
            f'lastSequence="{self.following - 1}" '
            f'nextSequence="{self.following if following is None else following}" {self.header}/>'
        )
        space = f"urn:mtconnect.org:MTConnect{kind}:{self.version}"
        return (
            f'<?xml version="1.0" encoding="UTF-8"?><m:MTConnect{kind} xmlns:m="{space}" '
            f'xmlns="{space}">{header}{body}</m:MTConnect{kind}>'
        )

    def streams(self, elements: Iterable[str], following: int | None = None) -> str:
        """A streams document."""
        body = (
            '<Streams><DeviceStream name="Mill" uuid="000"><ComponentStream component="Linear" '
            f'componentId="x"><Samples>{"".join(elements)}</Samples></ComponentStream>'
            "</DeviceStream></Streams>"
        )
        return self._document("Streams", body, following)

    def probe(self) -> str:
        """The probe document."""
        items = "".join(
            f'<DataItem id="{item}" category="{category}" type="{kind}" '
            + (f'units="{self.units.get(item, unit)}" ' if self.units.get(item, unit) else "")
            + "/>"
            for item, (category, kind, unit, _) in ITEMS.items()
        )
        body = (
            '<Devices><Device id="d" name="Mill" uuid="000"><Components><Axes id="a"><DataItems>'
            f"{items}</DataItems></Axes></Components></Device></Devices>"
        )
        return self._document("Devices", body)

    def refusal(self, code: str) -> str:
        """An error document, in the manner of 1.x or of 2.x."""
        if self.version.startswith("2"):
            error = (
                f'<Errors><OutOfRange errorCode="{code}"><ErrorMessage>no {code}</ErrorMessage>'
                "</OutOfRange></Errors>"
            )
        else:
            error = f'<Errors><Error errorCode="{code}">no {code}</Error></Errors>'
        return self._document("Error", error)

    def answer(self, target: str) -> bytes:
        """What the agent itself answers."""
        with self.lock:
            url = urlsplit(target)
            asked = parse_qs(url.query)
            wanted = set(re.findall(r'@id="([^"]+)"', asked.get("path", [""])[0])) or set(ITEMS)
            if url.path == "/Mill/probe":
                return http(self.probe())
            if url.path == "/Mill/current":
                seen = [self.current[item][2] for item in sorted(wanted) if item in self.current]
                return http(self.streams(seen))
            if url.path == "/Mill/sample":
                start, count = int(asked["from"][0]), int(asked["count"][0])
                first = self.kept[0][0]
                start = max(start, first) if self.silent else start
                if not first <= start <= self.following or count > self.size:
                    status = "404 Not Found" if self.version.startswith("2") else "200 OK"
                    return http(self.refusal("OUT_OF_RANGE"), status)
                found = [one for one in self.kept if one[0] >= start and one[1] in wanted]
                more = found[count:]
                seen = [one[2] for one in found[:count]]
                return http(self.streams(seen, more[0][0] if more else None))
            return http(self.refusal("INVALID_PATH"), "404 Not Found")


@contextmanager
def serving(agent: MillAgent) -> Iterator[MillAgent]:
    """An agent that listens."""
    sockets = []

    class _Asked(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            agent.connections += 1
            sockets.append(self.request)
            held = b""
            with contextlib.suppress(OSError):
                while True:
                    while b"\r\n\r\n" not in held:
                        piece = self.request.recv(65536)
                        if not piece:
                            return
                        held += piece
                    head, _, held = held.partition(b"\r\n\r\n")
                    target = head.split()[1].decode()
                    agent.asked.append(target)
                    pieces = agent.instead(target)
                    for piece in (agent.answer(target),) if pieces is None else pieces:
                        if not piece:
                            return
                        self.request.sendall(piece)

    class _Server(socketserver.ThreadingTCPServer):
        allow_reuse_address = True
        daemon_threads = True
        block_on_close = False

    with _Server(("127.0.0.1", agent.port), _Asked) as server:
        agent.port = server.server_address[1]
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield agent
        finally:
            server.shutdown()
            thread.join()
            for one in sockets:
                with contextlib.suppress(OSError):
                    one.shutdown(2)


def section(agent: MillAgent, **keys: Any) -> MtconnectConfig:
    """A link's section: X and the spindle's temperature unless others are named."""
    keys.setdefault(
        "channels", {"x": {"data": "Xact", "unit": "mm"}, "T": {"data": "Stemp", "unit": "degC"}}
    )
    keys.setdefault("stamp", "none")
    settings = {"timeout": 5.0, "reconnect_min": 0.01, "reconnect_max": 0.05}
    return MtconnectConfig.model_validate(
        {"url": f"http://127.0.0.1:{agent.port}/Mill"} | settings | keys
    )


@asynccontextmanager
async def linked(agent: MillAgent, **keys: Any) -> AsyncIterator[MtconnectLink]:
    """An open link."""
    link = MtconnectLink("mill", section(agent, **keys))
    try:
        await link.open()
        yield link
    finally:
        await link.close()
