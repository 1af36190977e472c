"""Sections of an MTConnect link that cannot work are refused; its page tells every key."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from abbe.drivers.link import PLUGINS, LinkProtocolError, link_class
from abbe.drivers.mtconnect.config import (
    MtconnectChannelConfig,
    MtconnectConfig,
    ObservationStamp,
)
from abbe.drivers.mtconnect.documents import document_of
from abbe.drivers.mtconnect.link import MtconnectLink
from abbe.drivers.mtconnect.values import moment
from tests.support.drivers.link_pages import links_in, page
from tests.support.drivers.mtconnect.agent import MillAgent

ROOT = Path(__file__).parents[3]
DOC = page("mtconnect")
GOOD: dict[str, Any] = {
    "url": "http://192.168.0.40",
    "channels": {"x": {"data": "Xact", "unit": "mm"}},
}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"url": "https://192.168.0.40"}, "http://HOST:PORT"),
        ({"url": "http://"}, "http://HOST:PORT"),
        ({"url": "http://h:99999"}, "99999"),
        ({"url": "http://me:secret@h"}, "no user"),
        ({"url": "http://h/a?path=b"}, "no user, question"),
        ({"url": "http://h/a b"}, "printed ASCII"),
        ({"url": "http://h/\r\nX: y"}, "printed ASCII"),
        ({"channels": {}}, "channels"),
        ({"channels": {"x": {"data": ""}}}, "expected the id"),
        ({"channels": {"x": {"data": 'a" or "1"="1'}}}, "expected the id"),
        ({"channels": {"x": {"data": "Xact", "item": 0}}}, "item"),
        ({"channels": {"x": {"data": "Xact", "scale": 0.0}}}, "scale is 0"),
        ({"channels": {"x": {"data": "Xact", "evry": 1}}}, "evry"),
        ({"timeout": 0}, "timeout"),
        ({"reconnect_max": 0.1}, "below reconnect_min"),
        ({"stamp": "source"}, "stamp"),
    ],
)
def test_what_cannot_work(changed: dict[str, Any], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        MtconnectConfig.model_validate(GOOD | changed)


def test_two_names_of_one_data_item_are_one_place() -> None:
    channels = {"a": {"data": "X"}, "b": {"data": "X"}, "c": {"data": "Y"}}
    link = MtconnectLink("mill", MtconnectConfig.model_validate(GOOD | {"channels": channels}))
    (a,), (b,), (c,) = (link.places(name) for name in "abc")
    assert a.overlaps(b)
    assert not a.overlaps(c)
    assert a.device == "tcp 192.168.0.40:5000"
    assert not link.info("a").writable


def test_the_page_s_examples_work_and_it_tells_every_key() -> None:
    ((_, section),) = links_in(DOC)
    assert link_class(section.pop("driver")) is MtconnectLink
    link = MtconnectLink("control", MtconnectConfig.model_validate(section))
    assert all(link.info(channel).unit for channel in link.channels)
    assert PLUGINS.entries()["mtconnect"].value == "abbe.drivers.mtconnect.link:MtconnectLink"
    assert "docs/mtconnect.md" in (ROOT / "README.md").read_text(encoding="utf-8")
    for key in (*MtconnectConfig.model_fields, *MtconnectChannelConfig.model_fields):
        assert key == "channels" or f"`{key}`" in DOC, key
    for name in get_args(ObservationStamp):
        assert f'`"{name}"`' in DOC
    config = MtconnectConfig.model_validate(GOOD)
    for key in ("timeout", "every", "stamp", "units", "select", "max_waiting"):
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{key}`"))
        value = getattr(config, key)
        wanted = f'`"{value}"`' if isinstance(value, str) else f"{value:g}"
        wanted = str(value).lower() if isinstance(value, bool) else wanted
        assert row.split("|")[2].strip() in (wanted, f"{wanted} s"), key
    assert (config.reconnect_min, config.reconnect_max, config.port) == (0.5, 10.0, 5000)


@pytest.mark.parametrize(
    ("text", "second", "later"),
    [
        ("2026-03-01T10:00:07Z", 7.0, 1.0),
        ("2026-03-01T10:00:07.5Z", 7.5, 0.1),
        ("2026-03-01T10:00:07.123456789Z", 7.123456, 1e-9),
        ("2026-03-01T12:00:07.5+02:00", 7.5, 0.1),
        ("2026-03-01T10:00:07", 7.0, 1.0),
    ],
)
def test_time_stamps(text: str, second: float, later: float) -> None:
    found, uncertain = moment(text)
    assert (found.hour, found.minute) == (10, 0)
    assert found.second + 1e-6 * found.microsecond == pytest.approx(second)
    assert uncertain == pytest.approx(later)


@pytest.mark.parametrize("text", ["", "now", "2026-13-01T10:00:00Z", "2026-03-01", "9" * 9999])
def test_what_is_no_time_stamp(text: str) -> None:
    with pytest.raises(LinkProtocolError, match="time stamp"):
        moment(text)


@given(st.data())
async def test_no_damage_to_a_document_is_a_traceback(data: st.DataObject) -> None:
    agent = MillAgent()
    raw = bytearray(agent.streams(one[2] for one in agent.kept).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(raw) - 1))
        raw[at : at + data.draw(st.integers(0, 30))] = data.draw(st.binary(max_size=8))
    said, found = "", None
    try:
        found = await document_of(bytes(raw), frozenset(("Xact",)))
    except LinkProtocolError as error:
        said = str(error)
    assert found.root.startswith("MTConnect") if found else 0 < len(said) < 400
