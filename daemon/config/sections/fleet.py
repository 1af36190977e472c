"""The section ``[fleet]``: the plant's store that a machine's records are uploaded to, and how.

``docs/fleet-store.md`` is its page.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import unquote, urlsplit

from pydantic import AfterValidator, Field, model_validator

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.sections.section import Seconds, Section
from abbe.drivers import resources

NEEDED = "psycopg"
"""Package that only this section needs."""
_SCHEMES = {"postgresql", "postgres"}
_PORT = 5432


def _url(text: str) -> str:
    try:
        parts = urlsplit(text)
        usable = parts.scheme in _SCHEMES and bool(parts.hostname) and (parts.port or 1) > 0
        database = unquote(parts.path.strip("/"))
    except ValueError:
        usable, database = False, ""
    if not usable or not database or "/" in database or parts.query or "@" in text:
        raise InputError("not a store", found=text, expected='"postgresql://HOST:PORT/DATABASE"')
    return text


class FleetSection(Section):
    """Where a machine's records are uploaded to; without this section nowhere."""

    url: Annotated[str, AfterValidator(_url)]
    """The store: ``postgresql://HOST:PORT/DATABASE``, without user and password."""
    site: Annotated[str, Field(min_length=1, max_length=100)]
    """The plant, hall or customer: who may see the machine goes by it."""
    machine: Annotated[str, Field(min_length=1, max_length=100)] | None = None
    """Its name in the store, one of a site; default: the model's name of the machine."""
    user: Annotated[str, Field(min_length=1)]
    """Role that writes this machine, as ``abbe fleet add`` made it."""
    password_file: Annotated[str, Field(min_length=1)] | None = None
    """File with its password in the first line, relative to the configuration."""
    tls: bool | None = None
    """Whether to speak TLS and check the store's certificate; default: unless it is on this
    computer."""
    ca: Annotated[str, Field(min_length=1)] | None = None
    """PEM file that vouches for the store, relative likewise; default: the computer's own."""
    certificate: Annotated[str, Field(min_length=1)] | None = None
    """Abbe's own certificate (PEM), relative likewise, where the store asks for one."""
    key: Annotated[str, Field(min_length=1)] | None = None
    """Its private key (PEM), likewise."""
    every: Annotated[float, Field(ge=1.0, le=3600.0)] = 30.0
    """s from one upload to the next."""
    span: Literal[60, 120, 300, 600, 900, 1800, 3600] = 600
    """s of which history keeps least, mean and greatest of each series."""
    campaigns: list[Annotated[str, Field(min_length=1)]] = Field(default_factory=list)
    """Campaign files that go up: names or patterns, relative likewise (``campaigns/*.csv``)."""
    models: list[Annotated[str, Field(min_length=1)]] = Field(default_factory=list)
    """Model files that go up besides the one that runs: earlier versions, likewise."""
    timeout: Seconds = 20.0
    """s for an answer of the store."""
    reconnect_min: Seconds = 1.0
    """s until the first attempt to connect anew; doubled each time, times a random 0.5 to 1."""
    reconnect_max: Seconds = 60.0
    """s between two attempts at most."""

    @model_validator(mode="after")
    def _fits(self) -> FleetSection:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key go together")
        if self.reconnect_max < self.reconnect_min:
            raise ValueError("reconnect_max is below reconnect_min")
        return self


@dataclass(frozen=True)
class FleetSetup:
    """A ``[fleet]`` section that was found to fit.

    Attributes
    ----------
    section
        It.
    host, port, database
        The store.
    tls
        Whether TLS is spoken.
    machine
        Its name in the store.
    files
        Of the keys that name one: its path.
    """

    section: FleetSection
    host: str
    port: int
    database: str
    tls: bool
    machine: str
    files: dict[str, Path]

    @property
    def resource(self) -> str:
        """The store as links spell what they reach."""
        return resources.tcp(self.host, self.port)

    def task(self) -> dict[str, Any]:
        """What the process that uploads has to know of the store, as JSON takes it."""
        section = self.section
        return {
            "host": self.host,
            "port": self.port,
            "database": self.database,
            "tls": self.tls,
            "site": section.site,
            "machine": self.machine,
            "user": section.user,
            "every": section.every,
            "span": section.span,
            "campaigns": section.campaigns,
            "models": section.models,
            "timeout": section.timeout,
            "reconnect_min": section.reconnect_min,
            "reconnect_max": section.reconnect_max,
            **{key: str(path) for key, path in self.files.items()},
        }


def fleet_setup(
    source: TomlSource, path: Path, section: FleetSection, machine: str, *, records: bool
) -> FleetSetup:
    """Check a ``[fleet]`` section.

    Parameters
    ----------
    source
        The file, for the places of errors.
    path
        The file's path.
    section
        The section.
    machine
        The model's name of the machine.
    records
        Whether records are kept: they are what is uploaded.

    Raises
    ------
    InputError
        For a package or a file that is missing, a machine without a name, records that are not
        kept, and for what anybody on the way could read.
    """
    if importlib.util.find_spec(NEEDED) is None:
        raise source.error(
            f"the plant's store needs {NEEDED}", ("fleet",), expected="pip install 'abbe[fleet]'"
        )
    if not records:
        raise source.error(
            "nothing is kept that could be uploaded", ("fleet",), expected="a section [records]"
        )
    if not (name := section.machine or machine):
        raise source.error(
            "the machine has no name, in the model neither", ("fleet", "machine"), expected="a name"
        )
    files = {}
    for key in ("password_file", "ca", "certificate", "key"):
        given = getattr(section, key)
        if given is not None:
            files[key] = path.parent.absolute() / given
            if not files[key].is_file():
                raise source.error("no such file", ("fleet", key), found=str(files[key]))
    parts = urlsplit(section.url)
    host = parts.hostname or ""
    tls = not resources.on_this_computer(host) if section.tls is None else section.tls
    if not tls and not resources.on_this_computer(host):
        raise source.error(
            "over a network everybody on the way could read and forge it",
            ("fleet", "tls"),
            found="false",
            expected="true, or a store on 127.0.0.1",
        )
    if not tls and (section.ca or section.certificate):
        raise source.error("ca, certificate and key are of TLS", ("fleet", "tls"), found="false")
    database = unquote(parts.path.strip("/"))
    return FleetSetup(section, host, parts.port or _PORT, database, tls, name, files)
