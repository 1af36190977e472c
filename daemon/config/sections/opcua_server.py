"""The section ``[opcua_server]``: where a run is offered by OPC UA, and to whom.

``docs/opcua-server.md`` is its page.
"""

from __future__ import annotations

import importlib.util
import ipaddress
import ssl
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.sections.http import Networks, listening_address, split_address
from abbe.daemon.config.sections.section import Section

_LONGEST = 200
"""Characters of a user's name or password."""


class OpcuaServerSection(Section):
    """Where a run is offered by OPC UA, read-only; without this section nowhere."""

    listen: Annotated[str, AfterValidator(listening_address)] = "127.0.0.1:4840"
    """Address and port."""
    certificate: Annotated[str, Field(min_length=1)] | None = None
    """Abbe's own certificate (PEM), relative to the configuration."""
    key: Annotated[str, Field(min_length=1)] | None = None
    """Its private key (PEM, without a password), likewise."""
    users: Annotated[str, Field(min_length=1)] | None = None
    """File of users, one ``NAME:PASSWORD`` a line, relative likewise; readable by nobody else."""
    trusted: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Certificates (PEM) of programs that may connect, relative likewise; default: any."""
    anonymous: bool = False
    """Whether nobody needs a name."""
    unencrypted: bool = False
    """Whether there is an endpoint without cryptography besides; only for this computer."""
    clients: Networks = ()
    """Networks that may connect, ``["192.168.0.0/24"]``; default: all."""
    every: Annotated[float, Field(ge=0.2, le=60.0)] = 1.0
    """s from one state to the next; a change of the status word does not wait."""

    @model_validator(mode="after")
    def _fits(self) -> OpcuaServerSection:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key go together")
        if self.certificate is None and not self.unencrypted:
            raise ValueError("certificate and key are needed, or unencrypted = true")
        if self.users is None and not self.anonymous:
            raise ValueError("nobody may read: users = FILE, or anonymous = true")
        if self.trusted and self.certificate is None:
            raise ValueError("trusted needs certificate and key")
        return self


@dataclass(frozen=True)
class OpcuaServerSetup:
    """An ``[opcua_server]`` section that was found to fit.

    Attributes
    ----------
    section
        It.
    host, port
        Where it listens.
    files
        Of ``certificate``, ``key``, ``users``: its path.
    trusted
        Paths.
    """

    section: OpcuaServerSection
    host: str
    port: int
    files: dict[str, Path]
    trusted: tuple[Path, ...]

    @property
    def networks(self) -> tuple[str, ...]:
        """Networks that can reach it: ``localhost``, ``any``, or those that may."""
        if ipaddress.ip_address(self.host).is_loopback:
            return ("localhost",)
        return self.section.clients or ("any",)

    def task(self) -> dict[str, Any]:
        """What the process that serves has to know, as JSON takes it."""
        section = self.section
        return {
            "host": self.host,
            "port": self.port,
            "anonymous": section.anonymous,
            "unencrypted": section.unencrypted,
            "clients": list(section.clients),
            "trusted": [str(path) for path in self.trusted],
            "every": section.every,
            **{key: str(path) for key, path in self.files.items()},
        }


def opcua_server_setup(
    source: TomlSource, path: Path, section: OpcuaServerSection
) -> OpcuaServerSetup:
    """Check an ``[opcua_server]`` section.

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
        For a package or a file that is missing, a certificate that cannot be used, a file of users
        that others may read, and for a network on which anybody could listen in.
    """
    where = ("opcua_server",)
    if importlib.util.find_spec("asyncua") is None:
        raise source.error("OPC UA needs asyncua", where, expected="pip install 'abbe[opcua]'")
    folder = path.parent.absolute()
    files = {}
    for key in ("certificate", "key", "users"):
        if (name := getattr(section, key)) is not None:
            files[key] = _file(source, key, folder / name)
    trusted = tuple(_file(source, "trusted", folder / name) for name in section.trusted)
    host, port = split_address(section.listen)
    if section.unencrypted and not ipaddress.ip_address(host).is_loopback:
        raise source.error(
            "without cryptography anybody in the network listens in",
            (*where, "unencrypted"),
            found=f"listen = {section.listen}",
            expected="false, or listen = 127.0.0.1",
        )
    if "certificate" in files:
        _check_pair(source, files["certificate"], files["key"])
    if "users" in files:
        try:
            read_users(files["users"])
        except (InputError, OSError, ValueError) as error:
            raise source.error(f"{files['users']}: {error}", (*where, "users")) from None
    return OpcuaServerSetup(section, host, port, files, trusted)


def _file(source: TomlSource, key: str, path: Path) -> Path:
    if not path.is_file():
        raise source.error("no such file", ("opcua_server", key), found=str(path))
    return path


def _check_pair(source: TomlSource, certificate: Path, key: Path) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (OSError, ValueError) as error:
        raise source.error(
            "certificate and key cannot be used",
            ("opcua_server", "certificate"),
            found=str(getattr(error, "reason", None) or error),
            expected="a PEM certificate and its own key without a password",
        ) from None


def read_users(path: Path) -> dict[str, str]:
    """Name → password, of a file that nobody else may read.

    Raises
    ------
    InputError
        For a line that is none, a name that comes twice, and a file that others may read.
    OSError, ValueError
        When it cannot be read, or is no text.
    """
    if stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise InputError("others may read these passwords", expected=f"chmod 600 {path}")
    found: dict[str, str] = {}
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        name, colon, password = line.partition(":")
        if not colon or not name or not password or len(line) > _LONGEST:
            raise InputError(f"line {number} is no user", expected="NAME:PASSWORD")
        if name in found:
            raise InputError(f"line {number}: user {name} stands there twice")
        found[name] = password
    if not found:
        raise InputError("no user in it", expected="NAME:PASSWORD, one a line")
    return found
