"""The machine's objects and variables in the server's address space, kept as the run says."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from asyncua import Server, ua
from asyncua.common.events import Event
from asyncua.common.node import Node

from abbe.daemon.opcua_server.values import SILENT, OfferedValue
from abbe.drivers.opcua import units

NAMESPACE = "urn:abbe-metrology:machine"
"""Of everything that is Abbe's; the standard's own types and names are in theirs."""
_TYPES = {
    "Double": ua.VariantType.Double,
    "Boolean": ua.VariantType.Boolean,
    "String": ua.VariantType.String,
    "Int64": ua.VariantType.Int64,
}
_BAD = 0x80000000
_MOST = 10_000
"""Variables; a run has some dozens."""


class MachineSpace:
    """One machine below ``Objects/Machines``.

    Parameters
    ----------
    server
        Initialised, not yet started.
    machine
        The machine's name.
    """

    def __init__(self, server: Server, machine: str) -> None:
        self._server, self._machine = server, machine
        self._index = 0
        self._objects: dict[tuple[str, ...], Node] = {}
        self._variables: dict[tuple[str, ...], ua.NodeId] = {}
        self._last: dict[tuple[str, ...], ua.DataValue] = {}
        self._events: Any = None
        self._silent = False

    async def make(self) -> None:
        """Make what is there before the run has said anything."""
        self._index = await self._server.register_namespace(NAMESPACE)
        node = ua.NodeId("Machines", self._index)
        machines = await self._server.nodes.objects.add_folder(node, self._name("Machines"))
        node = ua.NodeId(self._machine, self._index)
        self._objects[()] = await machines.add_object(node, self._name(self._machine))
        self._events = await self._server.get_event_generator()
        self._events.event.SourceName = self._machine
        self._events.event.SourceNode = node
        for name in ("Text", "Level", "Part"):
            path = ("Notification", "LastMessage", name)
            await self._show(OfferedValue(path, "String", None, "BadWaitingForInitialData", _now()))

    async def show(self, shown: Iterable[OfferedValue]) -> None:
        """Show a run's status; what it has no more keeps its last value, as old."""
        self._silent = False
        seen = set()
        for one in shown:
            seen.add(one.path)
            await self._show(one)
        gone = [p for p in self._variables if p not in seen and p[0] != "Notification"]
        for path in gone:
            await self._age(path)

    async def fall_silent(self) -> None:
        """The run says nothing any more: its last words stay, and say so."""
        if not self._silent:
            self._silent = True
            for path in self._variables:
                await self._age(path)

    async def tell(self, event: Mapping[str, Any]) -> None:
        """Notify of one event of the journal, and keep it as the last one."""
        at = datetime.fromisoformat(event["at"])
        text = str(event["text"])[:2000].encode("utf-8", "replace").decode("utf-8")
        for name, value in (("Text", text), ("Level", event["level"]), ("Part", event["part"])):
            await self._show(
                OfferedValue(("Notification", "LastMessage", name), "String", value, "Good", at)
            )
        told: Event = self._events.event
        told.Severity = _severity(event["level"])
        told.Time = at.astimezone(UTC)
        await self._events.trigger(message=text)

    async def _show(self, one: OfferedValue) -> None:
        node = self._variables.get(one.path)
        if node is None:
            if len(self._variables) >= _MOST:
                return
            node = await self._add(one)
        code = getattr(ua.StatusCodes, one.status)
        value = ua.Variant(None) if one.value is None else ua.Variant(one.value, _TYPES[one.kind])
        await self._write(one.path, ua.DataValue(value, ua.StatusCode(code), one.at))

    async def _age(self, path: tuple[str, ...]) -> None:
        last = self._last[path]
        if last.StatusCode is not None and last.StatusCode.value < _BAD:
            code = ua.StatusCode(getattr(ua.StatusCodes, SILENT))
            await self._write(path, ua.DataValue(last.Value, code, last.SourceTimestamp))

    async def _write(self, path: tuple[str, ...], value: ua.DataValue) -> None:
        # the standard has UTC, without saying so
        source = value.SourceTimestamp or _now()
        stamped = ua.DataValue(value.Value, value.StatusCode, source.astimezone(UTC), _now())
        self._last[path] = stamped
        await self._server.write_attribute_value(self._variables[path], stamped)

    async def _add(self, one: OfferedValue) -> ua.NodeId:
        parent = await self._object(one.path[:-1])
        node = self._id(one.path)
        kind = _TYPES[one.kind]
        empty: Any = {"Double": 0.0, "Boolean": False, "String": "", "Int64": 0}[one.kind]
        variable = await parent.add_variable(node, self._name(one.path[-1]), empty, kind)
        if one.unit:
            await self._add_unit(variable, one.unit)
        self._variables[one.path] = node
        return node

    async def _add_unit(self, variable: Node, unit: str) -> None:
        number = units.number_for(unit)
        information = ua.EUInformation(
            NamespaceUri=units.NAMESPACE if number is not None else NAMESPACE,
            UnitId=-1 if number is None else number,
            DisplayName=ua.LocalizedText(unit),
            Description=ua.LocalizedText(unit),
        )
        await variable.add_property(
            ua.NodeId(f"{variable.nodeid.Identifier}/EngineeringUnits", self._index),
            ua.QualifiedName("EngineeringUnits", 0),
            information,
        )

    async def _object(self, path: tuple[str, ...]) -> Node:
        if path not in self._objects:
            parent = await self._object(path[:-1])
            self._objects[path] = await parent.add_object(self._id(path), self._name(path[-1]))
        return self._objects[path]

    def _id(self, path: tuple[str, ...]) -> ua.NodeId:
        return ua.NodeId("/".join((self._machine, *path)), self._index)

    def _name(self, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._index)


def _severity(level: str) -> int:
    """1 to 1000, as OPC UA counts (Part 5, 6.4.2)."""
    number = logging.getLevelNamesMapping().get(level.upper(), logging.INFO)
    return min(1000, max(1, 20 * number))


def _now() -> datetime:
    return datetime.now(UTC)
