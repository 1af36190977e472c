"""What the service manager is told, heard on a real datagram socket."""

from __future__ import annotations

import contextlib
import logging
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.daemon.systemd.journald import JournaldHandler
from abbe.daemon.systemd.notify import Notifier


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
        logger.warning("X is %s", "stale", extra={"about": {"AXIS": "X", "link": "plc"}})
        found = fields(manager.recv(9999))
        assert found["MESSAGE"] == "X is stale"
        assert found["PRIORITY"] == "4"
        assert found["ABBE_AXIS"] == "X"
        assert found["ABBE_LINK"] == "plc"
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


def test_standard_error_that_was_led_elsewhere_is_not_the_journal() -> None:
    assert JournaldHandler.of_environment({}) is None
    assert JournaldHandler.of_environment({"JOURNAL_STREAM": "1:2"}) is None
    assert JournaldHandler.of_environment({"JOURNAL_STREAM": "nonsense"}) is None
