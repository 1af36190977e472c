"""Measuring the simulated machine, as Zhang et al. measured theirs: a campaign file as text.

The instruments see the exact simulator and nothing else, through noise, with an unknown zero (and,
for straightness, an unknown slope) per placing, while the shop's temperature changes.

``fit``
    At 20 °C every axis by laser in both directions every 50 mm (X, Y) or 20 mm (Z): displacement
    and straightness, each along two lines with different probes; rotations by levels and
    autocollimator, Z's roll against a surface plate; face and body diagonals. Again displacements
    and a body diagonal at four other temperatures, 18.8 to 21.3 °C, the angles once more at the
    last. And the workpiece's frame: a calibrated datum sphere at home, probed with four probes,
    and a calibrated straight-edge along Y and X, which are read absolutely. Without them the model
    would be right only but for a rigid displacement.
``check``
    50 lines along arbitrary directions with other probes, on another day; never to be fitted.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Final, Literal, TypeAlias

import numpy as np

from abbe.drivers.simulated.bridge.climate import Climate, Ramp
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, BridgeMachine, make_bridge
from abbe.drivers.simulated.bridge.placings import InstrumentPlacing, fit_sessions, random_lines
from abbe.drivers.simulated.bridge.plant import SENSOR_NOISE, shop_climate

CampaignKind: TypeAlias = Literal["fit", "check"]

KINDS: Final[tuple[CampaignKind, ...]] = ("fit", "check")

ROW_TIME: Final = 12.0
"""From one reading to the next, s."""
PLACING_TIME: Final = 240.0
"""To place an instrument, s."""
SOAK: Final = 3.0 * 3600.0
"""To let the machine settle at another temperature, s."""
RAMP: Final = 3600.0
"""In which the air is brought to it, s."""


def campaign(seed: int = 1, kind: CampaignKind = "fit") -> str:
    """A campaign file's text (``abbe-campaign/1``) of the machine with that seed.

    Parameters
    ----------
    seed
        Of the machine, of its thermistors and of the noise.
    kind
        ``fit`` or ``check``, see the module.

    Raises
    ------
    ValueError
        For another kind.
    """
    if kind not in KINDS:
        raise ValueError(f"campaign kind {kind!r}; expected one of {', '.join(KINDS)}")
    machine = make_bridge(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, KINDS.index(kind), 50]))
    shop = shop_climate(seed)
    sessions = fit_sessions() if kind == "fit" else [(19.0, list(random_lines(rng)))]
    climate, placings, times = _schedule(shop, sessions)
    if kind == "check":
        warmer = (Ramp(0.0, 4 * 3600.0, 1.9),)
        climate = Climate(shop.places, 19.0, warmer, swing=0.2, period=5400.0)

    notes = {
        "fit": "20 C, then 18.8, 19.4, 20.7, 21.3 C; no load; levels and laser alternately",
        "check": "arbitrary lines on another day; never fitted",
    }
    lines = [
        '# format = "abbe-campaign/1"',
        '# machine = "Simulated bridge CMM"',
        '# instrument = "laser interferometer, straightness optics, electronic levels"',
        f'# notes = "{notes[kind]}"',
    ]
    for placing in placings:
        lines.append(f"# [setups.{placing.name}]")
        lines.append(f"# free = {json.dumps(placing.free)}")
    directions = [f"{a}_dir" for a in AXES]
    tools, vector = ["tool_x", "tool_y", "tool_z"], ["ux", "uy", "uz"]
    header = ["time", "setup", "kind", *AXES, *directions, *tools, *vector, "value", "sd", *PLACES]
    lines.append(",".join(header))
    for placing, start in zip(placings, times, strict=True):
        lines += _read(machine, climate, placing, start, rng)
    return "\n".join(lines) + "\n"


def _read(
    machine: BridgeMachine,
    climate: Climate,
    placing: InstrumentPlacing,
    start: float,
    rng: np.random.Generator,
) -> Iterator[str]:
    """The rows of one placing."""
    p = placing.positions
    n = len(p)
    tools = np.broadcast_to(np.asarray(placing.tools, dtype=float), (n, 3))
    time = start + ROW_TIME * np.arange(n)
    temperatures = climate(time)
    if placing.kind == "displacement":
        errors = machine.error(p, temperatures, tools) * 1e3
    else:
        errors = machine.exact.orientation_error(machine.state(p, temperatures)) * 1e6
    value = errors @ placing.u + rng.normal(0.0, placing.sd, n)
    if "zero" in placing.free:
        value += rng.normal(0.0, 3.0)
    if "slope" in placing.free:
        value += rng.normal(0.0, 4.0) * np.linalg.norm(p - p[0], axis=1) * 1e-3
    shown = temperatures + machine.sensor_errors + rng.normal(0.0, SENSOR_NOISE, (n, len(PLACES)))
    moved = np.sign(np.diff(p, axis=0, prepend=p[:1])).astype(int)
    for k in reversed(range(n - 1)):
        # The first position, and where the direction turns: approached as what follows.
        if not moved[k].any():
            moved[k] = moved[k + 1]
    for k in range(n):
        fields = [
            f"{time[k]:.1f}",
            placing.name,
            placing.kind,
            *(f"{q:.4f}" for q in p[k]),
            *(str(d) for d in moved[k]),
            *(f"{c:g}" for c in tools[k]),
            *(f"{c:.10g}" for c in placing.u),
            f"{value[k]:.4f}",
            f"{placing.sd:g}",
            *(f"{t:.4f}" for t in shown[k]),
        ]
        yield ",".join(fields)


def _schedule(
    shop: Climate, sessions: Sequence[tuple[float, list[InstrumentPlacing]]]
) -> tuple[Climate, list[InstrumentPlacing], list[float]]:
    """Put the sessions one after the other: the air's ramps, the placings, when each starts."""
    base = sessions[0][0]
    ramps, placings, times = [], [], []
    clock, air = 0.0, base
    for temperature, session in sessions:
        if temperature != air:
            ramps.append(Ramp(clock, RAMP, temperature - air))
            clock, air = clock + SOAK, temperature
        for placing in session:
            placings.append(placing)
            times.append(clock)
            clock += PLACING_TIME + ROW_TIME * len(placing.positions)
    return Climate(shop.places, base, ramps, swing=0.1, period=2820.0), placings, times
