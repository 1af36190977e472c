"""``abbe measure`` on a real five-axis LinuxCNC: a sphere, a table that tilts, a head that does."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.rotations import spheres
from abbe.compcore.planning.targets import SurveyTask
from tests.support.daemon.command_line import abbe
from tests.support.daemon.measuring import rms
from tests.support.drivers.linuxcnc import five_axis_artefact as artefact
from tests.support.drivers.linuxcnc.touched_campaign import CONFIG, LATE_UM, MODEL, PLAN
from tests.support.drivers.linuxcnc.touching_mill import TIP, TOOL, TouchingMill, says

pytestmark = [pytest.mark.integration, pytest.mark.calibration, pytest.mark.timeout(900)]

DIAMETER = 25.0
ASIDE = np.array([0.6, -0.9, 0.7])
"""mm by which the sphere stands off the plan."""
LONGEST = 600.0
"""s for a program to come to its end."""
SPACE = WorkingSpace(radius=20.0, table=110.0)
STRUCTURES = {"trunnion": "w C' A' b X Y Z t", "fork": "w b X Y Z C A t"}
LINES = {
    "trunnion": (artefact.A_LINE, artefact.C_LINE),
    "fork": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
}


def write_files(folder: Path, kind: str) -> list[PlannedSetup]:
    """Model, configuration and a plan: A turns, C turns, few targets; its set-ups."""
    a, c = (list(line) for line in LINES[kind])
    axes = (
        f"A = {{ travel = [-95.0, 60.0], location = {a} }}\n"
        f"C = {{ travel = [-200.0, 200.0], location = {c} }}\n"
        '[[effects]]\nkind = "rotary_location"\naxis = "A"\n'
        '[[effects]]\nkind = "rotary_location"\naxis = "C"\n'
    )
    structure = STRUCTURES[kind]
    model = folder / "model.toml"
    model.write_text(MODEL.format(structure=structure, axes=axes), encoding="utf-8")
    pin = '{ pin = "axis.%s.pos-cmd", scale = 0.017453292519943295, unit = "rad" }'
    config = CONFIG.format(
        tip=TIP, more='[axes.A]\nsource = "mill.a"\n[axes.C]\nsource = "mill.c"',
        channels=f"a = {pin % 'a'}\nc = {pin % 'c'}", probing=f"sphere = {DIAMETER}",
    )  # fmt: skip
    (folder / "config.toml").write_text(config, encoding="utf-8")
    task = SurveyTask(load_model(model), SPACE, tools={"P": TOOL})
    chosen = []
    for axis in "AC":
        # the other axis somewhere else than at 0
        mine = [s for s in spheres(task, INSTRUMENTS["sphere"]) if s.axis == axis]
        other = "C" if axis == "A" else "A"
        setup = next(s for s in mine if abs(s.targets[other][0]) > 0.1)
        few = np.linspace(0, setup.count - 1, 3).round().astype(int)
        few_targets = {a: q[few] for a, q in setup.targets.items()}
        chosen.append(replace(setup, name=f"s{axis}", targets=few_targets, u=setup.u[few]))
    text = f"table_radius = {SPACE.table}\ntool_radius = {SPACE.radius}\n[tools]"
    plan = PLAN.partition("[[setups]]")[0].format(structure=structure).replace("[tools]", text)
    for setup in chosen:
        names = list(setup.targets)
        turned = [np.degrees(q) if a in "AC" else q for a, q in setup.targets.items()]
        rows = np.round(np.stack(turned, axis=1), 4).tolist()
        plan += (
            f'[[setups]]\nname = "{setup.name}"\nwhat = "by hand"\ninstrument = "sphere"\n'
            f'kind = "displacement"\nfree = ["frame"]\ntool = "P"\naxis = "{setup.axis}"\n'
            f"both_ways = false\naxes = {names}\ntargets = {rows}\nsd = [0.5]\n"
            "read = [[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]\n"
        )
    (folder / "plan.toml").write_text(plan, encoding="utf-8")
    return chosen


def shown_and_off(
    meets: Callable[..., tuple[float, float, float]],
    start: np.ndarray,
    a: np.ndarray,
    c: np.ndarray,
    values: np.ndarray,
) -> tuple[float, float]:
    """How much rows (n, 3), mm, show, and how far they are off the truth, rms, µm."""
    poses = list(zip(a, c, strict=True))
    really = np.array([meets(start, *x) for x in poses])
    believed = np.array([meets(start, *x, 0.0) for x in poses])
    left = values - (believed - says(really))
    # where it stands is free: a place that goes with the table
    places = np.concatenate([
        np.stack([np.subtract(meets(start + e, *x, 0.0), meets(start, *x, 0.0))
                  for e in np.eye(3)], axis=1)
        for x in poses
    ])  # fmt: skip
    aside, *_ = np.linalg.lstsq(places, left.ravel(), rcond=None)
    return rms(1e3 * (values - values.mean())), rms(1e3 * (left.ravel() - places @ aside))


@pytest.mark.parametrize("kind", ["trunnion", "fork"])
def test_a_sphere_touched_at_every_tilt_shows_how_the_machine_turns(
    kind: str, tmp_path: Path
) -> None:
    """Rows against screws, lines and tool that nobody knows; then `abbe fit`."""
    setups = write_files(tmp_path, kind)
    meets: Callable[..., tuple[float, float, float]] = getattr(artefact, kind)
    machine = load_model(tmp_path / "model.toml").machine
    leans, campaigns = [], []
    with TouchingMill(DIAMETER, "AC", kind) as mill:
        for setup in setups:
            start = np.array(setup.optics["the sphere stands"]) + ASIDE
            mill.stand(start)
            done = abbe("measure", tmp_path / "plan.toml", tmp_path / "config.toml", "-o",
                        tmp_path / f"{setup.name}.csv", "--setup", setup.name, "--yes")  # fmt: skip
            assert done.status == 0, (done.out, done.err)
            campaigns.append(tmp_path / f"{setup.name}.csv")
            c = read_campaign(campaigns[-1], machine)
            a, turn = (np.degrees(c.conditions.positions[x][::3]) for x in "AC")
            leans.append(float(np.abs(a).max()))
            shown, off = shown_and_off(meets, start, a, turn, c.value.reshape(-1, 3))
            print(f"{kind} {setup.name}: {shown:.1f} µm shown, {off:.2f} µm off")
            assert shown > 15.0
            assert off < LATE_UM
    assert max(leans) > 50.0
    done = abbe("fit", tmp_path / "model.toml", *campaigns, "-o", tmp_path / "fitted.toml")
    assert done.status == 0, done.err
    done = abbe("verify", tmp_path / "fitted.toml", *campaigns)
    assert done.status == 0, done.err
    assert done.out.count("fitted (") == 2


def test_a_program_that_touches_is_run_and_its_file_imported(tmp_path: Path) -> None:
    """No link: `abbe program`, LinuxCNC runs it, `abbe import-campaign`."""
    setup = write_files(tmp_path, "trunnion")[0]
    program, campaign = tmp_path / "p.ngc", tmp_path / "c.csv"
    done = abbe("program", tmp_path / "plan.toml", "--controller", "linuxcnc", "--sphere",
                str(DIAMETER), "--tip", str(TIP), "--setup", setup.name, "-o", program)  # fmt: skip
    assert done.status == 0, done.err
    lines = program.read_text("ascii").splitlines()
    start = np.array(setup.optics["the sphere stands"]) + ASIDE
    with TouchingMill(DIAMETER, "AC", "trunnion") as mill:
        mill.stand(start)
        mill.order("load", str(program))
        assert mill.order("run") == []
        until, resumed = time.monotonic() + LONGEST, False
        while True:
            time.sleep(0.2)
            assert time.monotonic() < until
            idle, rests, line = mill.state()
            if idle and line > lines.index("M0") + 2:
                break
            if rests and not resumed and abs(line - lines.index("M0")) < 3:
                resumed = mill.order("resume") == []
        assert mill.order("mdi", "G4 P0") == []
        text = (mill.folder / "probed.csv").read_text("ascii")
    (tmp_path / "probed.csv").write_text(text, encoding="ascii")
    done = abbe("import-campaign", tmp_path / "probed.csv", "--as", "probed", "--model",
                tmp_path / "model.toml", "--tool", "0,0,-100", "-o", campaign)  # fmt: skip
    assert done.status == 0, done.err
    c = read_campaign(campaign, load_model(tmp_path / "model.toml").machine)
    a, turn = (np.degrees(c.conditions.positions[x][: c.n // 3]) for x in "AC")
    values = c.value.reshape(3, -1).T
    shown, off = shown_and_off(artefact.trunnion, start, a, turn, values)
    print(f"program: {shown:.1f} µm shown, {off:.2f} µm off")
    assert shown > 15.0
    assert off < LATE_UM
