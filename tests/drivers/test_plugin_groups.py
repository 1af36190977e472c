"""Links and stores by name: found by entry point, one that is broken costs nobody else."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from abbe.compcore import plugins
from abbe.drivers import link
from abbe.drivers.link import PLUGINS, LinkConfigError, link_class
from abbe.drivers.modbus.link import ModbusLink
from abbe.drivers.stores.base import store_class

OWN = EntryPoint("modbus", "abbe.drivers.modbus.link:ModbusLink", link.LINK_GROUP)
OTHER = EntryPoint("modbus", "somebody.else:Link", link.LINK_GROUP)
BROKEN = EntryPoint("broken", "abbe.drivers.nowhere:Link", link.LINK_GROUP)
NO_LINK = EntryPoint("text", "abbe.drivers.link:LINK_GROUP", link.LINK_GROUP)


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [BROKEN, OTHER, OWN, NO_LINK]
    monkeypatch.setattr(
        plugins, "entry_points", lambda group: entries if group == link.LINK_GROUP else []
    )


def test_abbes_own_is_not_replaced_by_another_of_its_name():
    assert link_class("modbus") is ModbusLink
    assert PLUGINS.entries()["modbus"].value == OWN.value


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("broken", "plugin abbe.drivers.nowhere:Link cannot be loaded (ModuleNotFoundError"),
        ("text", "plugin abbe.drivers.link:LINK_GROUP is not a link driver"),
        ("morse", "unknown link driver: found 'morse', expected one of broken, modbus, text"),
    ],
)
def test_what_cannot_be_used_is_named(name: str, words: str):
    with pytest.raises(LinkConfigError) as caught:
        link_class(name)
    assert str(caught.value).startswith(words)


def test_where_nothing_is_installed():
    with pytest.raises(LinkConfigError, match="unknown store: found 'modbus', expected one of non"):
        store_class("modbus")
