"""Who gets into the workbench: one person's browser, by the address that was printed, once."""

from __future__ import annotations

import re
import signal
import socket
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from http.cookies import SimpleCookie
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from fastapi.routing import APIRoute
from starlette.responses import PlainTextResponse

from abbe.daemon.workbench.entrance.door import WorkbenchDoor
from abbe.daemon.workbench.page_files import page_files
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

BRIDGE = Path(__file__).parents[2] / "data" / "p03-bridge"
CHANGES = ("/api/compare", "/api/learn", "/api/fit", "/api/add", "/api/back", "/api/try",
           "/api/brush",
           "/api/here", "/api/end")  # fmt: skip
FILES = next(
    route.path.removesuffix("/main.js")
    for route in page_files().routes
    if isinstance(route, APIRoute) and route.path.endswith("/main.js")
)
"""What all files of the page stand below."""
LOOKS = ("/", f"{FILES}/main.js", f"{FILES}/plotly.min.js", f"{FILES}/uplot/uplot.min.js",
         "/report/report.html", "/api/state", "/api/head", "/api/compare",
         "/api/watch")  # fmt: skip


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenedWorkbench]:
    campaign = some_setups(
        BRIDGE / "fit.csv", tmp_path_factory.mktemp("door") / "some.csv", every=6
    )
    with opened(BRIDGE / "model.toml", campaign) as found:
        found.enter()
        yield found


def test_a_browser_that_has_not_entered_sees_nothing(bench: OpenedWorkbench) -> None:
    for cookie in (None, "abbe-1=x", f"abbe-{bench.port}=", f"abbe-{bench.port}=wrong", '=;;="'):
        for path in LOOKS:
            answered = bench.ask("GET", path, cookie=cookie)
            assert answered.status == 403
            assert b"held-out" not in answered.body
        for path in CHANGES:
            assert bench.ask("POST", path, b"{}", cookie=cookie).status == 403
    assert [bench.ask("GET", path).status for path in LOOKS] == [200] * len(LOOKS)


def test_cookies_of_other_programs_shut_nobody_out(bench: OpenedWorkbench) -> None:
    """A browser sends one cookie to all ports of this computer."""
    for other in ('seen={"a": [1, 2]}', "a b=c d; @; [x]=1", 'n\xe9="\xfc', "expires=Mon; path=/"):
        for cookie in (f"{other}; {bench.cookie}", f"{bench.cookie}; {other}"):
            assert bench.ask("GET", "/api/state", cookie=cookie).status == 200, cookie
        assert bench.ask("GET", "/api/state", cookie=other).status == 403


def test_the_printed_address_counts_once_and_its_cookie_stays_here(
    bench: OpenedWorkbench,
) -> None:
    parts = urlsplit(bench.address)
    assert bench.ask("GET", f"{parts.path}?{parts.query}", cookie=None).status == 403
    assert bench.ask("GET", "/enter", cookie=None).status == 403
    assert bench.ask("GET", "/enter?key=", cookie=None).status == 403
    assert bench.process.stdout is not None
    assert bench.process.stdout.readline() == "Ctrl-C ends it.\n"
    for _ in range(2):
        again = bench.process.stdout.readline().split()[-1]
        entered = bench.ask("GET", f"/enter?{urlsplit(again).query}", cookie=None)
        assert entered.status == 303
        (morsel,) = SimpleCookie(entered.headers["set-cookie"]).values()
        assert morsel["httponly"]
        assert morsel["samesite"] == "strict"
        assert not morsel["domain"]


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:{}", "[::1]:{}", None],
)
def test_a_foreign_name_that_points_here_is_no_way_in(
    bench: OpenedWorkbench, host: str | None
) -> None:
    name = None if host is None else host.format(bench.port)
    assert bench.ask("GET", "/api/state", host=name).status in (400, 421)
    assert bench.ask("GET", "/api/state", host=f"localhost:{bench.port}").status == 200


