"""`abbe calibrate` of a machine that only probes: a plate, a gauge, from plan to certificate."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.compcore.machine.conditions import Conditions
from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.commands.calibration.guide import calibrate
from abbe.daemon.config import load_config
from abbe.daemon.measure import show
from abbe.daemon.measure.events import MeasureEvent, Tell
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon import gauge_measuring, plate_measuring, sphere_measuring
from tests.support.daemon.command_line import Done, abbe
from tests.support.daemon.gauge_measuring import BLOCK, HEIGHT, WIDTH

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

EFFECTS = (
    "".join(
        f'[[effects]]\nkind = "positioning"\naxis = "{a}"\nshape = "polynomial:1"\n' for a in "XY"
    )
    + '[[effects]]\nkind = "squareness"\naxes = ["Y", "X"]\n'
)
"""Less than the machine has: what plates in its corners do not show, lengths in its middle do."""


def write_files(folder: Path, port: int) -> None:
    """Model, configuration and certificates: a plate of nine balls, a block of 300 mm."""
    plate_measuring.write_files(folder, port, 3, 130.0, EFFECTS, 'gauge = "gauge.csv"\nplacing = 4')
    rows = "".join(f"{i},{at}\n" for i, at in enumerate(BLOCK, start=1))
    head = f"# width = {WIDTH}\n# height = {HEIGHT}\n# sd = 0.1\n# expansion = 11.5\nface,at\n"
    (folder / "gauge.csv").write_text(head + rows, encoding="utf-8")


def without(folder: Path, line: str) -> None:
    """The configuration without a line."""
    config = folder / "config.toml"
    text = config.read_text("utf-8")
    assert line in text
    config.write_text(text.replace(line, ""), encoding="utf-8")


@pytest.fixture
def laid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[SimulatedProcess, Path]]:
    """The machine, and a person who lays what is asked for where it is asked for."""
    with plate_measuring.machine() as process:
        write_files(tmp_path, process.ready["port"])
        folder = tmp_path / "calibration"

        def tell(event: MeasureEvent) -> None:
            if event.kind != "set up":
                return
            name = str(event.about["setup"])
            plan = folder / ("check.toml" if (folder / "check.toml").exists() else "plan.toml")
            setups = read_plan(plan, load_model(tmp_path / "model.toml").machine).setups
            setup = next(s for s in setups if s.name == name)
            process.order("clean")
            if setup.instrument.key == "ball-plate":
                (tmp_path / "plan.toml").write_bytes(plan.read_bytes())
                plate_measuring.lay(process, tmp_path, name, aside=(1.0, -0.7, 0.5))
            else:
                gauge_measuring.lay(process, setup, BLOCK)

        @contextmanager
        def telling(*, as_json: bool) -> Iterator[Tell]:
            assert not as_json
            yield tell

        monkeypatch.setattr(show, "telling", telling)
        yield process, tmp_path


TIME = "40min"


def calibrated(folder: Path, *more: str) -> Done:
    """`abbe calibrate`, nobody asked."""
    return abbe("calibrate", folder / "config.toml", "--folder", folder / "calibration", "--yes",
                "--tool", "P=0,0,-150", "--time", TIME, "--check-time", "40min", *more)  # fmt: skip


def led(folder: Path) -> tuple[bool, list[str]]:
    """All steps, no cause added; whether they are done, and what was said."""
    said: list[str] = []
    request = CalibrationRequest(
        load_config(folder / "config.toml"), folder / "calibration", TIME, "40min",
        ("P=0,0,-150",), "", "", yes=True,
    )  # fmt: skip

    def ask(question: str, *, default: bool = True) -> bool:
        return default and not question.startswith("add ")

    return calibrate(request, said.append, ask), said


@pytest.mark.thorough
def test_by_a_plate_and_verified_by_a_block(
    laid: tuple[SimulatedProcess, Path],
) -> None:
    """All steps; what is left of the machine where nothing lay, against the exact machine."""
    process, folder = laid
    # by the model to begin with: three effects that cannot bend were verified or not by chance
    (folder / "model.toml").write_text(plate_measuring.MODEL.format(effects=""), "utf-8")
    done, said = led(folder)
    assert done, said
    own = folder / "calibration"
    state = json.loads((own / "calibration.json").read_text("utf-8"))
    assert list(state["steps"]) == ["start", "plan", "measure", "fit", "diagnose",
                                    "check-plan", "check", "verify", "live"]  # fmt: skip
    top = (own / "live.toml").read_text("utf-8").splitlines()
    assert top[0].startswith("# VERIFIED. ")
    before, after = map(float, re.findall(r"([\d.]+)(?: before| µm rms after)", top[1]))
    assert after < before
    machine = load_model(own / "calibrated.toml").machine
    plan, check = (read_plan(own / n, machine).setups for n in ("plan.toml", "check.toml"))
    assert {s.instrument.key for s in plan} == {"ball-plate"}
    assert {s.instrument.key for s in check} == {"gauge-block"}
    assert "gauge of 300 mm" in check[0].what
    # what is judged is what the exact machine has
    found = read_campaign(own / "check.csv", machine)
    assert found.conditions.setup is not None
    assert found.conditions.u is not None
    assert len(found.setups) > 1
    for name in found.setups:
        rows = np.flatnonzero(found.conditions.setup == name)[:2]
        at = np.stack([found.conditions.positions[a][rows] for a in "XYZ"], axis=1)
        truth = plate_measuring.exact(process, at)["errors"] @ found.conditions.u[rows[0]]
        assert 1e3 * np.diff(found.value[rows])[0] == pytest.approx(1e3 * np.diff(truth)[0], abs=1)
    page = (own / "certificate.html").read_text("utf-8")
    assert "all readings, rms, after" in page


@pytest.mark.thorough
def test_by_a_plate_alone_it_is_checked_where_the_plate_did_not_lie(
    laid: tuple[SimulatedProcess, Path],
) -> None:
    """In the corners it does not show how an axis bends in the middle, and that is found out."""
    process, folder = laid
    without(folder, 'gauge = "gauge.csv"\n')
    done = calibrated(folder)
    own = folder / "calibration"
    machine = load_model(own / "calibrated.toml").machine
    plan, check = (read_plan(own / n, machine).setups for n in ("plan.toml", "check.toml"))
    assert {s.instrument.key for s in (*plan, *check)} == {"ball-plate"}
    assert not {s.what for s in plan} & {s.what for s in check}
    # what the exact machine has there, less what the model says: the judgement is of the truth
    model = load_model(own / "calibrated.toml")
    found = read_campaign(own / "check.csv", machine)
    assert found.conditions.setup is not None
    assert found.conditions.u is not None
    first = found.rows(found.conditions.setup == found.conditions.setup[0])
    at = np.stack([first.conditions.positions[a] for a in "XYZ"], axis=1)
    u = np.asarray(first.conditions.u)
    true = np.einsum("ij,ij->i", plate_measuring.exact(process, at)["errors"], u)
    told = np.einsum("ij,ij->i", model.predict(first.conditions).translation, u)
    before, after = (1e3 * rms_but_for_its_place(v, at, u) for v in (true, true - told))
    assert done.status == 1, done.out
    assert after > before
    assert f"the check does not pass: {check[0].name}: " in done.err
    assert "the model was fitted to the same artefact" in done.out
    assert not list(own.glob("live*.toml"))


def rms_but_for_its_place(values: np.ndarray, at: np.ndarray, u: np.ndarray) -> float:
    """Of values along u at places, (n,), less what a body that lies otherwise makes of them."""
    moved = np.hstack([u, np.cross(at - at.mean(axis=0), u)])
    place, *_ = np.linalg.lstsq(moved, values, rcond=None)
    return float(np.sqrt(np.mean((values - moved @ place) ** 2)))


@pytest.mark.thorough
def test_by_a_sphere_alone_the_table_is_checked_where_it_did_not_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with plate_measuring.machine() as process:
        sphere_measuring.write_files(tmp_path, process.ready["port"], (0.0, 90.0))
        sphere_measuring.stand(process, tmp_path)
        own = tmp_path / "calibration"

        def tell(event: MeasureEvent) -> None:
            if event.kind == "set up":
                plan = own / ("check.toml" if (own / "check.toml").exists() else "plan.toml")
                setups = read_plan(plan, load_model(tmp_path / "model.toml").machine).setups
                setup = next(s for s in setups if s.name == event.about["setup"])
                place = np.array(setup.optics["the sphere stands"]) + sphere_measuring.ASIDE
                process.order(
                    "plate", balls=[[0.0, 0.0, 0.0]], diameter=sphere_measuring.DIAMETER,
                    at=place.tolist(), thickness=2.0, expansion=0.0,
                )  # fmt: skip

        @contextmanager
        def telling(*, as_json: bool) -> Iterator[Tell]:
            assert not as_json
            yield tell

        monkeypatch.setattr(show, "telling", telling)
        done = abbe("calibrate", tmp_path / "config.toml", "--folder", own, "--yes", "--tool",
                    "P=0,0,-150", "--time", "30min", "--check-time", "1h")  # fmt: skip
        assert done.status == 0, done.err
        # one sphere says far too little of the axes: they are left, and where it never was the
        # exact machine is no worse for it
        model = load_model(own / "calibrated.toml")
        at = np.random.default_rng(1).uniform((20, 20, -340), (680, 880, -20), (60, 3))
        true = np.asarray(plate_measuring.exact(process, at)["errors"])
        there = Conditions(
            {**{a: at[:, i] for i, a in enumerate("XYZ")}, "C": np.zeros(len(at))},
            tool=np.tile((0.0, 0.0, -150.0), (len(at), 1)),
            signals={n: np.full(len(at), 20.0) for n in model.machine.signals},
        )
        told = model.predict(there).translation
        places, u = np.repeat(at, 3, axis=0), np.tile(np.eye(3), (len(at), 1))
        before, after = (rms_but_for_its_place(v.ravel(), places, u) for v in (true, true - told))
        assert after < 1.02 * before
    assert "MOST STAYS: of the errors that a machine usually has" in done.out
    said = (own / "live.toml").read_text("utf-8").splitlines()[1]
    assert "verified: 01_sphere_check: range" in said
    assert "no line was measured: the axes over their travels are not shown" in said
    machine = load_model(own / "calibrated.toml").machine
    plan, check = (read_plan(own / n, machine).setups for n in ("plan.toml", "check.toml"))
    places = [s.optics["the sphere stands"] for s in (*plan, *check)]
    assert len(set(places)) == len(places)
    # where the table lies is not shared out among errors of the axes that could do the same
    location = next(t for t in model.terms if t.effect.kind == "rotary_location")
    found = [1e3 * location.values[name].value for name in ("E_X0C", "E_Y0C")]
    assert found == pytest.approx([-49.0, 43.0], abs=20.0)


def test_a_gauge_alone_is_planned_elsewhere_to_be_checked_by(tmp_path: Path) -> None:
    write_files(tmp_path, 1)
    without(tmp_path, 'plate = "plate.csv"\n')
    refused = calibrated(tmp_path, "--controller", "linuxcnc")
    assert refused.status == 1
    assert "a gauge-block has no program: Abbe moves the machine" in refused.err
    assert not (tmp_path / "calibration").exists()
    done = calibrated(tmp_path, "--upto", "plan")
    assert done.status == 0, done.err
    plan = tmp_path / "calibration" / "plan.toml"
    machine = load_model(tmp_path / "model.toml").machine
    assert all("gauge of 300 mm" in s.what for s in read_plan(plan, machine).setups)
    # another certificate: planned anew
    before = plan.read_bytes()
    gauge = tmp_path / "gauge.csv"
    gauge.write_text(gauge.read_text("utf-8").replace("300.0007", "250.0003"), encoding="utf-8")
    done = calibrated(tmp_path, "--upto", "plan")
    assert done.status == 0, done.err
    assert plan.read_bytes() != before
    assert "gauge of 250 mm" in plan.read_text("utf-8")
