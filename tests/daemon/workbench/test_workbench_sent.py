"""Campaigns that a browser sends: what is hostile is refused, and nothing of it stays."""

from __future__ import annotations

import asyncio
import gzip
import io
import json
import socket
import time
import zipfile
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from fastapi import HTTPException, Request
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from abbe.daemon.workbench.campaigns import received as taken
from abbe.daemon.workbench.entrance import door
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

BRIDGE = Path(__file__).parents[2] / "data" / "p03-bridge"
PLACE = "/api/campaigns"
NAMES = (
    "", ".csv", ".hidden.csv", "model.toml", "../../etc/cron.d/x.csv", "..\\..\\x.csv",
    "/etc/x.csv", "a/b.csv", "x.csv\r\nset-cookie: abbe=1", "nul\0.csv",
    "<img src=x onerror=alert(1)>.csv",
    "a&quot;.csv", "C:x.csv", "x.csv ", f"{'x' * 200}.csv", "\u202egnp.csv",
    "day\u202evsc.csv", "day.csv.", "day.csv. ", "CON.csv", "aux.day.csv", "Lpt1 .csv",
)  # fmt: skip
ZIPPED = io.BytesIO()
with zipfile.ZipFile(ZIPPED, "w", zipfile.ZIP_DEFLATED) as _zip:
    _zip.writestr("day.csv", bytes(20_000_000))
