"""The configuration of the demo, written from what the simulated machine says of itself."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

AXES = ("X", "Y", "Z")

WRITTEN_BY = "# Written by `abbe demo`"
"""First words of a demo's configuration, by which its folder is known again."""

_HEAD = """\
# Written by `abbe demo` for the simulated bridge CMM. `abbe check` shows what it links.
format = "abbe-config/1"
model = "{model}"

[cycle]
period = {period}              # s
signals_every = 0.1        # s

[guard]
max_correction = 0.1       # mm, each of X, Y, Z
max_rate = 0.5             # mm/s
stale_after = 0.3          # s without a fresh position
signals_stale_after = 5.0  # s without a fresh temperature
hold = 1.0                 # s on the last good correction, then
ramp = 2.0                 # s down to zero, and later back in

[controller]
heartbeat = "cmm.heartbeat"
status = "cmm.status"
require = 4                # bit 2: referenced
forbid = 8                 # bit 3: fault

[tool]
sources = ["cmm.tool_x", "cmm.tool_y", "cmm.tool_z"]

[journal]
file = "journal.log"
"""

_OUTPUT = """
[output]
status = "cmm.abbe_status"
heartbeat = "cmm.abbe_heartbeat"
echo = [{ source = "cmm.sample", target = "cmm.echo_sample" }]
"""


_RECORDS = """
[records]
every = 0.2                # s: a demo is short
"""

_HTTP = """
[http]                     # its Unix socket streams the cycles to the workbench
"""


def demo_configuration(
    ready: Mapping[str, Any],
    model: str,
    period: float = 0.02,
    *,
    records: bool = False,
    http: bool = False,
) -> str:
    """The text of a configuration for a simulated bridge.

    Parameters
    ----------
    ready
        The simulator's ready line: host, port, unit, registers, transducers.
    model
        Path of the model file, relative to the configuration.
    period
        s from one cycle to the next.
    records, http
        Whether it keeps records; whether it can be looked at over HTTP.
    """
    registers = {r["name"]: r for r in ready["registers"]}
    transducers: Mapping[str, Mapping[str, Any]] = ready["transducers"]
    sensors = sorted(
        (n for n in transducers if n.startswith("R_")), key=lambda n: registers[n]["address"]
    )
    parts = [_HEAD.format(model=model, period=period)]
    parts += [_axis(axis, transducers[f"count_{axis}"]) for axis in AXES]
    parts += [_signal(name.removeprefix("R_"), name, transducers[name]) for name in sensors]
    parts += [text for text, wanted in ((_RECORDS, records), (_HTTP, http)) if wanted]
    parts.append(_OUTPUT)
    parts += [f'[output.axes.{a}]\ntarget = "cmm.corrected_{a}"\n' for a in AXES]
    parts.append("# Where the machine really is: shown beside, never used.\n")
    parts += [f'[reference.{a}]\nsource = "cmm.true_{a}"\n' for a in AXES]
    names = [
        "status",
        "heartbeat",
        "sample",
        *(f"count_{a}" for a in AXES),
        *sensors,
        *(f"tool_{a}" for a in "xyz"),
        *(f"direction_{a}" for a in AXES),
        *(f"true_{a}" for a in AXES),
        "abbe_status",
        "abbe_heartbeat",
        *(f"corrected_{a}" for a in AXES),
        "echo_sample",
    ]
    parts.append(
        f'\n[links.cmm]\ndriver = "modbus"\ntransport = "tcp"\nhost = {json.dumps(ready["host"])}\n'
        f"port = {ready['port']}\nunit_id = {ready['unit']}\ntimeout = 0.3              # s\n"
        "max_gap = 16               # so that positions and truth come in one request\n"
        'separate = ["tables"]      # input and holding registers are memories of their own\n\n'
        "[links.cmm.channels]"
    )
    parts += [_channel(registers[name]) for name in names]
    return "\n".join(parts) + "\n"


def _axis(axis: str, transducer: Mapping[str, Any]) -> str:
    table = _inline(transducer.items())
    return (
        f'[axes.{axis}]\nsource = "cmm.count_{axis}"\ndirection = "cmm.direction_{axis}"\n'
        f"transducer = {table}\n"
    )


def _signal(name: str, channel: str, transducer: Mapping[str, Any]) -> str:
    table = _inline(transducer.items())
    return f'[signals.{name}]\nsource = "cmm.{channel}"\ntransducer = {table}\n'


def _channel(register: Mapping[str, Any]) -> str:
    keys: dict[str, Any] = {k: register[k] for k in ("table", "address", "type")}
    if register["scale"] != 1.0:
        keys["scale"] = register["scale"]
    if register["unit"]:
        keys["unit"] = register["unit"]
    if register["writable"]:
        keys["writable"] = True
    return f"{register['name']} = {_inline(keys.items())}"


def _inline(items: Iterable[tuple[str, Any]]) -> str:
    return "{ " + ", ".join(f"{k} = {json.dumps(v)}" for k, v in items) + " }"
