"""Sections of an OPC UA link that cannot work are refused before anything is connected."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from abbe.drivers.link import LinkConfigError
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.link import OpcuaLink
from abbe.drivers.opcua.nodes import node_name
from abbe.drivers.opcua.units import NAMESPACE, contradicts, number_of, stated

GOOD: dict[str, Any] = {
    "url": "opc.tcp://192.168.0.30",
    "channels": {"x": {"node": "ns=2;s=X", "unit": "mm"}},
}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"url": "http://192.168.0.30"}, "opc.tcp://HOST:PORT"),
        ({"url": "opc.tcp://"}, "opc.tcp://HOST:PORT"),
        ({"url": "opc.tcp://h:99999"}, "99999"),
        ({"url": "opc.tcp://me:secret@h"}, "keys of their own"),
        ({"channels": {}}, "channels"),
        ({"channels": {"x": {"node": "X"}}}, "expected a node id such as"),
        ({"channels": {"x": {"node": "ns=70000;s=X"}}}, "expected a node id"),
        ({"channels": {"x": {"node": "i=4294967296"}}}, "expected a node id"),
        ({"channels": {"x": {"node": "ns=2;s=X", "item": 0}}}, "item"),
        ({"channels": {"x": {"node": "ns=2;s=X", "scale": 0.0}}}, "scale is 0"),
        ({"channels": {"x": {"node": "ns=2;s=X", "evry": 1}}}, "evry"),
        ({"security": "sign"}, "certificate and private_key and server_certificate"),
        ({"certificate": "a.pem"}, "only with security"),
        ({"user": "me"}, "go together"),
        ({"timeout": 0}, "timeout"),
        ({"reconnect_max": 0.1}, "below reconnect_min"),
        ({"stamp": "mine"}, "stamp"),
        ({"subscribe": -0.1}, "subscribe"),
        ({"subscribe": 0.1, "stamp": "server"}, "with stamp = 'source' or 'none' only"),
    ],
)
def test_what_cannot_work(changed: dict[str, Any], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        OpcuaConfig.model_validate(GOOD | changed)


def test_two_names_of_one_variable_are_one_place() -> None:
    config = OpcuaConfig.model_validate(
        GOOD
        | {
            "channels": {
                "a": {"node": "ns=2;s=X"}, "b": {"node": "ns=2;s=X"}, "c": {"node": "ns=2;s=Y"},
            }
        }
    )  # fmt: skip
    link = OpcuaLink("mill", config)
    (a,), (b,), (c,) = (link.places(name) for name in "abc")
    assert a.overlaps(b)
    assert not a.overlaps(c)
    assert a.device == "tcp 192.168.0.30:4840"
    assert not link.info("a").writable


def test_what_is_notified_of_is_not_of_one_answer() -> None:
    link = OpcuaLink("mill", OpcuaConfig.model_validate(GOOD | {"subscribe": 0.1}))
    link.keep_together(("x",))
    with pytest.raises(LinkConfigError, match="leave subscribe away"):
        link.keep_together(("x",), one_sample=True)
    assert link.info("x").every == 0.1


@given(st.text(max_size=40))
def test_no_text_breaks_the_reader_of_node_ids(text: str) -> None:
    try:
        found = node_name(text)
    except ValueError as error:
        said = str(error)
    else:
        said = found.numbered(["", found.uri])
        assert said.endswith(found.rest)
    assert "expected a node id" in said or said.endswith(text.rpartition(";")[2])


@pytest.mark.parametrize(
    ("unit", "number", "other"),
    # figures of OPC UA's own list of units, UNECE_to_OPCUA.csv
    [("mm", 5066068, True), ("degC", 4408652, True), ("degF", 4604232, True), ("um", 13384, True)],
)
def test_units_by_their_published_numbers(unit: str, number: int, other: bool) -> None:
    assert stated(number, NAMESPACE, "") == unit
    assert not contradicts(unit, number, NAMESPACE)
    assert contradicts(unit, number_of("INH"), NAMESPACE) is other
    # of another list, or none: nothing is known
    assert not contradicts(unit, number_of("INH"), "urn:maker")
    assert not contradicts(unit, 0, NAMESPACE)
    assert not contradicts("divisions", number, NAMESPACE)