def test_only_a_page_of_the_workbench_changes_anything(bench: OpenedWorkbench) -> None:
    before = bench.json("/api/state")["changes"]
    port = bench.port
    for origin in (None, "null", "http://evil.example", "http://127.0.0.1:1",
                   f"https://127.0.0.1:{port}", f"http://localhost:{port}"):  # fmt: skip
        for path in CHANGES:
            assert bench.ask("POST", path, b"{}", origin=origin).status == 403
    for kind in (None, "text/plain", "application/x-www-form-urlencoded"):
        assert bench.ask("POST", "/api/learn", b"{}", content_type=kind).status == 403
    for method in ("PUT", "DELETE", "OPTIONS", "PATCH"):
        assert bench.ask(method, "/api/state").status == 405
    for path in CHANGES:
        assert bench.ask("GET", path).status in (200, 405)  # what is looked at has the same name
    assert bench.json("/api/state")["changes"] == before


def test_no_path_leads_out_of_its_files(bench: OpenedWorkbench) -> None:
    for path in ("/../session.py", "/static/main.js", "/%2e%2e/session.py", "/..%2f..%2fserve.py",
                 "//etc/passwd", "/etc/passwd", f"{FILES}/main.js/../../door.py",
                 f"{FILES}/main.js%00.py", FILES, f"{FILES}/shared/", f"{FILES}/words/", "/main.js",
                 f"{FILES}/..%2f..%2f..%2fsession.py",
                 "/docs", "/openapi.json", "/redoc"):  # fmt: skip
        answered = bench.ask("GET", path)
        assert answered.status in (400, 404), path
        assert b"import" not in answered.body


@pytest.mark.parametrize("whole", [True, False])
def test_a_body_that_does_not_end_is_refused(bench: OpenedWorkbench, whole: bool) -> None:
    body = b'{"spec": "' + b"x" * 70_000 + b'"}'
    if whole:
        answered = bench.ask("POST", "/api/try", body)
    else:
        chunked = b"%x\r\n%s\r\n0\r\n\r\n" % (len(body), body)
        answered = bench.ask(
            "POST", "/api/try", chunked, content_length=None, transfer_encoding="chunked"
        )
    assert answered.status == 413


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/api/try", b""),
        ("/api/try", b"{"),
        ("/api/try", b"[]"),
        ("/api/try", b'{"spec": 3}'),
        ("/api/try", b'{"spec": "backlash axis=Z", "values": {"b": "x"}}'),
        ("/api/try", b'{"spec": "backlash axis=Z", "values": {"b": NaN}}'),
        ("/api/add", b'{"spec": ""}'),
        ("/api/add", b'{"spec": "backlash axis=Z", "more": 1}'),
        ("/api/back", b'{"version": "../x"}'),
    ],
)
def test_what_is_no_request_is_said_so(bench: OpenedWorkbench, path: str, body: bytes) -> None:
    answered = bench.ask("POST", path, body)
    assert answered.status == 422
    assert answered.body.startswith(b'{"detail":')


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/api/add", b'{"spec": "backlash axis=Q"}'),
        ("/api/add", b'{"spec": "nonsense"}'),
        ("/api/add", b'{"spec": "backlash Z"}'),
        ("/api/add", b'{"spec": "backlash axis=Z"}'),  # no folder was stated
        ("/api/fit", b"{}"),
        ("/api/back", b'{"version": 7}'),
        ("/api/back", b'{"version": -1}'),
    ],
)
def test_what_cannot_be_is_one_sentence(bench: OpenedWorkbench, path: str, body: bytes) -> None:
    answered = bench.ask("POST", path, body)
    assert answered.status == 409
    assert b"Traceback" not in answered.body


def test_what_is_tried_before_the_diagnosis_is_not_known(bench: OpenedWorkbench) -> None:
    """As what a window asks for that has just added a cause: no mistake, so nothing is refused."""
    answered = bench.ask("POST", "/api/try", b'{"spec": "backlash axis=Z"}')
    assert (answered.status, answered.body) == (200, b"null")


def test_every_answer_forbids_what_is_not_from_here(bench: OpenedWorkbench) -> None:
    for path, cookie in (*((p, bench.cookie) for p in LOOKS), ("/", None), ("/nothing", None)):
        answered = bench.ask("GET", path, cookie=cookie)
        policy = str(answered.headers.get("content-security-policy"))
        rules = dict(rule.strip().partition(" ")[::2] for rule in policy.split(";"))
        assert rules["default-src"] == "'none'"
        assert rules["script-src"] == rules["connect-src"] == "'self'"
        assert rules["frame-ancestors"] == "'none'"
        assert answered.headers.get("x-content-type-options") == "nosniff"
        assert answered.headers.get("cross-origin-resource-policy") == "same-origin"
    page = bench.ask("GET", "/").body.decode()
    assert "<script>" not in page
    assert "style=" not in page


