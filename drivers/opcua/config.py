"""The configuration section of an OPC UA link: a server, how it is proved, and what is read of it.

::

    [links.control]
    driver = "opcua"
    url = "opc.tcp://192.168.0.30:4840"
    [links.control.channels]
    x = { node = "nsu=http://example.org/mill;s=Axes/X/Position", unit = "mm" }
    T_spindle = { node = "ns=2;i=6021", unit = "degC", every = 5.0 }

``docs/opcua.md`` is the user's page on each key.
"""

from __future__ import annotations

from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from abbe.drivers.opcua.nodes import NodeName, node_name
from abbe.drivers.reconnect import ReconnectConfig
from abbe.drivers.scaled import ScaledNumber
from abbe.drivers.server_url import server_url

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

DEFAULT_PORT = 4840
"""Registered for OPC UA's binary protocol."""
Security = Literal["none", "sign", "encrypt"]
Policy = Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]
Stamp = Literal["server", "source", "none"]


def _server(url: str) -> str:
    parts = server_url(url, "opc.tcp", "opc.tcp://HOST:PORT")
    if parts.username is not None:
        raise ValueError("no user in it: user and password_file are keys of their own")
    return url


def _named(text: str) -> str:
    node_name(text)
    return text


class OpcuaChannelConfig(ScaledNumber):
    """One value of the server's: a variable, or one element of an array."""

    model_config = _STRICT

    node: Annotated[str, AfterValidator(_named)]
    """Node id: ``ns=2;s=Name``, ``ns=2;i=17``, or with the namespace's name: ``nsu=URI;s=Name``."""
    item: Annotated[int, Field(ge=1)] | None = None
    """Which element of an array, from 1."""
    every: Annotated[float, Field(ge=0)] = 0.0
    """s between two questions; 0 asks at every call."""

    @property
    def name(self) -> NodeName:
        """The node id in its parts."""
        return node_name(self.node)


class OpcuaConfig(ReconnectConfig):
    """One OPC UA server and what is read of it. Times are in s."""

    model_config = _STRICT

    url: Annotated[str, AfterValidator(_server)]
    """``opc.tcp://HOST:PORT/PATH``."""
    timeout: Annotated[float, Field(gt=0, le=60)] = 1.0
    """For an answer; for a new connection, with its cryptography, five times that."""
    reconnect_min: Annotated[float, Field(gt=0)] = 0.5
    reconnect_max: Annotated[float, Field(gt=0)] = 10.0
    unanswered: Annotated[int, Field(ge=1)] = 2
    """Questions in a row without an answer after which the link connects anew."""
    stamp: Stamp = "source"
    """Whose time stamp tells how old a value is in the server: ``source``, ``server``, ``none``."""
    subscribe: Annotated[float, Field(ge=0, le=60)] = 0.0
    """s between two messages by which the server notifies of what is new; 0: it is asked."""
    units: bool = True
    """Whether the engineering units that the server states are compared with `unit`."""
    security: Security = "none"
    """``sign``: what is read cannot be forged on its way; ``encrypt``: nor overheard."""
    policy: Policy = "Basic256Sha256"
    """By which algorithms, where `security` is not ``none``."""
    certificate: str = ""
    """Abbe's own certificate (DER or PEM file), where `security` is not ``none``."""
    private_key: str = ""
    """Its private key (PEM or DER file without a password)."""
    server_certificate: str = ""
    """The server's certificate (DER or PEM file): no other server is believed."""
    user: str = ""
    """User name; empty: anonymous."""
    password_file: str = ""
    """File with the password in its first line, readable by nobody else."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the server; one more is turned away at once."""
    channels: Annotated[dict[str, OpcuaChannelConfig], Field(min_length=1)]

    @property
    def host(self) -> str:
        """Name or address of the server."""
        return urlsplit(self.url).hostname or ""

    @property
    def port(self) -> int:
        """Its TCP port."""
        return urlsplit(self.url).port or DEFAULT_PORT

    @model_validator(mode="after")
    def _proved(self) -> OpcuaConfig:
        files = {
            "certificate": self.certificate,
            "private_key": self.private_key,
            "server_certificate": self.server_certificate,
        }
        if self.security == "none":
            given = [key for key, value in files.items() if value]
            if given:
                raise ValueError(f"{given[0]}: only with security = 'sign' or 'encrypt'")
        elif missing := [key for key, value in files.items() if not value]:
            raise ValueError(f"security = {self.security!r} needs {' and '.join(missing)}")
        if self.subscribe and self.stamp == "server":
            raise ValueError(
                "subscribe: a server notifies of new values and new source stamps, never of its "
                "own stamps alone: with stamp = 'source' or 'none' only"
            )
        if bool(self.user) != bool(self.password_file):
            raise ValueError("user and password_file go together")
        return self
