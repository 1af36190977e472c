"""Node ids as OPC UA writes them (Part 6, 5.3.1.10), with the namespace by number or by name."""

from __future__ import annotations

import re
from typing import NamedTuple

_FORM = re.compile(
    r"(?:ns=(?P<index>\d{1,5});|nsu=(?P<uri>[^;]{1,500});)?"
    r"(?P<rest>i=\d{1,10}|s=.{1,4000}"
    r"|g=[0-9a-fA-F]{8}(?:-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}|b=[A-Za-z0-9+/]{1,5000}={0,2})",
    re.DOTALL,
)
_GREATEST_INDEX = 65535
_GREATEST_NUMBER = 2**32 - 1


class NodeName(NamedTuple):
    """A node id in its parts.

    Attributes
    ----------
    uri
        The namespace's name; empty where it is given by its number.
    number
        Its number, which a server may change when it starts again (Part 4, 5.2.2).
    rest
        ``i=17``, ``s=Name``, ``g=…`` or ``b=…``.
    """

    uri: str
    number: int
    rest: str

    def numbered(self, namespaces: list[str]) -> str:
        """As ``ns=2;s=Name``, by the server's own list of namespaces.

        Raises
        ------
        ValueError
            When the server has no namespace of that name; those that it has.
        """
        index = self.number
        if self.uri:
            if self.uri not in namespaces:
                raise ValueError(
                    f"the server has no namespace {self.uri!r}; it has: {', '.join(namespaces)}"
                )
            index = namespaces.index(self.uri)
        return f"ns={index};{self.rest}" if index else self.rest


def node_name(text: str) -> NodeName:
    """Take a node id apart.

    Raises
    ------
    ValueError
        When it is none.

    >>> node_name("ns=2;s=Axis/X")
    NodeName(uri='', number=2, rest='s=Axis/X')
    >>> node_name("nsu=http://example.org/mill;i=5").numbered(["", "http://example.org/mill"])
    'ns=1;i=5'
    """
    found = _FORM.fullmatch(text)
    if (
        found is None
        or int(found["index"] or 0) > _GREATEST_INDEX
        or (found["rest"].startswith("i=") and int(found["rest"][2:]) > _GREATEST_NUMBER)
    ):
        raise ValueError(
            f"expected a node id such as 'ns=2;s=Name', 'ns=2;i=17' or 'nsu=URI;s=Name', "
            f"found {text!r}"
        )
    return NodeName(found["uri"] or "", int(found["index"] or 0), found["rest"])
