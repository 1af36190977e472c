"""The section ``[mqtt]``: the broker that a run publishes to, and how.

``docs/mqtt.md`` is its page.
"""

from __future__ import annotations

import importlib.util
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, model_validator

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.folders import data_folder
from abbe.daemon.config.sections.section import Seconds, Section
from abbe.drivers import resources

Version = Literal["5", "3.1.1"]
Format = Literal["json", "sparkplug"]

MACHINE = "{machine}"
"""Stands in a topic for the machine's name."""
NEEDED: dict[Format, tuple[tuple[str, str, str], ...]] = {
    "json": (("aiomqtt", "aiomqtt", "mqtt"),),
    "sparkplug": (("aiomqtt", "aiomqtt", "mqtt"), ("google.protobuf", "protobuf", "sparkplug")),
}
"""Format → modules that only this section needs, their packages, and the extras that have them."""
_LEVEL = re.compile(r"[^+#\x00-\x1f\x7f-\x9f\ud800-\udfff]+")
_PORTS = {"mqtt": 1883, "mqtts": 8883}


def _url(text: str) -> str:
    try:
        parts = urlsplit(text)
        usable = parts.scheme in _PORTS and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        usable = False
    if not usable or parts.path.strip("/") or parts.query or "@" in text:
        raise InputError(
            "not a broker", found=text, expected='"mqtts://HOST:PORT" or "mqtt://HOST:PORT"'
        )
    return text


def _id(text: str) -> str:
    """A name of Sparkplug's: one level of a topic."""
    if not _LEVEL.fullmatch(text) or "/" in text:
        raise InputError(
            "not one level of a topic", found=text, expected="a name without + # and /"
        )
    return text


_Id = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_id)]


def _topic(text: str) -> str:
    levels = text.split("/")
    if text.startswith("$") or not all(
        re.fullmatch(r"[^+#\x00-\x1f\x7f-\x9f]+", n) for n in levels
    ):
        raise InputError(
            "not a topic to publish below",
            found=text,
            expected='words with / between, such as "plant-2/abbe/{machine}", without + and #',
        )
    return text


class MqttSection(Section):
    """Where a run's state is published by MQTT; without this section nowhere."""

    url: Annotated[str, AfterValidator(_url)]
    """The broker: ``mqtts://HOST:PORT`` with TLS, ``mqtt://HOST:PORT`` in the clear."""
    topic: Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_topic)] = (
        f"abbe/{MACHINE}"
    )
    """Begins every topic; ``{machine}`` is the machine's name."""
    format: Format = "json"
    """What is said how: plain JSON, or Sparkplug B."""
    group: _Id | None = None
    """Sparkplug's group, e.g. the plant."""
    node: _Id = f"abbe-{MACHINE}"
    """Sparkplug's edge node: this run; no other of the group may have the same name."""
    device: _Id = MACHINE
    """Sparkplug's device: the machine."""
    primary_host: _Id | None = None
    """Sparkplug's host without which nothing is sent; default: whoever listens."""
    every: Annotated[float, Field(ge=0.5, le=3600.0)] = 5.0
    """s from one state that is published to the next; a change of the status word does not wait."""
    client_id: Annotated[str, Field(min_length=1, max_length=100)] | None = None
    """As the broker knows it; default: ``abbe-`` and the machine's name."""
    user: Annotated[str, Field(min_length=1)] | None = None
    """Name at the broker."""
    password_file: Annotated[str, Field(min_length=1)] | None = None
    """File with its password in the first line, relative to the configuration."""
    ca: Annotated[str, Field(min_length=1)] | None = None
    """PEM file that vouches for the broker, relative likewise; default: the computer's own."""
    certificate: Annotated[str, Field(min_length=1)] | None = None
    """Abbe's own certificate (PEM), relative likewise, where the broker asks for one."""
    key: Annotated[str, Field(min_length=1)] | None = None
    """Its private key (PEM), likewise."""
    version: Version = "5"
    """Of the protocol."""
    buffer: Annotated[str, Field(pattern=r"^.+\.sqlite$", max_length=1000)] = "mqtt.sqlite"
    """File of what the broker has not taken yet, relative as the journal's."""
    max_bytes: Annotated[int, Field(ge=100_000, le=10_000_000_000)] = 100_000_000
    """Bytes of messages that wait at most; beyond it the oldest go."""
    timeout: Seconds = 10.0
    """s for an answer of the broker."""
    reconnect_min: Seconds = 1.0
    """s until the first attempt to connect anew; doubled each time, times a random 0.5 to 1."""
    reconnect_max: Seconds = 60.0
    """s between two attempts at most."""

    @model_validator(mode="after")
    def _fits(self) -> MqttSection:
        if (self.user is None) != (self.password_file is None):
            raise ValueError("user and password_file go together")
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key go together")
        if not self.tls and (self.ca or self.certificate):
            raise ValueError("ca, certificate and key are of mqtts://")
        if self.reconnect_max < self.reconnect_min:
            raise ValueError("reconnect_max is below reconnect_min")
        given = self.model_fields_set
        if self.format == "sparkplug":
            if self.group is None:
                raise ValueError("sparkplug needs group")
            if "topic" in given:
                raise ValueError("topic is of json; sparkplug has group, node and device")
        elif wrong := sorted(given & {"group", "node", "device", "primary_host"}):
            raise ValueError(f"{wrong[0]} is of format = 'sparkplug'")
        return self

    @property
    def tls(self) -> bool:
        """Whether nobody on the way can read or forge what is published."""
        return urlsplit(self.url).scheme == "mqtts"