def test_what_a_browser_keeps_has_another_address_in_another_abbe(bench: OpenedWorkbench) -> None:
    """Files stand below a word that is made of them; nothing else is kept without asking."""
    for path in LOOKS:
        kept = bench.ask("GET", path).headers.get("cache-control", "")
        assert ("immutable" in kept) == path.startswith(FILES), path
        assert "immutable" in kept or "no-" in kept, path
    page = bench.ask("GET", "/").body.decode()
    named = re.findall(r'(?:href|src)="([^"]+)"', page)
    assert len(named) > 20
    for path in named:
        assert path.startswith(f"{FILES}/"), path
        assert bench.ask("GET", path).status == 200, path


@pytest.mark.parametrize("path", ["/api/live", "/api/state", "/"])
@pytest.mark.parametrize("origin", ["http://127.0.0.1:1", "https://example.org", "null"])
def test_a_page_of_another_port_is_not_answered(
    bench: OpenedWorkbench, path: str, origin: str
) -> None:
    """It is the same site to a browser, which sends the cookie along."""
    assert bench.ask("GET", path, origin=origin).status == 403
    assert bench.ask("GET", "/api/state", origin=bench.origin).status == 200


def test_it_listens_on_this_computer_alone(bench: OpenedWorkbench) -> None:
    for host in ("127.0.0.2", socket.gethostbyname(socket.gethostname())):
        if host != "127.0.0.1":
            with socket.socket() as other:
                other.settimeout(10.0)
                assert other.connect_ex((host, bench.port)) != 0


async def test_a_session_lasts_while_somebody_does_something(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 1e6
    monkeypatch.setattr("abbe.daemon.workbench.entrance.door.time.monotonic", lambda: now)
    addresses: list[str] = []
    door = WorkbenchDoor(PlainTextResponse("inside"), 8471, addresses.append, session=2.0)
    origin = "http://127.0.0.1:8471"
    async with httpx.AsyncClient(transport=httpx.ASGITransport(door), base_url=origin) as client:

        async def looks() -> int:
            return (await client.get("/api/state")).status_code

        assert await looks() == 403
        await client.get(addresses[-1])
        assert await looks() == 200
        now += 7100.0
        assert await looks() == 200
        # looking is what a page does by itself: the session ends all the same
        now += 200.0
        assert await looks() == 403
        assert await looks() == 403
        await client.get(addresses[-1])
        for _ in range(3):
            now += 7100.0
            done = await client.post("/api/here", json={}, headers={"origin": origin})
            assert done.status_code == 200
        assert await looks() == 200
        now += 7300.0
        done = await client.post("/api/here", json={}, headers={"origin": origin})
        assert done.status_code == 403


def test_a_stream_ends_with_its_session(tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=12)
    with opened(BRIDGE / "model.toml", campaign, "--session", "0.001") as found:
        found.enter()
        # whether anything runs here or not, it says something every few seconds, until it ends
        assert found.ask("GET", "/api/live/stream").status == 200
        assert found.ask("GET", "/api/state").status == 403


@pytest.mark.thorough
def test_ctrl_c_ends_it_while_somebody_looks(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A live view is open: its stream ends, and nothing is complained of."""
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=12)
    with opened(BRIDGE / "model.toml", campaign) as found:
        found.enter()
        with closing(HTTPConnection("127.0.0.1", found.port, timeout=60)) as looking:
            looking.request("GET", "/api/live/stream", headers={"cookie": found.cookie})
            stream = looking.getresponse()
            assert stream.status == 200
            found.process.send_signal(signal.SIGINT)
            stream.read()
        assert found.process.wait(60) == 0
    assert capfd.readouterr().err == ""


@pytest.mark.thorough
def test_ctrl_c_and_the_button_end_it(tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=12)
    for by_button in (False, True):
        with opened(BRIDGE / "model.toml", campaign) as found:
            found.enter()
            if by_button:
                assert found.json("/api/end", {}) == {}
            else:
                found.process.send_signal(signal.SIGINT)
            assert found.process.wait(60) == 0
            assert found.process.stdout is not None
            assert found.process.stdout.read().endswith("The workbench is closed.\n")
