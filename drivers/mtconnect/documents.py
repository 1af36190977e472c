"""Documents of an MTConnect agent, from bytes: what it has, what it observed, what it refuses.

Read by expat as elements come: no tree is built, and a document type declaration ends it, so that
no entity is ever expanded.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

from abbe.drivers.link import LinkProtocolError

_PIECE = 4096
"""Bytes between two turns of the event loop: a millisecond or two of the smallest elements."""
_DEEPEST = 64
"""Elements within each other; components of machines have some ten."""
_MOST_TEXT = 65536
"""Characters of one element's text that are kept."""
_ROOTS = ("MTConnectDevices", "MTConnectStreams", "MTConnectError")


@dataclass(slots=True)
class AgentElement:
    """An element that carries a data item's observation: its name, attributes and text."""

    name: str
    attributes: dict[str, str]
    text: str = ""
    parts: bool = False
    """Whether it holds elements of its own: a set or a table, no number."""


@dataclass(slots=True)
class AgentDocument:
    """One document of an agent's.

    Attributes
    ----------
    root
        ``MTConnectDevices``, ``MTConnectStreams`` or ``MTConnectError``.
    header
        Attributes of its ``Header``.
    items
        Id → attributes of each ``DataItem``, of a probe document.
    observations
        Elements with a ``dataItemId``, in the document's order, of a streams document.
    errors
        (code, text) of each refusal.
    """

    root: str = ""
    header: dict[str, str] = field(default_factory=dict)
    items: dict[str, dict[str, str]] = field(default_factory=dict)
    observations: list[AgentElement] = field(default_factory=list)
    errors: list[tuple[str, str]] = field(default_factory=list)

    def number(self, key: str) -> int:
        """A whole number of the header: ``instanceId``, ``nextSequence``.

        Raises
        ------
        LinkProtocolError
            When it is not there, or none.
        """
        text = self.header.get(key, "")
        # no int() of what a stranger sends before its length is known
        if not (text.isascii() and text.isdigit() and len(text) <= 20):
            found = f"expected a number, found {text[:80]!r}"
            raise LinkProtocolError(f"{self.root}: Header {key}: {found}")
        return int(text)


class _Reader:
    """Handlers of one document."""

    def __init__(self, wanted: frozenset[str]) -> None:
        self.document = AgentDocument()
        self._wanted = wanted
        self._open: list[AgentElement | None] = []
        self._texts: list[str] = []
        self._kept = 0
        self.expat = expat.ParserCreate(namespace_separator=" ")
        self.expat.buffer_text = True
        self.expat.StartElementHandler = self._start
        self.expat.EndElementHandler = self._end
        self.expat.CharacterDataHandler = self._text
        self.expat.StartDoctypeDeclHandler = _refuse

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(" ")[2]
        document = self.document
        if not self._open:
            document.root = name
            if name not in _ROOTS:
                raise LinkProtocolError(f"no document of MTConnect: its root is {name[:80]!r}")
        if len(self._open) >= _DEEPEST:
            raise LinkProtocolError(f"more than {_DEEPEST} elements within each other")
        if self._open and self._open[-1] is not None:
            self._open[-1].parts = True
        element = None
        if (
            attributes.get("dataItemId") in self._wanted
            if document.root == "MTConnectStreams"
            else document.root == "MTConnectError" and "errorCode" in attributes
        ):
            element = AgentElement(name, attributes)
        elif name == "DataItem" and document.root == "MTConnectDevices":
            if (known := attributes.get("id")) in self._wanted:
                document.items[known] = attributes
        elif name == "Header" and len(self._open) == 1:
            document.header = attributes
        self._open.append(element)
        if element is not None:
            self._texts, self._kept = [], 0

    def _text(self, text: str) -> None:
        # of an error of MTConnect 2 the text is one element further down
        if any(element is not None for element in self._open[-2:]):
            self._kept += len(text)
            if self._kept > _MOST_TEXT:
                raise LinkProtocolError(f"more than {_MOST_TEXT} characters in one element")
            self._texts.append(text)

    def _end(self, tag: str) -> None:
        element = self._open.pop()
        if element is None:
            return
        element.text = "".join(self._texts).strip()
        if self.document.root == "MTConnectError":
            self.document.errors.append((element.attributes["errorCode"], element.text))
        else:
            self.document.observations.append(element)


def _refuse(*_: Any) -> None:
    raise LinkProtocolError("it has a document type declaration (DTD), which is never read")


async def document_of(body: bytes, wanted: frozenset[str]) -> AgentDocument:
    """A document from its bytes, with a turn of the event loop every few kilobytes.

    Parameters
    ----------
    body
        All of it.
    wanted
        Ids of data items; of others nothing is kept.

    Raises
    ------
    LinkProtocolError
        When it is no XML, has a document type declaration, or is no document of MTConnect.
    """
    reader = _Reader(wanted)
    try:
        for at in range(0, len(body), _PIECE):
            if at:
                await asyncio.sleep(0)
            reader.expat.Parse(body[at : at + _PIECE])
        reader.expat.Parse(b"", True)
    except expat.ExpatError as error:
        raise LinkProtocolError(f"no XML: {error}") from None
    except (LookupError, ValueError) as error:
        # an encoding that Python does not have, or that expat cannot use
        raise LinkProtocolError(f"no XML: {error}") from None
    return reader.document
