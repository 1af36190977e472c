"""Three runs of Abbe, each for one simulated machine, with everything that goes up from it."""

from __future__ import annotations

import re
from typing import NamedTuple

from abbe.drivers.simulated.bridge.checks import SPHERES
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TOOL
from abbe.drivers.simulated.fleet.device import (
    CORRECTED_AT,
    HEARTBEAT_AT,
    PER_SPHERE,
    SPHERES_AT,
    TEMPERATURES_AT,
)

KIND, SITE = "Bridge 700", "Hall 1"

_HEAD = """\
# Written by `make demo-fleet`. `abbe check` shows what it links.
format = "abbe-config/1"
model = "model.toml"

[cycle]
period = {cycle:g}               # s; a fleet on one computer
signals_every = {signals:g}

[guard]
max_correction = 0.1       # mm, each of X, Y, Z
max_rate = 1.0             # mm/s
stale_after = 3.0          # s without a fresh position
signals_stale_after = 20.0
hold = 2.0
ramp = 2.0

[journal]
file = "journal.log"

[records]
every = 1.0

[http]
listen = ["127.0.0.1:{http}"]
tokens = "http-tokens.toml"

[mqtt]
url = "mqtt://127.0.0.1:{broker}"
topic = "plant/{{machine}}"

[fleet]
url = "postgresql://127.0.0.1:{store}/abbe"
site = "{site}"
user = "{role}"
password_file = "store.secret"
every = {upload:g}
span = 60
campaigns = ["campaigns/*.csv"]

[controller]
heartbeat = "plc.heartbeat"
heartbeat_within = 5.0

[tool]
offset = {tool}

[output]
status = "plc.abbe_status"
heartbeat = "plc.abbe_heartbeat"

[links.plc]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = {port}
unit_id = 1
timeout = 2.0
separate = ["tables"]

[links.plc.channels]
heartbeat = {{ table = "input", address = {heartbeat}, type = "uint16" }}
abbe_status = {{ table = "holding", address = 0, type = "uint16", writable = true }}
abbe_heartbeat = {{ table = "holding", address = 1, type = "uint16", writable = true }}
"""


class Ports(NamedTuple):
    """Where everything of one machine is."""

    machine: int
    http: int
    broker: int
    store: int


class Pace(NamedTuple):
    """How often something happens, s: a cycle, signals are read, records go to the store."""

    cycle: float = 0.1
    signals: float = 0.5
    upload: float = 2.0


def configuration(role: str, ports: Ports, pace: Pace = Pace()) -> str:  # noqa: B008
    """The text of one machine's configuration."""
    parts = [
        _HEAD.format(
            http=ports.http,
            broker=ports.broker,
            store=ports.store,
            port=ports.machine,
            site=SITE,
            role=role,
            tool=list(TOOL),
            heartbeat=HEARTBEAT_AT,
            **pace._asdict(),
        )
    ]
    channels = [_number(axis, 2 * i, "mm") for i, axis in enumerate(AXES)]
    for i, place in enumerate(PLACES):
        channels.append(_number(place, TEMPERATURES_AT + 2 * i, "degC"))
    for i, axis in enumerate(AXES):
        line = _number(f"corrected_{axis}", CORRECTED_AT + 2 * i, "mm", table="holding")
        channels.append(line.replace(" }", ", writable = true }"))
    for k, name in enumerate(SPHERES):
        at = SPHERES_AT + PER_SPHERE * k
        channels.append(f'{name}_n = {{ table = "input", address = {at}, type = "uint16" }}')
        channels += [_number(f"{name}_{axis}", at + 2 + 2 * i, "mm") for i, axis in enumerate(AXES)]
    parts += channels
    for axis in AXES:
        parts.append(f'[axes.{axis}]\nsource = "plc.{axis}"')
        parts.append(f'[output.axes.{axis}]\ntarget = "plc.corrected_{axis}"')
    parts += [f'[signals.{place}]\nsource = "plc.{place}"' for place in PLACES]
    for name in SPHERES:
        found = ", ".join(f'"plc.{name}_{axis}"' for axis in AXES)
        parts.append(
            f'[checks.points.{name}]\ntrigger = "plc.{name}_n"\nfound = [{found}]\n'
            f"tool = {list(TOOL)}\nsd = 0.5"
        )
    return "\n".join(parts) + "\n"


def named(model: str, name: str, fitted: str) -> str:
    """A model file's text for another machine of its type, fitted at another date."""
    text = re.sub(r'(?m)^name = ".*"$', f'name = "{name}"', model, count=1)
    return re.sub(r"(?m)^date = .*$", f'date = "{fitted}"', text, count=1)


def measured(campaign: str, name: str) -> str:
    """A campaign file's text as that of another machine of its type."""
    return re.sub(r'(?m)^# machine = ".*"$', f'# machine = "{name}"', campaign, count=1)


def _number(name: str, address: int, unit: str, table: str = "input") -> str:
    return (
        f'{name} = {{ table = "{table}", address = {address}, type = "float32", unit = "{unit}" }}'
    )
