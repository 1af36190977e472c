"""The server: who may connect, what may be asked, and how much of it. Nothing can be changed."""

from __future__ import annotations

import hmac
import ipaddress
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.uaprocessor import UaProcessor
from cryptography import x509
from cryptography.hazmat.primitives import serialization

from abbe.daemon.config.sections.opcua_server import read_users
from abbe.drivers.opcua.incoming import IncomingChunks

_CONNECTIONS = 50
_ACTIVATED_WITHIN = 10.0
"""s that a connection has until somebody has signed in."""
_SUBSCRIPTIONS = 200
_QUEUE = 100
"""Values that wait for one monitored item; a client that asks for more has as many."""
_PENDING = 100
"""Requests of one connection that wait."""
_MESSAGE = 1_000_000
"""Bytes of one request or answer."""
_CHUNK = 65535
_URI = "urn:abbe-metrology:server"
_NO_SECURITY = "http://opcfoundation.org/UA/SecurityPolicy#None"
_POLICIES = [
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Basic256Sha256_Sign,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_Sign,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_Sign,
]


def _requests(*names: str) -> frozenset[ua.NodeId]:
    return frozenset(
        ua.NodeId(getattr(ua.ObjectIds, f"{name}Request_Encoding_DefaultBinary")) for name in names
    )


_BEFORE_SECURITY = _requests("FindServers", "GetEndpoints", "CloseSecureChannel")
"""What is answered where nothing is encrypted though it has to be: how to do better."""
_READING = _BEFORE_SECURITY | _requests(
    "CreateSession", "ActivateSession", "CloseSession", "Read", "Browse", "BrowseNext",
    "TranslateBrowsePathsToNodeIds", "RegisterNodes", "UnregisterNodes", "CreateSubscription",
    "ModifySubscription", "DeleteSubscriptions", "TransferSubscriptions", "CreateMonitoredItems",
    "ModifyMonitoredItems", "DeleteMonitoredItems", "SetMonitoringMode", "SetPublishingMode",
    "Publish", "Republish",
)  # fmt: skip
"""All that is answered; nothing that writes, calls, adds, deletes or registers."""
_CREATE = _requests("CreateSession")


class _ReadingProcessor(UaProcessor):  # type: ignore[misc]
    """Answers one connection, as far as it only reads."""

    unencrypted = False

    async def _process_message(
        self, typeid: ua.NodeId, requesthdr: Any, seqhdr: Any, body: Any
    ) -> Any:
        """Refuse what may not be asked, or not so; the library does the rest."""
        if typeid not in _READING:
            raise ServiceError(ua.StatusCodes.BadServiceUnsupported)
        clear = self._connection.security_policy.URI == _NO_SECURITY
        if clear and not self.unencrypted and typeid not in _BEFORE_SECURITY:
            raise ServiceError(ua.StatusCodes.BadSecurityPolicyRejected)
        if typeid in _CREATE and self.session is not None:
            raise ServiceError(ua.StatusCodes.BadTooManySessions)
        return await super()._process_message(typeid, requesthdr, seqhdr, body)


class _BoundedProtocol(OPCUAProtocol):  # type: ignore[misc]
    """One connection: of a network that may, and no more bytes than a request has."""

    def __init__(self, networks: list[Any], unencrypted: bool, **keys: Any) -> None:
        super().__init__(**keys)
        self._networks, self._unencrypted = networks, unencrypted
        self._chunks = IncomingChunks(super().data_received, self._break)

    def connection_made(self, transport: Any) -> None:
        """Let in who may come."""
        peer = ipaddress.ip_address(transport.get_extra_info("peername")[0])
        if self._networks and not any(peer in network for network in self._networks):
            transport.abort()
            return
        super().connection_made(transport)
        # the library has refused it where there are too many
        if self.transport is not None:
            answering = _ReadingProcessor(self.iserver, self.transport, self.limits)
            answering.unencrypted = self._unencrypted
            answering.set_policies(self.policies)
            self.processor: Any = answering

    def data_received(self, data: bytes) -> None:
        """Take what came, chunk by chunk."""
        if self.transport is not None:
            self._chunks.data_received(data)

    def _break(self) -> None:
        if self.transport is not None:
            self.transport.abort()


class _BoundedServer(BinaryServer):  # type: ignore[misc]
    """Listens, and makes a bounded connection of each."""

    networks: list[Any]
    unencrypted: bool

    def _make_protocol(self) -> OPCUAProtocol:
        return _BoundedProtocol(
            self.networks,
            self.unencrypted,
            iserver=self.iserver,
            policies=self._policies,
            clients=self.clients,
            closing_tasks=self.closing_tasks,
            limits=self.limits,
        )


