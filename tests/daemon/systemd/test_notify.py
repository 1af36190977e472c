"""What the service manager is told, heard on a real datagram socket."""

from __future__ import annotations

import contextlib
import logging
import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.daemon.systemd.journald import JournaldHandler, leads_to_journal
from abbe.daemon.systemd.messages import EVENTS, catalogue, message_id
from abbe.daemon.systemd.notify import Notifier

ROOT = Path(__file__).parents[3]
EVENT = {"name": "abbe.test", "levelno": logging.WARNING}


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(tmp_path / "notify"))
        heard.settimeout(10.0)
        yield heard


def test_what_is_said_arrives(manager: socket.socket) -> None:
    with contextlib.closing(Notifier(manager.getsockname())) as notifier:
        assert notifier.there
        notifier.ready()
        notifier.status("corrected in full;\n3 axes")
        notifier.reloading()
    assert manager.recv(999) == b"READY=1"
    assert manager.recv(999) == b"STATUS=corrected in full; 3 axes"
    assert manager.recv(999).startswith(b"RELOADING=1\nMONOTONIC_USEC=")


def test_an_abstract_socket_too() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(f"\0abbe-test-{id(heard)}")
        heard.settimeout(10.0)
        with contextlib.closing(Notifier(f"@abbe-test-{id(heard)}")) as notifier:
            notifier.stopping()
        assert heard.recv(999) == b"STOPPING=1"


def test_a_manager_that_does_not_listen_stops_nothing(manager: socket.socket) -> None:
    with contextlib.closing(Notifier(manager.getsockname())) as notifier:
        for _ in range(10_000):  # more than its buffer holds
            notifier.alive()
        manager.close()
        notifier.alive()


@pytest.mark.parametrize("address", ["", "/nowhere/at/all", "@" + "x" * 200])
def test_without_a_manager_nobody_is_notified(address: str) -> None:
    notifier = Notifier(address)
    assert not notifier.there
    notifier.ready()


def test_the_watchdog_of_another_process_is_not_ours() -> None:
    mine = {"WATCHDOG_USEC": "10000000"}
    assert Notifier.of_environment(mine).watchdog == 10.0
    assert Notifier.of_environment(mine | {"WATCHDOG_PID": "1"}).watchdog == 0.0
    assert Notifier.of_environment({"WATCHDOG_USEC": "soon"}).watchdog == 0.0


def fields(datagram: bytes) -> dict[str, str]:
    """The journal's native protocol, read as its page describes it."""
    found = {}
    while datagram:
        line, _, rest = datagram.partition(b"\n")
        key, equals, value = line.partition(b"=")
        if not equals:
            size = int.from_bytes(rest[:8], "little")
            value, rest = rest[8 : 8 + size], rest[8 + size + 1 :]
        found[key.decode()] = value.decode()
        datagram = rest
    return found


def test_events_have_their_level_and_what_they_are_about(manager: socket.socket) -> None:
    handler = JournaldHandler(manager.getsockname())
    logger = logging.getLogger("test.journald")
    logger.addHandler(handler)
    logger.propagate = False
    try:
        about = {"AXIS": "X", "link": "plc"}
        logger.warning("X is %s", "stale", extra={"about": about, "event": "fault began"})
        found = fields(manager.recv(9999))
        assert found["MESSAGE"] == "X is stale"
        assert found["PRIORITY"] == "4"
        assert found["AXIS"] == "X"
        assert found["LINK"] == "plc"
        assert found["PART"] == "test.journald"
        assert found["MESSAGE_ID"] == message_id("fault began")
        assert found["SYSLOG_IDENTIFIER"] == "abbe"
        try:
            raise ValueError("over\nthere")
        except ValueError:
            logger.exception("a cycle failed")
        found = fields(manager.recv(9999))
        assert found["PRIORITY"] == "3"
        assert found["MESSAGE"].startswith("a cycle failed\nTraceback")
        assert found["MESSAGE"].endswith("ValueError: over\nthere")
    finally:
        logger.removeHandler(handler)
        handler.close()


@pytest.mark.parametrize(
    ("message", "field", "value"),
    [
        ("link cmm (10.0.0.5:502) lost: no answer; reconnecting", "LINK", "cmm"),
        ("axis X: stale", "AXIS", "X"),
        ("signal T_x1: sound again after 2.0 s", "SIGNAL", "T_x1"),
    ],
)
def test_what_a_message_begins_with_is_a_field(
    manager: socket.socket, message: str, field: str, value: str
) -> None:
    with contextlib.closing(JournaldHandler(manager.getsockname())) as handler:
        handler.emit(logging.makeLogRecord({**EVENT, "msg": message}))
    assert fields(manager.recv(9999))[field] == value


def test_the_guard_names_its_axes(manager: socket.socket) -> None:
    with contextlib.closing(JournaldHandler(manager.getsockname())) as handler:
        record = {**EVENT, "msg": "guard: X, Y: held", "about": {"AXIS": ["X", "Y"]}}
        handler.emit(logging.makeLogRecord(record))
    datagram = manager.recv(9999)
    assert b"AXIS=X\nAXIS=Y\n" in datagram
    assert b"LINK" not in datagram


def test_every_event_that_is_logged_has_its_words_and_is_logged_somewhere() -> None:
    named = {
        name
        for folder in ("daemon", "drivers")
        for file in (ROOT / folder).rglob("*.py")
        for name in re.findall(r'(?:extra=|said = |event = ){"event": "([^"]+)"', file.read_text())
    }
    assert named == set(EVENTS)
    assert len({message_id(event) for event in EVENTS}) == len(EVENTS)


def test_systemd_takes_the_catalogue(tmp_path: Path) -> None:
    (tmp_path / "usr/lib/systemd/catalog").mkdir(parents=True)
    (tmp_path / "usr/lib/systemd/catalog/abbe.catalog").write_text(catalogue())
    (tmp_path / "var/lib/systemd/catalog").mkdir(parents=True)
    program = shutil.which("journalctl")
    assert program, "journalctl is missing: apt install systemd (make test does)"
    command = [program, f"--root={tmp_path}"]
    subprocess.run([*command, "--update-catalog"], check=True, capture_output=True)
    done = subprocess.run(
        [*command, "--dump-catalog", message_id("link lost")],
        check=True,
        capture_output=True,
        text=True,
    )
    assert "A link to a device was lost" in done.stdout


def test_standard_error_that_was_led_elsewhere_is_not_the_journal() -> None:
    assert JournaldHandler.of_environment({}) is None
    assert JournaldHandler.of_environment({"JOURNAL_STREAM": "1:2"}) is None
    assert JournaldHandler.of_environment({"JOURNAL_STREAM": "nonsense"}) is None


def test_a_stream_that_is_the_journal_is_told(tmp_path: Path) -> None:
    with (tmp_path / "stream").open("w") as stream:
        there = (tmp_path / "stream").stat()
        assert leads_to_journal(stream, {"JOURNAL_STREAM": f"{there.st_dev}:{there.st_ino}"})
        assert not leads_to_journal(stream, {"JOURNAL_STREAM": f"{there.st_dev}:0"})
