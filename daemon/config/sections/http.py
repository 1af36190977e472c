"""The section ``[http]``: where a run can be looked at over HTTP, and by whom.

``docs/status.md`` is its page.
"""

from __future__ import annotations

import importlib.util
import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.folders import data_folder
from abbe.daemon.config.sections.section import Section
from abbe.daemon.config.tokens import read_tokens
from abbe.daemon.socket_path import check_path

NEEDED = ("fastapi", "uvicorn", "prometheus_client")
"""Packages that only this section needs."""


def split_address(text: str) -> tuple[str, int]:
    """``127.0.0.1:8470`` or ``[::1]:8470`` → address and port.

    Raises
    ------
    InputError
        For a name, a missing port, or a port that there is not.
    """
    host, _, port = text.rpartition(":")
    try:
        address = ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
        number = int(port)
    except ValueError:
        number = -1
    bare = ":" in host and not host.startswith("[")
    if bare or not 1 <= number <= 65535 or not port.isascii():
        raise InputError(
            "not an address to listen at",
            found=text,
            expected='a number and a port, "127.0.0.1:8470" or "[::1]:8470"',
        )
    return str(address), number


def listening_address(text: str) -> str:
    """Refuse what is not an address and a port, as `split_address` does."""
    split_address(text)
    return text


def _network(text: str) -> str:
    try:
        ipaddress.ip_network(text)
    except ValueError as error:
        raise InputError(
            "not a network", found=text, expected=f'"192.168.0.0/24" ({error})'
        ) from None
    return text


Networks = Annotated[tuple[Annotated[str, AfterValidator(_network)], ...], Field(strict=False)]
"""Networks by their addresses, ``192.168.0.0/24``."""


class HttpSection(Section):
    """Where a run can be looked at over HTTP; without this section nowhere."""

    socket: Annotated[str, Field(min_length=1)] = "http.sock"
    """Unix socket, relative to the configuration (of a service: to its state folder); for the user
    who runs the correction, its group, and root."""
    listen: Annotated[
        tuple[Annotated[str, AfterValidator(listening_address)], ...], Field(strict=False)
    ] = ()
    """Addresses and ports of the network besides: ``["127.0.0.1:8470"]``; each needs a token."""
    tokens: Annotated[str, Field(min_length=1)] = "http-tokens.toml"
    """File of tokens, relative to the configuration; `abbe token` writes it."""
    certificate: str | None = None
    """Certificate chain (PEM), relative to the configuration: TLS on `listen`."""
    key: str | None = None
    """Its private key (PEM), likewise."""
    clients: Networks = ()
    """Networks that may connect to `listen`, ``["192.168.0.0/24"]``; default: all."""


@dataclass(frozen=True)
class HttpSetup:
    """An ``[http]`` section that was found to fit.

    Attributes
    ----------
    socket, tokens
        Paths.
    listen
        Addresses and ports.
    certificate, key
        Paths; None: no TLS.
    clients
        Networks that may connect; empty: all.
    """

    socket: Path
    tokens: Path
    listen: tuple[tuple[str, int], ...] = ()
    certificate: Path | None = None
    key: Path | None = None
    clients: tuple[str, ...] = ()

    @property
    def networks(self) -> tuple[str, ...]:
        """Networks that can reach it: ``localhost``, ``any``, or those that may; empty: none."""
        if not self.listen:
            return ()
        if all(ipaddress.ip_address(host).is_loopback for host, _ in self.listen):
            return ("localhost",)
        return self.clients or ("any",)


def http_setup(source: TomlSource, path: Path, section: HttpSection) -> HttpSetup:
    """Check an ``[http]`` section.

    Parameters
    ----------
    source
        The file, for the places of errors.
    path
        The file's path.
    section
        The section.

    Raises
    ------
    InputError
        For a package that is missing, a socket that cannot be, and for a network that anybody could
        listen in on or ask at.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise source.error(
            f"HTTP needs {' and '.join(missing)}", ("http",), expected="pip install 'abbe[http]'"
        )
    folder = path.parent.absolute()
    socket = data_folder(path).absolute() / section.socket
    try:
        check_path(socket)
    except InputError as error:
        raise source.error(
            error.problem, ("http", "socket"), found=error.found, expected=error.expected
        ) from None
    setup = HttpSetup(
        socket,
        folder / section.tokens,
        tuple(split_address(text) for text in section.listen),
        None if section.certificate is None else folder / section.certificate,
        None if section.key is None else folder / section.key,
        section.clients,
    )
    _check_tls(source, setup)
    if setup.listen:
        _check_tokens(source, path, setup)
    elif setup.clients:
        raise source.error("limits what does not listen", ("http", "clients"), expected="listen")
    return setup


def _check_tls(source: TomlSource, setup: HttpSetup) -> None:
    if (setup.certificate is None) != (setup.key is None):
        raise source.error(
            "a certificate and its key belong together", ("http",), expected="certificate and key"
        )
    if setup.certificate is not None and setup.key is not None:
        for name, file in (("certificate", setup.certificate), ("key", setup.key)):
            if not file.is_file():
                raise source.error("no such file", ("http", name), found=str(file))
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(
                setup.certificate, setup.key, password=""
            )
        except (OSError, ValueError) as error:
            raise source.error(
                "certificate and key cannot be used",
                ("http", "certificate"),
                found=str(getattr(error, "reason", None) or error),
                expected="a PEM certificate and its own key without a password",
            ) from None
        return
    for host, port in setup.listen:
        if not ipaddress.ip_address(host).is_loopback:
            raise source.error(
                "a token that is sent over a network in the clear is everybody's",
                ("http", "listen"),
                found=f"{host}:{port}",
                expected="certificate and key, or 127.0.0.1",
            )


def _check_tokens(source: TomlSource, path: Path, setup: HttpSetup) -> None:
    try:
        tokens = read_tokens(setup.tokens)
    except InputError as error:
        raise source.error(
            f"tokens cannot be read: {error}", ("http", "tokens"), found=str(setup.tokens)
        ) from None
    if not tokens:
        raise source.error(
            "nobody could ask: there is no token",
            ("http", "listen"),
            found=str(setup.tokens),
            expected=f"abbe token add {path} NAME",
        )
