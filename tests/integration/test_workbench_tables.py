"""Tables in the workbench, by clicking, against a simulated control that is asked what it has."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from abbe.daemon.config.tokens import add_token
from tests.support.daemon.browser import WIDTHS, assert_for_everybody, assert_quiet, chromium, visit
from tests.support.daemon.paper import assert_on_paper
from tests.support.daemon.upload_cases import Place, patient_place, sums
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    """A mill, its tables ``old`` (active) and ``new``, and a control."""
    with patient_place(tmp_path) as here:
        yield here


def token(place: Place, name: str, role: str) -> str:
    return add_token(place.folder / "http-tokens.toml", name, role)  # type: ignore[arg-type]


def ended(page: Page, kind: str, how: str) -> None:
    page.wait_for_selector(f'#said[data-kind={kind}][data-ended="{how}"]')


def write(page: Page, machine: str, secret: str) -> None:
    page.fill("#write-machine", machine)
    page.fill("#write-token", secret)
    page.fill("#write-by", "A. Vogel")
    page.fill("#write-note", "after the scale was changed")
    page.click("#write")


@pytest.mark.thorough
def test_looked_at_then_written_then_rolled_back(place: Place) -> None:
    operates, looks = token(place, "cell-3", "operate"), token(place, "visitor", "view")
    record = json.loads((place.folder / "new" / "abbe-tables.json").read_text())
    with chromium() as browser, opened(place.config, "--tables", place.folder / "new") as bench:
        seen = visit(browser, bench, until=".tables[data-ready]")
        page = seen.page
        # what the controller will hold, and what remains: the figures of the record
        left = record["remaining"]["csv"]["max"]
        expect(page.locator("h1")).to_contain_text(f"With these tables {left:.2g} µm are left of")
        for name in record["files"]:
            expect(page.locator("main")).to_contain_text(record["files"][name])
        page.wait_for_selector(".plot .scatterlayer path")
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_function(
                "width => document.documentElement.scrollWidth <= width", arg=width
            )
        page.set_viewport_size({"width": 1280, "height": 900})
        assert_on_paper(page, place.folder, 6)
        # nothing can be written before it was looked at
        assert page.locator("#write").count() == 0
        page.locator("#controller button").first.click()
        ended(page, "preflight", "good")
        expect(page.locator("#said")).to_contain_text("the correction changes by at most")
        assert place.truth()["active"] == sums(place.folder / "old")
        assert_for_everybody(page)
        # without the role, with another role, with another machine's name: refused
        for machine, secret, why in (
            ("mill", "", "a token of the role operate"),
            ("mill", looks, "a token of the role operate"),
            ("mill", operates + "x", "a token of the role operate"),
            ("lathe", operates, "another machine: nothing was written"),
        ):
            write(page, machine, secret)
            expect(page.locator("#said [role=alert]")).to_contain_text(why)
            assert page.input_value("#write-token") == ""
            assert place.entries() == []
        write(page, "mill", operates)
        ended(page, "write", "good")
        expect(page.locator("#said")).to_contain_text("is active, verified by reading it back")
        assert place.truth()["active"] == sums(place.folder / "new")
        # who and when stand in the journal of `abbe upload`, and on the page
        first = place.entries()[0]
        assert first["who"] == "A. Vogel, token cell-3 at 127.0.0.1"
        assert first["note"] == "after the scale was changed"
        expect(page.locator("#journal tbody tr")).to_have_count(1)
        expect(page.locator("#journal")).to_contain_text("A. Vogel, token cell-3")
        # and back
        page.locator("#controller button", has_text="Roll back").click()
        ended(page, "preflight", "good")
        write(page, " mill ", operates)
        ended(page, "write", "good")
        assert place.truth()["active"] == sums(place.folder / "old")
        page.locator("#controller button", has_text="What is active").click()
        ended(page, "status", "good")
        expect(page.locator("#said")).to_contain_text("idle, referenced")
        seen.errors[:] = [e for e in seen.errors if "403" not in e and "409" not in e]
        assert_quiet(seen, bench)


def settled(bench: OpenedWorkbench) -> dict[str, object]:
    """The desk once nothing is under way."""
    while True:
        state = bench.json("/api/tables/state")
        if state["work"] is None or state["work"]["ended"]:
            return dict(state)


def test_what_speaks_against_it_is_said_and_nothing_is_written(place: Place) -> None:
    operates = token(place, "cell-3", "operate")
    bearer = {"authorization": f"Bearer {operates}"}
    with opened(place.config, "--tables", place.folder / "new") as bench:
        bench.enter()

        def wanted(count: int) -> bytes:
            return json.dumps({"cleared": count, "machine": "mill"}).encode()

        def preflight() -> dict[str, object]:
            bench.json("/api/tables/preflight", {"change": "upload"})
            return settled(bench)

        assert bench.ask("POST", "/api/tables/write", wanted(1), **bearer).status == 409
        # a machine that moves
        place.control.order("machine", idle=False)
        state = preflight()
        assert state["cleared"] is None
        assert "the machine is not idle" in str(state["work"])
        place.control.order("machine", idle=True)
        # a change that is larger than allowed
        text = place.config.read_text()
        place.config.write_text(text.replace("max_change_um = 120.0", "max_change_um = 0.5"))
        state = preflight()
        assert state["cleared"] is None
        assert "upload.max_change_um allows 0.5" in str(state["work"])
        place.config.write_text(text)
        # what was looked at is not there any more: other tables, another state of the control
        state = preflight()
        count = state["cleared"]
        assert isinstance(count, int)
        place.control.order("load", files={})
        assert bench.ask("POST", "/api/tables/write", wanted(count + 1), **bearer).status == 409
        # no page of the internet can have it done, token or not
        foreign = bearer | {"origin": "http://evil.example"}
        assert bench.ask("POST", "/api/tables/write", wanted(count), **foreign).status == 403
        assert bench.ask("POST", "/api/tables/write", wanted(count), **bearer).status == 200
        state = settled(bench)
        assert "are not what they were at the pre-flight" in str(state["work"])
        # it counted once
        assert bench.ask("POST", "/api/tables/write", wanted(count), **bearer).status == 409
        assert place.truth()["active"] == {}
        assert place.entries() == []


@pytest.mark.thorough
def test_an_upload_that_fails_ends_with_the_old_table(place: Place) -> None:
    """The control adds something else than the table says: the old one is put back."""
    operates = token(place, "cell-3", "operate")
    place.control.order("fault", kind="lies", at="show", times=100)
    with opened(place.config, "--tables", place.folder / "new") as bench:
        bench.enter()
        bench.json("/api/tables/preflight", {"change": "upload"})
        count = settled(bench)["cleared"]
        body = json.dumps({"cleared": count, "machine": "mill"}).encode()
        sent = bench.ask("POST", "/api/tables/write", body, authorization=f"Bearer {operates}")
        assert sent.status == 200
        # ended in the middle of it: it is waited for
        bench.process.terminate()
        assert bench.process.wait(60) == 0
    assert place.truth()["active"] == sums(place.folder / "old")
    assert place.entries()[-1]["active"] == "old"
