"""Is the body rigid? A bridge whose beam sags under its carriage, measured in nine places.

Zhang's check of the table's flatness: straightness of X measured at several positions of Y and Z.
On the flexing machine X's vertical straightness grows with where the bridge stands; on the rigid
one nothing does, though levers and squareness are there in full.
"""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.fitting.fit import fit
from abbe.compcore.fitting.rigid_body import Dependence, rigid_body_test
from benchmarks.sources import iso16907, zhang
from benchmarks.sources.campaigns import Rows

FLEX = 4e-3
"""How much further E_ZX bows at the far end of Y than at the near end, mm."""


def run(seed: int, flex: float) -> list[Dependence]:
    """Measure, fit the rigid model, test; `flex` in mm."""
    exact, rng = zhang.machine(), np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    still = {k: np.full(30, v) for k, v in iso16907.REFERENCE.items()}

    def add(setup: str, kind: Kind, place: dict[str, np.ndarray | float], k: str) -> None:
        u = zhang.U[k]
        positions = {
            a: np.broadcast_to(np.asarray(q, dtype=float), (30,)) for a, q in place.items()
        }
        if kind == Kind.DISPLACEMENT:
            value = exact.error({**positions, **still}, zhang.PROBE) @ np.asarray(u)
            sd = zhang.NOISE
        else:
            value = exact.orientation_error({**positions, **still}) @ np.asarray(u)
            sd = zhang.ANGLE_NOISE
        if k == "Z" and kind == Kind.DISPLACEMENT:
            bow = 1.0 - (positions["X"] / 350.0 - 1.0) ** 2
            value = value + flex * bow * positions["Y"] / 900.0
        value = value + rng.normal(0.0, sd, 30)
        free = ("zero", "slope") if kind == Kind.DISPLACEMENT and setup[0] != k else ("zero",)
        rows.add(setup, kind, place, value, sd, u=u, free=free, tool=zhang.PROBE, signals=still)

    for a, travel in zhang.TRAVELS.items():
        q = np.tile(np.linspace(*travel, 15), 2)
        others = [b for b in "XYZ" if b != a]
        for k in "XYZ":
            add(f"{a} about {k}", Kind.ROTATION, {**zhang.MIDDLE, a: q}, k)
            for i, one in enumerate((0.05, 0.5, 0.95)):
                for j, two in enumerate((0.05, 0.5, 0.95)):
                    place = {a: q}
                    for b, part in zip(others, (one, two), strict=True):
                        low, high = zhang.TRAVELS[b]
                        place[b] = low + part * (high - low)
                    add(f"{a} towards {k} at {i}{j}", Kind.DISPLACEMENT, place, k)
    return rigid_body_test(fit(iso16907.geometry(shape="spline:9"), rows.campaign("nine places")))
