"""A session with an OPC UA server: opened, proved, asked by one Read at a time, given up."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import stat
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from asyncua import Client, ua
from asyncua.client.ua_client import UASocketProtocol
from asyncua.crypto import security_policies, uacrypto
from asyncua.ua.ua_binary import struct_from_binary

from abbe.drivers.link import (
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
)
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.incoming import MOST_BYTES, IncomingChunks

_PATIENCE = 5.0
"""Time-outs within which a connection is there: five answers, some with cryptography."""
_APPLICATION = "urn:abbe:client"
_FORGOTTEN = 10_000
"""ms after which the server forgets a session that was cut off: controls have few of them."""
_MOST_AT_ONCE = 8192
"""Bytes of an answer that are read at once, some ms; more may take a second, in a thread."""
_MODES = {
    "sign": ua.MessageSecurityMode.Sign,
    "encrypt": ua.MessageSecurityMode.SignAndEncrypt,
}
_NAMESPACES = ua.NodeId(ua.ObjectIds.Server_NamespaceArray)

# asyncua logs every lost request with a traceback; here an outage is logged once, by the link
_logger = logging.getLogger("asyncua")
if _logger.level == logging.NOTSET:
    _logger.setLevel(logging.CRITICAL + 1)


class ReadAnswer(NamedTuple):
    """What a Read gave.

    Attributes
    ----------
    values
        One for each node that was asked for.
    asked_at
        `time.monotonic()` when the question left.
    made_at
        When the server made the answer, by its own clock; None: it does not say.
    """

    values: Sequence[ua.DataValue]
    asked_at: float
    made_at: datetime | None


class OpcuaSession:
    """One session; another object for the next.

    Parameters
    ----------
    config
        The link's section.
    """

    def __init__(self, config: OpcuaConfig) -> None:
        self._config = config
        self._client = Client(config.url, timeout=config.timeout)
        self._client.name = self._client.description = "Abbe"
        self._client.application_uri = _APPLICATION
        self._client.session_timeout = _FORGOTTEN
        self._client.max_messagesize = MOST_BYTES
        self._incoming: IncomingChunks | None = None
        self._make_protocol = self._client.uaclient._make_protocol
        self._client.uaclient._make_protocol = self._bounded

    async def open(self) -> list[str]:
        """Connect, prove the server where that is configured, log in; its list of namespaces.

        Raises
        ------
        LinkConfigError
            When a file of the configuration cannot be used.
        LinkError
            When there is no session to be had.
        """
        await self._prepare()
        limit = _PATIENCE * self._config.timeout
        try:
            async with asyncio.timeout(limit):
                await self._client.connect()
                (found,) = (await self.read([_NAMESPACES])).values
        except TimeoutError:
            raise LinkTimeoutError(f"no session within {limit:g} s") from None
        except LinkError:
            raise
        except Exception as error:  # noqa: BLE001 - a stranger's answers, in a library's hands
            raise LinkDownError(self._broken or _why(error)) from None
        named = found.Value.Value if found.Value is not None else None
        return [str(name) for name in named] if isinstance(named, list) else []

    async def read(self, nodes: Sequence[ua.NodeId]) -> ReadAnswer:
        """The values of variables, in one request for which the server may not use old answers.

        Raises
        ------
        LinkError
            When there is no answer, or the server refuses as a whole.
        """
        request = ua.ReadRequest()
        request.Parameters.MaxAge = 0
        request.Parameters.TimestampsToReturn = ua.TimestampsToReturn.Both
        request.Parameters.NodesToRead = [
            ua.ReadValueId(NodeId=node, AttributeId=ua.AttributeIds.Value) for node in nodes
        ]
        asked_at = time.monotonic()
        response: ua.ReadResponse = await self.ask(request, ua.ReadResponse)
        values = response.Results or []
        if len(values) != len(nodes):
            raise LinkProtocolError(f"{len(nodes)} values asked for, {len(values)} answered")
        return ReadAnswer(values, asked_at, moment(response.ResponseHeader.Timestamp))

    def drop(self) -> None:
        """Give the connection up at once; safe to call at any time."""
        with contextlib.suppress(Exception):
            self._client.disconnect_socket()

    async def close(self) -> None:
        """End the session as far as the server lets it, and everything that belongs to it."""
        with contextlib.suppress(Exception):
            async with asyncio.timeout(self._config.timeout):
                await self._client.disconnect()
        self.drop()

    async def ask(self, request: Any, answer: Any, patience: float | None = None) -> Any:
        """Any service of OPC UA.

        Parameters
        ----------
        request
            asyncua's request.
        answer
            The class of its answer.
        patience
            s for the answer; None: as configured.

        Raises
        ------
        LinkError
            When there is no answer, or the server refuses.
        """
        limit = self._config.timeout if patience is None else patience
        try:
            data = await self._client.uaclient.protocol.send_request(request, limit)
            if len(data) > _MOST_AT_ONCE:
                found = await asyncio.to_thread(struct_from_binary, answer, data)
            else:
                found = struct_from_binary(answer, data)
            found.ResponseHeader.ServiceResult.check()
        except TimeoutError:
            raise LinkTimeoutError(f"no answer within {limit:g} s") from None
        except ua.UaStatusCodeError as error:
            raise LinkProtocolError(f"refused: {_why(error)}") from None
        except (OSError, AttributeError):
            raise LinkDownError(self._broken or "the connection was lost") from None
        except Exception as error:  # noqa: BLE001 - a stranger's answers, in a library's hands
            if self._broken:
                raise LinkDownError(self._broken) from None
            raise LinkProtocolError(f"an answer that is none: {_why(error)}") from None
        return found

    @property
    def _broken(self) -> str:
        """Why the connection was broken from this side; empty: it was not."""
        return self._incoming.why if self._incoming is not None else ""

    def _bounded(self) -> UASocketProtocol:
        """A connection of asyncua's that gets whole chunks only, and not too many."""
        protocol = self._make_protocol()
        incoming = IncomingChunks(protocol.data_received, lambda: _end(protocol))
        protocol.data_received = incoming.data_received
        self._incoming = incoming
        return protocol

    async def _prepare(self) -> None:
        config, client = self._config, self._client
        if config.user:
            client.set_user(config.user)
            client.set_password(_password(config.password_file))
        if config.security == "none":
            return
        try:
            await client.set_security(
                getattr(security_policies, f"SecurityPolicy{config.policy}"),
                _file(config.certificate, "certificate"),
                _file(config.private_key, "private_key"),
                server_certificate=_file(config.server_certificate, "server_certificate"),
                mode=_MODES[config.security],
            )
        except LinkConfigError:
            raise
        except Exception as error:  # noqa: BLE001 - whatever is wrong with a user's files
            files = f"{config.certificate}, {config.private_key}, {config.server_certificate}"
            raise LinkConfigError(
                f"no use as certificates and key: {files}: {_why(error)}", ("certificate",)
            ) from None