CONTENTS = {
    "zip": (ZIPPED.getvalue(), 415),
    "gzip": (gzip.compress(bytes(20_000_000)), 415),
    "bytes": (b"time,setup\n\0\0\0", 415),
    "latin-1": ("# notes = \"20 °C\"\n".encode("latin-1"), 415),
    "nothing": (b"", 422),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sent") / "versions"


@pytest.fixture(scope="module")
def bench(folder: Path) -> Iterator[OpenedWorkbench]:
    with opened(BRIDGE / "model.toml", "--versions", folder) as found:
        found.enter()
        yield found


@pytest.fixture
def kept(folder: Path) -> Path:
    return folder / "campaigns"


def send(
    bench: OpenedWorkbench, body: bytes, name: str = "day.csv", **headers: str | None
) -> tuple[int, str]:
    said = {"content_type": "text/csv", **headers}
    answered = bench.ask("POST", f"{PLACE}?name={quote(name)}", body, **said)
    return answered.status, answered.body.decode()


def files(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir()) if folder.exists() else []


def settled(bench: OpenedWorkbench) -> dict[str, object]:
    """The state once nothing is under way."""
    while (state := bench.json("/api/state"))["task"]:
        time.sleep(0.05)
    found: dict[str, object] = state
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_is_no_campaigns_is_refused(
    bench: OpenedWorkbench, kept: Path, name: str
) -> None:
    before = files(kept)
    status, said = send(bench, b"time\n0\n", name)
    assert status == 422
    assert "<" not in said
    assert files(kept) == before


@pytest.mark.parametrize("what", CONTENTS)
def test_what_is_no_text_is_refused(bench: OpenedWorkbench, kept: Path, what: str) -> None:
    before = files(kept)
    body, status = CONTENTS[what]
    assert send(bench, body)[0] == status
    assert files(kept) == before


def test_what_is_packed_on_the_way_is_refused(bench: OpenedWorkbench) -> None:
    for packing in ("gzip", "br", "zstd", "deflate, gzip"):
        status, said = send(bench, gzip.compress(b"time\n0\n"), content_encoding=packing)
        assert (status, "never packed" in said) == (415, True)


def test_only_a_page_of_the_workbench_sends(bench: OpenedWorkbench, kept: Path) -> None:
    before = files(kept)
    foreign: tuple[dict[str, str | None], ...] = (
        {"origin": "http://evil.example"}, {"origin": None}, {"origin": "null"}, {"cookie": None},
        {"content_type": "text/plain"}, {"content_type": "multipart/form-data; boundary=x"},
        {"content_type": "application/x-www-form-urlencoded"}, {"content_type": None},
        {"content_type": "application/json"},
    )  # fmt: skip
    for headers in foreign:
        assert send(bench, b"time\n0\n", **headers)[0] == 403, headers
    assert send(bench, b"time\n0\n", host="evil.example")[0] == 421
    # and what takes JSON takes no other
    assert bench.ask("POST", "/api/note", b"{}", content_type="text/csv").status == 403
    assert files(kept) == before


def test_two_gigabytes_are_refused_before_they_are_sent(bench: OpenedWorkbench, kept: Path) -> None:
    before = files(kept)
    with socket.create_connection(("127.0.0.1", bench.port), timeout=30) as raw:
        raw.sendall(head(bench, "content-length: 2000000000") + b"time\n")
        assert b" 413 " in raw.recv(1000)
    assert files(kept) == before


def head(bench: OpenedWorkbench, *lines: str, path: str = f"{PLACE}?name=day.csv") -> bytes:
    kind = "text/csv" if path.startswith(PLACE) else "application/json"
    return "\r\n".join(
        [f"POST {path} HTTP/1.1", f"host: 127.0.0.1:{bench.port}", f"cookie: {bench.cookie}",
         f"origin: {bench.origin}", f"content-type: {kind}", *lines, "", ""]
    ).encode()  # fmt: skip


def test_who_stops_in_the_middle_leaves_nothing(bench: OpenedWorkbench, kept: Path) -> None:
    before = files(kept)
    with socket.create_connection(("127.0.0.1", bench.port), timeout=30) as raw:
        raw.sendall(head(bench, "content-length: 1000") + b"time,setup\n")
        # one at a time: meanwhile nobody else
        until = time.monotonic() + 20.0
        while send(bench, b"time\n0\n")[0] != 409:
            assert time.monotonic() < until
    while send(bench, b"", "gone.csv")[0] == 409:
        time.sleep(0.02)
    assert [f for f in files(kept) if f.endswith(".part")] == []
    assert set(files(kept)) - set(before) <= {"day.csv"}


def test_a_body_that_drips_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is begun and not ended does not hold a connection."""
    monkeypatch.setattr(door, "BODY_WITHIN", 0.05)
    said = []

    async def app(*_: object) -> None:
        raise AssertionError

    async def receive() -> dict[str, object]:
        await asyncio.sleep(0.02)
        return {"type": "http.request", "body": b" ", "more_body": True}

    async def reply(message: dict[str, object]) -> None:
        said.append(message)

    gate = door.WorkbenchDoor(app, 1, lambda _: None)  # type: ignore[arg-type]
    gate._sessions["known"] = time.monotonic() + 100.0
    scope = {
        "type": "http", "method": "POST", "path": "/api/add", "query_string": b"",
        "headers": [(b"host", b"127.0.0.1:1"), (b"cookie", b"abbe-1=known"),
                    (b"origin", b"http://127.0.0.1:1"), (b"content-type", b"application/json")],
    }  # fmt: skip
    asyncio.run(asyncio.wait_for(gate(scope, receive, reply), 20.0))  # type: ignore[arg-type]
    assert said[0]["status"] == 408
    assert (b"connection", b"close") in said[0]["headers"]  # type: ignore[operator]


def test_what_is_begun_in_a_session_is_not_finished_after_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The last piece comes when the session is over: refused, and nothing of the file stays."""
    now = 1e6
    monkeypatch.setattr(door.time, "monotonic", lambda: now)
    said: list[Any] = []

    async def kept(request: Request) -> PlainTextResponse:
        path = await taken.received(request.stream(), tmp_path, "day.csv")
        return PlainTextResponse(path.name)

    waiting = [b"time,setup\n", b"0.5,x1\n"]

    async def receive() -> dict[str, object]:
        nonlocal now
        piece = waiting.pop(0)
        now += 0.0 if waiting else 101.0
        return {"type": "http.request", "body": piece, "more_body": bool(waiting)}

    async def reply(message: Any) -> None:
        said.append(message)

    inside = Starlette(routes=[Route(PLACE, kept, methods=["POST"])])
    gate = door.WorkbenchDoor(inside, 1, lambda _: None, session=100.0 / 3600.0)
    gate._sessions["known"] = now + 100.0
    scope = {
        "type": "http", "method": "POST", "path": PLACE, "query_string": b"", "root_path": "",
        "headers": [(b"host", b"127.0.0.1:1"), (b"cookie", b"abbe-1=known"),
                    (b"origin", b"http://127.0.0.1:1"), (b"content-type", b"text/csv")],
    }  # fmt: skip
    asyncio.run(asyncio.wait_for(gate(scope, receive, reply), 20.0))
    assert said[0]["status"] == 403
    assert (b"abbe-session", b"none") in said[0]["headers"]
    assert files(tmp_path) == []


def test_a_refused_connection_is_closed(bench: OpenedWorkbench) -> None:
    """Who is refused and goes on sending is not listened to."""
    with socket.create_connection(("127.0.0.1", bench.port), timeout=30) as raw:
        raw.sendall(head(bench, "content-length: 100000", path="/api/add") + b"{" * 70_000)
        said = b""
        while part := raw.recv(4096):
            said += part
        assert b" 413 " in said


async def pieces(*parts: bytes, pause: float = 0.0) -> AsyncIterator[bytes]:
    for part in parts:
        await asyncio.sleep(pause)
        yield part


@pytest.mark.parametrize(("limit", "status"), [("LARGEST", 413), ("PAUSE", 408), ("WITHIN", 408)])
def test_without_end_or_too_slow(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, limit: str, status: int
) -> None:
    monkeypatch.setattr(taken, limit, 100 if limit == "LARGEST" else 0.05)
    sent = pieces(*[b"0.5,x1,displacement\n"] * 50, pause=0.2 if limit == "PAUSE" else 0.01)
    with pytest.raises(HTTPException) as refused:
        asyncio.run(taken.received(sent, tmp_path, "day.csv"))
    assert refused.value.status_code == status
    assert files(tmp_path) == []


def test_nothing_is_written_over(tmp_path: Path) -> None:
    for content, name in ((b"a\n", "day.csv"), (b"b\n", "day-2.csv"), (b"a\n", "day.csv")):
        kept = asyncio.run(taken.received(pieces(content), tmp_path, "day.csv"))
        assert (kept.name, kept.read_bytes()) == (name, content)
    assert files(tmp_path) == ["day-2.csv", "day.csv"]


def test_a_campaign_that_cannot_be_read_does_not_stay(
    bench: OpenedWorkbench, kept: Path, folder: Path, tmp_path: Path
) -> None:
    good = some_setups(BRIDGE / "fit.csv", tmp_path / "good.csv", every=6).read_bytes()
    status, said = send(bench, good, "gut gemessen (Ä).csv")
    assert status == 200
    known = json.loads(said)["id"]
    bench.json(f"{PLACE}/use", {"fitted": [known], "by": "Erika"})
    assert settled(bench)["error"] == ""
    title = bench.json("/api/compare")["title"]
    # one with a damaged row: one sentence, and everything is as before
    status, said = send(bench, good.replace(b"displacement", b"displaced", 1), "bad.csv")
    assert status == 200
    bench.json(f"{PLACE}/use", {"fitted": [json.loads(said)["id"]]})
    assert str(settled(bench)["error"]).startswith("bad.csv, ")
    assert "bad.csv" not in files(kept)
    listed = bench.json(PLACE)["campaigns"]
    assert {c["name"]: c["use"] for c in listed}["gut gemessen (Ä).csv"] == "fitted"
    assert bench.json("/api/compare")["title"] == title
    # what stands for no campaign is none; a path least of all
    for wrong in ("/etc/passwd", "../fit.csv", "", "0" * 16):
        body = json.dumps({"fitted": [wrong]}).encode()
        assert bench.ask("POST", f"{PLACE}/use", body).status == 409
    # everything that changed something has who and when
    journal = [json.loads(line) for line in (folder / "workbench.jsonl").read_bytes().splitlines()]
    last = [entry for entry in journal if entry["what"] == "campaigns"][-1]
    assert last["who"] == "Erika, browser 1"
    assert last["fitted"] == ["gut gemessen (Ä).csv"]
    assert last["time"].startswith("20")