class _Users:
    """Who may read; the file is read anew at each sign-in."""

    def __init__(self, path: str | None, anonymous: bool) -> None:
        self._path = None if path is None else Path(path)
        self._anonymous = anonymous

    def get_user(
        self,
        iserver: Any,
        username: str | None = None,
        password: str | bytes | None = None,
        certificate: Any = None,
    ) -> User | None:
        """The user, None: nobody who may read. Named as asyncua calls it."""
        if username is None:
            return User(UserRole.User) if self._anonymous else None
        if self._path is None:
            return None
        try:
            known = read_users(self._path)
        except (OSError, ValueError):
            return None
        given = password.encode() if isinstance(password, str) else password or b""
        wanted = known.get(username)
        # as long for a name that there is not
        same = hmac.compare_digest((wanted or "\x00" * 20).encode(), given)
        return User(UserRole.User, username) if same and wanted is not None else None


class _Trust:
    """Certificates of programs that may connect."""

    def __init__(self, trusted: list[bytes]) -> None:
        self._trusted = frozenset(trusted)

    async def __call__(self, certificate: x509.Certificate, description: Any) -> None:
        """Refuse a program whose certificate is none of them."""
        if certificate.public_bytes(serialization.Encoding.DER) not in self._trusted:
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)


async def make_server(task: Mapping[str, Any], about: Mapping[str, Any]) -> Server:
    """A server, initialised and not yet started.

    Parameters
    ----------
    task
        As `OpcuaServerSetup.task` makes it.
    about
        Of the run: ``abbe``, ``machine``.

    Raises
    ------
    OSError, ValueError
        When a file cannot be read, or is no certificate.
    """
    logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)
    server = Server(user_manager=_Users(task.get("users"), task["anonymous"]))
    inner = server.iserver
    inner.allow_remote_admin = False
    inner.max_connections, inner.max_subscriptions = _CONNECTIONS, _SUBSCRIPTIONS
    inner.max_pending_activation_seconds = _ACTIVATED_WITHIN
    inner.max_pending_messages_per_connection = _PENDING
    inner.max_monitored_item_queue_size = _QUEUE
    inner.max_unacked_messages_per_subscription = _QUEUE
    inner.max_session_timeout_ms = 120_000
    server.limits = TransportLimits(_CHUNK, _CHUNK, -(-_MESSAGE // _CHUNK), _MESSAGE)
    uri = _URI
    if "certificate" in task:
        uri = _uri_of(Path(task["certificate"])) or _URI
    server._application_uri = uri
    await server.init()
    server.set_server_name(f"Abbe, {about['machine']}")
    server.manufacturer_name, server.product_uri = "Abbe", "urn:abbe-metrology:abbe"
    server.application_type = ua.ApplicationType.Server
    host, port = task["host"], task["port"]
    shown = f"[{host}]" if ":" in host else host
    server.set_endpoint(f"opc.tcp://{shown}:{port}")
    policies = []
    if "certificate" in task:
        await server.load_certificate(task["certificate"], "pem")
        await server.load_private_key(task["key"], format="pem")
        policies += _POLICIES
    if task["unencrypted"]:
        policies.append(ua.SecurityPolicyType.NoSecurity)
    server.set_security_policy(policies)
    tokens: list[type] = [ua.UserNameIdentityToken] if "users" in task else []
    server.set_identity_tokens(tokens + [ua.AnonymousIdentityToken] * task["anonymous"])
    if task["trusted"]:
        server.set_certificate_validator(_Trust([_der(Path(name)) for name in task["trusted"]]))
    return server


async def start(server: Server, task: Mapping[str, Any]) -> None:
    """Begin to listen, bounded.

    Raises
    ------
    OSError
        When the address cannot be had.
    """
    from asyncua.server import server as module

    networks = [ipaddress.ip_network(text) for text in task["clients"]]
    unencrypted = bool(task["unencrypted"])
    bounds = {"networks": networks, "unencrypted": unencrypted}
    # the library has no other way to say which protocol answers
    module.BinaryServer = type("_OneServer", (_BoundedServer,), bounds)
    await server.start()


def _der(path: Path) -> bytes:
    certificate = x509.load_pem_x509_certificate(path.read_bytes())
    return certificate.public_bytes(serialization.Encoding.DER)


def _uri_of(path: Path) -> str:
    """The application's name in a certificate; empty: there is none."""
    certificate = x509.load_pem_x509_certificate(path.read_bytes())
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    found = names.get_values_for_type(x509.UniformResourceIdentifier)
    return found[0] if found else ""
