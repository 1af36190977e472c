"""The gate of the HTTP interface: who asks, and what he may.

Over the Unix socket the file's permissions say who may look; to change anything takes a token there
too. Over the network everything but ``/healthz`` and ``/readyz`` takes one.
"""

from __future__ import annotations

import base64
import binascii
import ipaddress
import logging
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from abbe.compcore.errors import InputError
from abbe.daemon.config.tokens import Role, TokenFile, token_of

LOCAL = "abbe.local"
"""Key of a request's scope: whether it came over the Unix socket."""
_AGAIN = 60.0
"""s between two events for one address that is refused."""
_REMEMBERED = 256
_LONGEST = 512
"""Characters of a credential that are looked at."""


@dataclass(frozen=True)
class Visitor:
    """Somebody who asks.

    Attributes
    ----------
    who
        For the journal.
    role
        What he may; None: nothing.
    bearer
        Whether he showed a token as programs do, not as a browser does on its own.
    """

    who: str
    role: Role | None
    bearer: bool = False


class Gate:
    """Knows the tokens, and the networks that may ask.

    Parameters
    ----------
    tokens
        The file.
    clients
        Networks that may ask at all; empty: all.
    log
        Takes level and text for the journal.
    """

    def __init__(
        self, tokens: TokenFile, clients: Sequence[str], log: Callable[[int, str], None]
    ) -> None:
        self._tokens = tokens
        self._clients = [ipaddress.ip_network(text) for text in clients]
        self._log = log
        self._refused: OrderedDict[str, float] = OrderedDict()
        self.refused = 0
        """How often somebody was refused."""

    def welcome(self, address: str) -> bool:
        """Whether an address of the network may ask."""
        if not self._clients:
            return True
        try:
            found = ipaddress.ip_address(address)
        except ValueError:
            return False
        if isinstance(found, ipaddress.IPv6Address) and found.ipv4_mapped is not None:
            found = found.ipv4_mapped
        return any(found in network for network in self._clients)

    def visitor(self, scope: Mapping[str, Any]) -> Visitor:
        """Who asks, by a request's ASGI scope."""
        client = scope.get("client")
        address = "the Unix socket" if scope.get(LOCAL) or client is None else str(client[0])
        scheme, secret = _credential(scope)
        if secret:
            try:
                found = token_of(secret, self._tokens.tokens())
            except InputError as error:
                self._log(logging.ERROR, f"no token counts any more: {error}")
                found = None
            if found is not None:
                name, token = found
                return Visitor(f"token {name} at {address}", token.role, scheme == "bearer")
            self.refuse(address, "a token that is none, or no more")
            return Visitor(address, None)
        if scope.get(LOCAL):
            return Visitor(address, "view")
        return Visitor(address, None)

    def refuse(self, address: str, why: str) -> None:
        """Count a refusal; say it once a minute for each address."""
        self.refused += 1
        now = time.monotonic()
        if now - self._refused.get(address, -_AGAIN) < _AGAIN:
            return
        self._refused[address] = now
        self._refused.move_to_end(address)
        while len(self._refused) > _REMEMBERED:
            self._refused.popitem(last=False)
        self._log(logging.WARNING, f"{address} was refused: {why}")


def _credential(scope: Mapping[str, Any]) -> tuple[str, str]:
    """Scheme and secret of a request: a bearer's token, or the password of HTTP's basic way."""
    for name, value in scope.get("headers", ()):
        if name != b"authorization":
            continue
        scheme, _, rest = value[:_LONGEST].decode("latin-1").partition(" ")
        if scheme.lower() == "bearer":
            return "bearer", rest.strip()
        if scheme.lower() == "basic":
            try:
                plain = base64.b64decode(rest.strip(), validate=True).decode("utf-8", "replace")
            except (binascii.Error, ValueError):
                return "basic", "?"
            return "basic", plain.partition(":")[2] or "?"
        return scheme.lower(), "?"
    return "", ""
