"""The read-outs of docs/measure.md, asked as their makers' manuals say, and answering so."""

from __future__ import annotations

import asyncio
import tomllib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from abbe.drivers.link import Quality, Sample
from abbe.drivers.serial.config import SerialConfig
from abbe.drivers.serial.link import SerialLink
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from tests.support.drivers.link_pages import page

TEXT = page("measure").partition("### Read-outs")[2].partition("```toml\n")[2].partition("```")[0]
LINKS: dict[str, dict[str, Any]] = tomllib.loads(TEXT)["links"]


@asynccontextmanager
async def device(link: Path, asked: bytes, answer: Callable[[], bytes]) -> AsyncIterator[PtyPort]:
    """A device that answers to its query and to nothing else; without one it sends by itself."""
    held = bytearray()

    def receive(data: bytes) -> None:
        held.extend(data)
        if asked and bytes(held) == asked:
            held.clear()
            port.send(answer())

    async def stream() -> None:
        while not asked:
            port.send(answer())
            await asyncio.sleep(0.05)

    port = PtyPort(link, receive)
    port.plug()
    streaming = asyncio.ensure_future(stream())
    try:
        yield port
    finally:
        streaming.cancel()
        port.unplug()


async def read(name: str, folder: Path, asked: bytes, answer: bytes) -> Sample:
    section = {k: v for k, v in LINKS[name].items() if k != "driver"}
    channel = next(iter(section["channels"]))
    # a pseudo-terminal has eight bits and no parity
    section |= {"port": str(folder / "device"), "timeout": 2.0, "bytesize": 8, "parity": "N"}
    link = SerialLink(name, SerialConfig.model_validate(section))
    async with device(folder / "device", asked, lambda: answer):
        await link.open()
        try:
            for _ in range(100):
                found = (await link.read([channel]))[channel]
                if found.good or found.quality is Quality.BAD:
                    return found
                await asyncio.sleep(0.05)
            return found
        finally:
            await link.close()


@pytest.mark.parametrize(
    ("name", "asked", "answer", "value"),
    [
        ("mahr", b"?\r", b"-0.123mm\r\n", -0.123),
        ("mahr", b"?\r", b"+12.0045 mm\r\n", 12.0045),
        ("sylvac", b"?\r", b"+12.345\r", 12.345),
        ("sylvac", b"?\r", b" 0.012\r", 0.012),
        ("mitutoyo", b"", b"01A+0000.123\r", 0.123),
        ("mitutoyo", b"", b"01A-0012.305\r", -12.305),
        ("nd280", b"\x02", b"+     5841.2907  R\r\n", 5841.2907),
        ("nd280", b"\x02", b"-12345.6789\r\n", -12345.6789),
    ],
)
async def test_the_number_that_it_shows_comes_through(
    tmp_path: Path, name: str, asked: bytes, answer: bytes, value: float
) -> None:
    found = await read(name, tmp_path, asked, answer)
    assert found.good, found.reason
    assert found.value == pytest.approx(value, abs=1e-12)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("name", "asked", "answer"),
    [
        ("mahr", b"?\r", b"0.1234in\r\n"),
        ("mahr", b"?\r", b"123.4um\r\n"),
        ("sylvac", b"?\r", b"ERR0\r"),
        ("nd280", b"\x02", b'+  230.1234"  R\r\n'),
        ("mitutoyo", b"", b"911\r"),
    ],
)
async def test_inches_and_errors_are_no_number(
    tmp_path: Path, name: str, asked: bytes, answer: bytes
) -> None:
    found = await read(name, tmp_path, asked, answer)
    assert not found.good


def test_all_of_the_page_are_tried() -> None:
    assert set(LINKS) == {"mahr", "sylvac", "mitutoyo", "nd280"}
