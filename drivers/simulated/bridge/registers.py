"""The simulated bridge's register map: used by its server, by link configurations, by the docs.

Addresses count from 0, as on the wire (documents that start at 30001 or 40001 add 1). One
read of input registers 0 to 32 gives everything a compensator needs, latched in one
controller cycle; one write of holding registers 0 to 9 gives it back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TRAVELS
from abbe.drivers.simulated.registers import Register, RegisterBlock

UNIT_ID: Final = 1

COUNTS_PER_MM: Final = 10_000
"""Encoders: 0.1 µm a count."""

CORRECTED_COUNTS_PER_MM: Final = 100_000
"""Corrected positions: 0.01 µm a count; int32 reaches ± 21 m."""

ENCODERS: Final[Mapping[str, Mapping[str, int]]] = {
    "X": {"counts_per_mm": COUNTS_PER_MM, "direction": 1, "zero": 0},
    "Y": {"counts_per_mm": COUNTS_PER_MM, "direction": -1, "zero": 12_345_678},
    "Z": {"counts_per_mm": COUNTS_PER_MM, "direction": 1, "zero": -50_000},
}
"""The encoders as they are mounted: Y's counts fall with the position."""

THERMISTOR: Final[Mapping[str, float]] = {"a": 1.032e-3, "b": 2.387e-4, "c": 1.580e-7}
"""YSI 44006, 10 kΩ at 25 °C: Steinhart–Hart constants, 1/K."""

OHMS_PER_COUNT: Final = 0.1

STATUS_BITS: Final = ("idle", "moving", "referenced", "fault", "compensated")
"""Bits of the status word, from bit 0; also the discrete inputs."""

CONTROLLER: Final = RegisterBlock(
    "controller",
    "input",
    0,
    "What a real controller offers. All of it is latched in the same controller cycle.",
    (
        Register(
            "status",
            "uint16",
            "bit 0 idle, 1 moving, 2 referenced, 3 fault, 4 compensated (Abbe's heartbeat lives)",
        ),
        Register("heartbeat", "uint16", "counts up every 0.1 s"),
        Register("sample", "uint32", "number of the controller cycle (1 ms) of this read"),
        *(
            Register(f"count_{a}", "int32", f"encoder of {a}, 0.1 µm a count", "count")
            for a in AXES
        ),
        *(Register(f"R_{p}", "uint32", f"thermistor {p}", "ohm", OHMS_PER_COUNT) for p in PLACES),
        *(
            Register(f"tool_{a}", "int32", f"probe tip's offset in {a}", "mm", 1e-4)
            for a in ("x", "y", "z")
        ),
        *(
            Register(f"direction_{a}", "int16", f"direction in which {a} moved last: 1, 0, -1")
            for a in AXES
        ),
    ),
)

TRUTH: Final = RegisterBlock(
    "truth",
    "input",
    40,
    "What no real controller knows; latched in the same cycle as the encoder counts of the "
    "same request.",
    (
        Register("truth_sample", "uint32", "the cycle, as in `sample`"),
        *(
            Register(f"true_{a}", "float64", f"indicated {a} plus its true error", "mm")
            for a in AXES
        ),
        *(Register(f"indicated_{a}", "float64", f"what the {a} encoder shows", "mm") for a in AXES),
        *(Register(f"true_{p}", "float32", f"true temperature at {p}", "degC") for p in PLACES),
    ),
)

WRITE_BACK: Final = RegisterBlock(
    "write-back",
    "holding",
    0,
    "Abbe's answer, written in one request: the corrected position of an earlier cycle.",
    (
        Register("abbe_status", "uint16", "Abbe's status word"),
        Register("abbe_heartbeat", "uint16", "must change at least once a second"),
        *(
            Register(f"corrected_{a}", "int32", f"corrected {a}, 0.01 µm a count", "mm", 1e-5)
            for a in AXES
        ),
        Register("echo_sample", "uint32", "the `sample` for which the corrected position holds"),
    ),
    writable=True,
)

