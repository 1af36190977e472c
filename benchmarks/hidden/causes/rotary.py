"""What may be hidden in a machine with rotary axes: location, error motions, play, heat.

As in `catalogued`: from physics, for the exact chain, with no view of the effects' code. Error
motions of a rotary axis are those of its rotor as its stator sees them (ISO 230-7).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden.campaigns.rotary_plan import LAYOUTS, Layout
from benchmarks.hidden.causes.cause import POINT, Cause, State, six

F64 = NDArray[np.float64]

SPINDLE = "spindle"
"""A cause's place: what stands between the last axis and the tool, in the tool's own axes."""

HIDDEN: dict[str, tuple[str, ...]] = {
    "rotary_location: place": ("trunnion", "turntable", "swivel"),
    "rotary_location: lean": tuple(LAYOUTS),
    "rotary_positioning": tuple(LAYOUTS),
    "rotary_radial": tuple(LAYOUTS),
    "rotary_axial": tuple(LAYOUTS),
    "rotary_tilt": tuple(LAYOUTS),
    "lobes of a rotary axis": tuple(LAYOUTS),
    "backlash of a rotary axis": tuple(LAYOUTS),
    "spindle growth beside rotary axes": tuple(LAYOUTS),
    "gravity_flexure": tuple(name for name, layout in LAYOUTS.items() if layout.stands),
}
"""Cause → the machines in which it differs from what is modelled. Where the lines of a head's
axes lie is a tool off its centre: a circle, as the first wave of the radial motion that is
modelled, or a shift, as a ball that lies elsewhere. Gravity turns what an axis carries about the
axis itself where this lies level: it differs only where the axis's positioning is not modelled."""


def causes(layout: Layout, rng: np.random.Generator) -> dict[str, Cause]:
    """All keys of `HIDDEN` for one machine."""
    turning = layout.axes[3:]
    full = layout.swept
    some = turning[int(rng.integers(len(turning)))]
    phase = float(rng.uniform(0.0, 2.0 * np.pi))
    mix = rng.normal(size=2)
    mix /= np.linalg.norm(mix)
    own = {a: "ABC".index(a) for a in turning}
    side = [k for k in range(3) if k != own[full]]
    d = side[int(rng.integers(2))]
    tilted = side[int(rng.integers(2))]

    def wave(state: State, axis: str, lobes: int) -> F64:
        return np.asarray(np.cos(lobes * np.asarray(state[axis]) - phase))

    def constants(state: State, axis: str, first: int) -> F64:
        one, two = (k for k in range(3) if k != own[axis])
        n = np.ones(len(np.asarray(state["t"])))
        return six(state, first + one, mix[0] * n) + six(state, first + two, mix[1] * n)

    heads = [a for a in turning if f"{a}'" not in layout.structure]
    found = [
        Cause(
            "rotary_location: place",
            full,
            lambda s: constants(s, full, 0),
            (("rotary_location", {"axis": full}),),
            omits=("rotary_location", {"axis": full}),
        ),
        Cause(
            "rotary_location: lean",
            full,
            lambda s: constants(s, full, 3),
            (("rotary_location", {"axis": full}),),
            size=5e-6,
            omits=("rotary_location", {"axis": full}),
        ),
        Cause(
            "rotary_positioning",
            some,
            lambda s: six(s, 3 + own[some], wave(s, some, 1 if some == full else 2)),
            (("rotary_positioning", {"axis": some}),),
            size=5e-6,
            omits=("rotary_positioning", {"axis": some}),
        ),
        Cause(
            "rotary_radial",
            full,
            lambda s: six(s, d, wave(s, full, 2)),
            (("rotary_radial", {"axis": full, "direction": "XYZ"[d]}),),
            omits=("rotary_radial", {"axis": full, "direction": "XYZ"[d]}),
        ),
        Cause(
            "rotary_axial",
            full,
            lambda s: six(s, own[full], wave(s, full, 1)),
            (("rotary_axial", {"axis": full}),),
            omits=("rotary_axial", {"axis": full}),
        ),
        Cause(
            "rotary_tilt",
            full,
            lambda s: six(s, 3 + tilted, wave(s, full, 2)),
            (("rotary_tilt", {"axis": full, "direction": "XYZ"[tilted]}),),
            size=5e-6,
            omits=("rotary_tilt", {"axis": full, "direction": "XYZ"[tilted]}),
        ),
        Cause(
            "lobes of a rotary axis",
            full,
            lambda s: six(s, d, wave(s, full, 3)),
            (
                ("rotary_radial", {"axis": full, "direction": "XYZ"[d], "harmonics": 4}),
                ("rotary_radial", {"axis": full, "direction": "XYZ"[d]}),
            ),
        ),
        Cause(
            "backlash of a rotary axis",
            full,
            lambda s: six(s, 3 + own[full], 0.5 * np.asarray(s[f"{full}_dir"])),
            (("backlash", {"axis": full}),),
            size=5e-6,
        ),
        Cause(
            "spindle growth beside rotary axes",
            SPINDLE if heads else POINT,
            lambda s: six(s, 2, s["T_spindle"] - 20.0),
            (("thermal_offset", {"direction": "Z", "signal": "T_spindle"}),),
        ),
    ]
    if layout.stands is not None:
        tilts = layout.stands[0]
        found.append(
            Cause(
                "gravity_flexure",
                tilts,
                # upright no moment, lying the whole: weight times its arm's level part
                lambda s: six(s, 3 + own[tilts], np.sin(np.asarray(s[tilts]))),
                (("gravity_flexure", {"axis": tilts}),),
                size=5e-6,
                omits=("rotary_positioning", {"axis": tilts}),
            )
        )
    return {c.name: c for c in found}