def _end(protocol: UASocketProtocol) -> None:
    if protocol.transport is not None:
        protocol.transport.abort()


def _file(path: str, key: str) -> uacrypto.CertProperties:
    """A certificate or key by what it holds: its name may end in anything.

    Raises
    ------
    LinkConfigError
        When it cannot be read.
    """
    try:
        held = Path(path).read_bytes()
    except OSError as error:
        raise LinkConfigError(f"{path}: {error.strerror}", (key,)) from None
    return uacrypto.CertProperties(held, "pem" if b"-----BEGIN" in held else "der")


def moment(stamp: datetime | None) -> datetime | None:
    """A time stamp; None where it is OPC UA's zero, which is no time (Part 6, 5.2.2.5)."""
    return stamp if stamp is not None and stamp.year > 1601 else None


def _password(path: str) -> str:
    try:
        with Path(path).open("rb") as file:
            if stat.S_IMODE(os.fstat(file.fileno()).st_mode) & 0o077:
                raise LinkConfigError(
                    f"{path}: others may read this password; chmod 600 {path}", ("password_file",)
                )
            line = file.readline(4096)
        return line.decode("utf-8").rstrip("\r\n")
    except OSError as error:
        raise LinkConfigError(f"{path}: {error.strerror}", ("password_file",)) from None
    except UnicodeDecodeError:
        raise LinkConfigError(f"{path}: is no UTF-8", ("password_file",)) from None


def _why(error: BaseException) -> str:
    """An error in one line; of a status code its name, as the standard spells it."""
    if isinstance(error, ua.UaStatusCodeError):
        return f"{type(error).__name__} (0x{error.code:08X})"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]