MATCHED: Final = RegisterBlock(
    "matched",
    "holding",
    10,
    "The truth for the echoed sample, beside the corrected position: one read of holding "
    "registers 2 to 17 gives corrected position, echoed sample, matched sample and truth.",
    (
        Register("matched_sample", "uint32", "the sample that the rest belongs to"),
        *(
            Register(f"matched_true_{a}", "int32", f"true {a} then, 0.01 µm a count", "mm", 1e-5)
            for a in AXES
        ),
        *(
            Register(
                f"matched_indicated_{a}",
                "int32",
                f"indicated {a} then, 0.01 µm a count",
                "mm",
                1e-5,
            )
            for a in AXES
        ),
        Register(
            "matched_state",
            "uint16",
            "0 nothing written yet, 1 matched, 2 the echoed sample is unknown or too old, "
            "3 the corrected position was written without its echo",
        ),
        Register("matched_age", "uint16", "from the sample to the write-back", "ms"),
    ),
)

FAULT: Final = RegisterBlock(
    "fault",
    "holding",
    100,
    "Fault injection and control for tests; no real controller has it.",
    (
        Register("thermistors_open", "uint16", "bit k: thermistor k (T_x1 = bit 0) reads open"),
        Register("thermistors_short", "uint16", "bit k: thermistor k reads 0 Ω"),
        Register("encoders_frozen", "uint16", "bit 0 X, 1 Y, 2 Z: the count stands still"),
        Register("repeatability", "uint16", "standard deviation of the true position", "nm"),
        *(
            Register(f"go_to_{a}", "int32", f"where coil `go_to` sends {a}", "mm", 1e-4)
            for a in AXES
        ),
        Register("temperature_step", "int16", "writing adds it to all places", "K", 0.01),
        Register("hang", "uint16", "writing n: no answer to anything for n ms", "ms"),
        Register("busy", "uint16", "writing n: the next n requests are answered 'device busy'"),
        Register("drop", "uint16", "writing 1: all connections are closed"),
        Register("offline", "uint16", "writing n: not listening for n ms", "ms"),
    ),
    writable=True,
)

COILS: Final = RegisterBlock(
    "switches",
    "coil",
    0,
    "Switches for tests; no real controller has them.",
    (
        Register("stand_still", "bit", "the machine stops where it is"),
        Register("go_to", "bit", "the machine goes to `go_to_X`, `go_to_Y`, `go_to_Z` and stays"),
        Register("heartbeat_stopped", "bit", "the heartbeat register stands still"),
        Register("machine_fault", "bit", "the machine stops and reports a fault"),
        Register("unreferenced", "bit", "the status word says not referenced"),
    ),
    writable=True,
)

DISCRETES: Final = RegisterBlock(
    "status bits",
    "discrete",
    0,
    "The status word's bits.",
    tuple(Register(f"is_{name}", "bit", f"status: {name}") for name in STATUS_BITS),
)

BLOCKS: Final = (CONTROLLER, TRUTH, WRITE_BACK, MATCHED, FAULT, COILS, DISCRETES)

REGISTERS: Final[Mapping[str, Register]] = {r.name: r for b in BLOCKS for r in b.registers}
"""Every register by its name."""

INPUT_SIZE: Final = 80
"""Input registers 0 to 79 can be read in one request; those in no block read 0."""


def transducer_configs(
    encoders: Mapping[str, Mapping[str, int]] = ENCODERS,
) -> dict[str, dict[str, Any]]:
    """Transducer sections for a link configuration, by register name.

    `abbe.drivers.transducers` reads them: counts to mm, ohms to °C, and the corrected positions
    from mm back to counts. The thermistor registers' scale (0.1 Ω) is already applied by the link.
    """
    counts: dict[str, dict[str, Any]] = {
        f"count_{a}": {"type": "encoder", "bits": 32, "travel": list(TRAVELS[a]), **encoders[a]}
        for a in AXES
    }
    ohms: dict[str, dict[str, Any]] = {
        f"R_{p}": {"type": "steinhart-hart", **THERMISTOR, "r25": 10_000.0} for p in PLACES
    }
    return counts | ohms


def register_map() -> str:
    """The register map as Markdown, one table a block, for people."""
    lines = []
    for block in BLOCKS:
        access = "read and write" if block.writable else "read only"
        lines += [f"### {block.name} ({block.table}, {access})", "", block.doc, ""]
        lines += [
            "| address | name | type | unit | scale | what |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for r in block.registers:
            last = r.address + r.size - 1
            where = f"{r.address}" if r.size == 1 else f"{r.address}–{last}"
            scale = "" if r.scale == 1.0 else f"{r.scale:g}"
            lines.append(f"| {where} | `{r.name}` | {r.type} | {r.unit} | {scale} | {r.doc} |")
        lines.append("")
    return "\n".join(lines)
