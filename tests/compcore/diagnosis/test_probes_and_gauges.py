"""What a probe or a gauge does is theirs: styli that bend, lobes, a wrong coefficient."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

AXES = {"X": Axis("X", (0.0, 600.0)), "Y": Axis("Y", (0.0, 600.0)), "Z": Axis("Z", (-500.0, 0.0))}
CMM = Machine("cmm", Structure.parse("w b Y X Z t"), AXES, {"T_g": Signal("T_g", role="workpiece")})
MODEL = Model(CMM, ())


def campaign(rows: list[str], free: dict[str, str], more: str = ""):
    head = ['# format = "abbe-campaign/1"']
    for name, what in free.items():
        head += [f"# [setups.{name}]", f'# free = ["{what}"]']
    head.append(f"time,setup,kind,X,Y,Z,tool_x,tool_y,tool_z,ux,uy,uz,value{more}")
    return as_campaign("\n".join(head + rows) + "\n", MODEL)


def spheres(error):
    """Three spheres, touched from the pole to the equator; µm by direction and stylus."""
    rng, rows, free = np.random.default_rng(2), [], {}
    for k, stylus in enumerate((80.0, 250.0, 150.0)):
        free[f"s{k}"] = "frame"
        for i in range(18):
            high, turn = 1.0 - 0.95 * i / 17, 2.399963 * i
            out = np.sqrt(1.0 - high**2)
            u = np.array([out * np.cos(turn), out * np.sin(turn), high])
            at = np.array([100.0 + 120.0 * k, 400.0 - 90.0 * k, -400.0 + stylus]) + 12.5 * u
            value = error(u, stylus) + rng.normal(0.0, 0.3)
            where = ",".join(f"{v:.6f}" for v in (*at, 0.0, 0.0, -stylus, *u))
            rows.append(f"{8 * len(rows)},s{k},displacement,{where},{value:.3f}")
    return campaign(rows, free)


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        ("stylus_bending", lambda u, stylus: -0.5 * (stylus / 100.0) ** 3 * (1.0 - u[2] ** 2)),
        (
            "probe_lobing",
            lambda u, stylus: 2.5 * (u[0] ** 3 - 3 * u[0] * u[1] ** 2) / (1.0001 - u[2] ** 2),
        ),
    ],
)
def test_what_goes_by_the_direction_of_touching_is_the_probes(kind, error):
    """In the order of the points direction and time are one: no drift of each sphere."""
    found = diagnose(MODEL, spheres(error))
    assert [e.effect.spec for e in found.established] == [f"{kind} setups=s0,s1,s2"]
    assert found.established[0].effect.scope == "instrument"
    if kind == "stylus_bending":
        assert found.established[0].estimates[0].value == pytest.approx(-0.5e-3, rel=0.05)


def test_a_gauge_with_a_wrong_coefficient_is_no_scale_of_the_machine():
    """Two days of a step gauge along X, Y and across; laser lines of the machine say 0."""
    rng, rows, free = np.random.default_rng(4), [], {}
    ways = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "D": (np.sqrt(0.5), np.sqrt(0.5), 0.0)}
    for day, warm in enumerate((22.0, 24.5)):
        for holds in ("laser", "g"):
            for way, u in ways.items():
                name = f"{holds}{way}{day}"
                free[name] = "zero"
                for i in range(13):
                    at = 50.0 + 500.0 * i / 12 * np.array(u)
                    middle = 500.0 * (i / 12 - 0.5)
                    wrong = 7e-6 * (warm - 20.0) * middle * 1e3 if holds == "g" else 0.0
                    rows.append(
                        f"{86400 * day + 9 * len(rows)},{name},displacement,"
                        f"{at[0]:.4f},{at[1]:.4f},"
                        f"-200,0,0,-100,{u[0]:.6f},{u[1]:.6f},{u[2]:.6f},"
                        f"{wrong + rng.normal(0.0, 0.3):.3f},{warm + rng.normal(0.0, 0.02):.2f}"
                    )
    found = diagnose(MODEL, campaign(rows, free, ",T_g"))
    (cause,) = found.established
    assert cause.effect.spec == "gauge_expansion signal=T_g setups=gX0,gY0,gD0,gX1,gY1,gD1"
    assert cause.estimates[0].value == pytest.approx(-7e-6, rel=0.1)