@dataclass(frozen=True)
class MqttSetup:
    """An ``[mqtt]`` section that was found to fit.

    Attributes
    ----------
    section
        It.
    host, port
        The broker.
    topic
        Begins every topic.
    node, device
        Sparkplug's names of the run and of the machine.
    client_id
        As the broker knows this run.
    buffer
        File of what waits.
    files
        Of the keys that name one: its path.
    """

    section: MqttSection
    host: str
    port: int
    topic: str
    node: str
    device: str
    client_id: str
    buffer: Path
    files: dict[str, Path]

    @property
    def below(self) -> str:
        """What all of its topics have in common, for people."""
        if self.section.format == "sparkplug":
            return f"{self.section.group} (Sparkplug: {self.node}, {self.device})"
        return self.topic

    @property
    def resource(self) -> str:
        """The broker as links spell what they reach."""
        return resources.tcp(self.host, self.port)

    def task(self) -> dict[str, Any]:
        """What the process that publishes has to know, as JSON takes it."""
        section = self.section
        return {
            "host": self.host,
            "port": self.port,
            "tls": section.tls,
            "format": section.format,
            "topic": self.topic,
            "group": section.group,
            "node": self.node,
            "device": self.device,
            "primary_host": section.primary_host,
            "client_id": self.client_id,
            "user": section.user,
            "version": section.version,
            "buffer": str(self.buffer),
            "max_bytes": section.max_bytes,
            "timeout": section.timeout,
            "reconnect_min": section.reconnect_min,
            "reconnect_max": section.reconnect_max,
            **{key: str(path) for key, path in self.files.items()},
        }


def mqtt_setup(source: TomlSource, path: Path, section: MqttSection, machine: str) -> MqttSetup:
    """Check an ``[mqtt]`` section.

    Parameters
    ----------
    source
        The file, for the places of errors.
    path
        The file's path.
    section
        The section.
    machine
        The machine's name.

    Raises
    ------
    InputError
        For a package or a file that is missing, and for a password that anybody could listen in on.
    """
    for module, package, extra in NEEDED[section.format]:
        if not _is_installed(module):
            raise source.error(
                f"MQTT needs {package}", ("mqtt",), expected=f"pip install 'abbe[{extra}]'"
            )
    folder = path.parent.absolute()
    files = {}
    for key in ("password_file", "ca", "certificate", "key"):
        name = getattr(section, key)
        if name is not None:
            files[key] = folder / name
            if not files[key].is_file():
                raise source.error("no such file", ("mqtt", key), found=str(files[key]))
    parts = urlsplit(section.url)
    host, port = parts.hostname or "", parts.port or _PORTS[parts.scheme]
    if section.user is not None and not section.tls and not resources.on_this_computer(host):
        raise source.error(
            "a password that is sent over a network in the clear is everybody's",
            ("mqtt", "url"),
            found=section.url,
            expected="mqtts://, or a broker on 127.0.0.1",
        )
    level = as_level(machine)
    return MqttSetup(
        section,
        host,
        port,
        section.topic.replace(MACHINE, level),
        section.node.replace(MACHINE, level),
        section.device.replace(MACHINE, level),
        section.client_id or f"abbe-{level}"[:100],
        data_folder(path).absolute() / section.buffer,
        files,
    )


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # the package that it lies in
        return False


def as_level(name: str) -> str:
    """A machine's name as one level of a topic: what a topic cannot hold becomes ``-``.

    >>> as_level("Mill 7/left +X#")
    'Mill 7-left -X-'
    """
    return re.sub(r"[/+#$\x00-\x1f\x7f-\x9f\ud800-\udfff]", "-", name)[:100] or "machine"
