"""``abbe new``: what it writes loads, says what it is for, and is fitted as it stands."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import AbbeError
from abbe.compcore.files.campaign_csv.writing import write_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.model_toml.commented import save_commented
from abbe.compcore.machine.common_machines import COMMON_MACHINES
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.model.start_model import start_model
from abbe.daemon.answers.model.new import columns_of
from abbe.daemon.application import app
from abbe.drivers.simulated.bridge.measure import campaign as bridge_campaign
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import random_theta, with_truth
from tests.support.daemon.command_line import abbe

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs" / "new.md").read_text("utf-8")


def travels(name: str) -> list[str]:
    ends = COMMON_MACHINES[name].travels.items()
    return [word for axis, (a, b) in ends for word in ("--travel", f"{axis}={a:g},{b:g}")]


def made(tmp_path: Path, name: str, *options: str) -> Model:
    out = tmp_path / f"{name}.toml"
    done = abbe("new", "--structure", name, *travels(name), *options, "-o", out)
    assert (done.status, done.err) == (0, "")
    return load_model(out)


def measured(model: Model, seed: int) -> Campaign:
    """Rows all over the volume: lengths and angles, both directions, several tools."""
    rng = np.random.default_rng(seed)
    machine = model.machine
    axes = machine.structure.axes
    rows = Rows(axes)
    n = 200
    for k in range(6):
        u = rng.normal(size=(n, 3))
        kind = Kind.ROTATION if k % 3 == 2 else Kind.DISPLACEMENT
        rows.add(
            f"s{k}",
            kind,
            {a: rng.uniform(*machine.axes[a].travel, n) for a in axes},
            np.zeros(n),
            1e-6 if kind == Kind.ROTATION else 1e-3,
            u=u / np.linalg.norm(u, axis=1, keepdims=True),
            tool=(0.0, 0.0, -60.0 - 30.0 * k),
            time=np.arange(n) + 1000.0 * k,
            signals={s: rng.uniform(18.0, 26.0, n) for s in machine.signals},
            directions={a: rng.choice([-1.0, 1.0], n) for a in axes},
        )
    campaign = rows.campaign("everywhere")
    return with_truth(model, campaign, random_theta(model, campaign, rng), rng)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", COMMON_MACHINES)
def test_every_common_machine_gets_a_model_that_is_fitted(tmp_path: Path, name: str) -> None:
    axis = "X"
    sensors = (
        "--sensor",
        f"T_x=scale,{axis}",
        "--sensor",
        "T_s=spindle",
        "--sensor",
        "n=speed,,rpm",
    )
    model = made(tmp_path, name, *sensors, "--play", "--rotary-motions", "--tool-lengths")
    kinds = {effect.kind for effect in model.effects}
    assert {"positioning", "straightness", "angular", "squareness", "backlash"} < kinds
    assert {"scale_expansion", "thermal_offset"} < kinds
    assert ("rotary_location" in kinds) is bool(model.machine.structure.rotary)
    truth = measured(model, seed=len(name))
    assert np.std(truth.value[truth.kind == Kind.DISPLACEMENT]) > 10e-3
    write_campaign(truth, tmp_path / "day.csv")
    done = abbe(
        *("fit", tmp_path / f"{name}.toml", tmp_path / "day.csv"),
        *("-o", tmp_path / "fitted.toml", "--json"),
    )
    assert (done.status, done.err) == (0, "")
    answer = json.loads(done.out)
    assert answer["chi2_per_dof"] == pytest.approx(1.0, abs=0.15)
    assert answer["rms"] < 1.1
    fitted = load_model(tmp_path / "fitted.toml")
    assert all(term.fitted for term in fitted.terms)
    assert fitted.effects == model.effects


def test_a_machine_that_shares_no_formula_with_the_model_is_found(tmp_path: Path) -> None:
    """The simulated bridge: its truth is written apart from the effects."""
    places = [(f"T_{axis.lower()}{k}", axis) for axis in "XYZ" for k in (1, 2)]
    sensors = [w for name, axis in places for w in ("--sensor", f"{name}=scale,{axis}")]
    out = tmp_path / "bridge.toml"
    ends = ("--travel", "X=0,700", "--travel", "Y=0,900", "--travel", "Z=-360,0")
    assert abbe("new", "--structure", "w b Y X Z t", *ends, *sensors, "-o", out).status == 0
    (tmp_path / "fit.csv").write_text(bridge_campaign(1, "fit"), "utf-8")
    (tmp_path / "check.csv").write_text(bridge_campaign(1, "check"), "utf-8")
    fitted = tmp_path / "fitted.toml"
    assert abbe("fit", out, tmp_path / "fit.csv", "-o", fitted).status == 0
    before = json.loads(abbe("compare", out, tmp_path / "check.csv", "--json").out)
    after = json.loads(abbe("compare", fitted, tmp_path / "check.csv", "--json").out)
    assert after["rms"] < 0.1 * before["rms"]


def test_options_say_what_will_be_measured(tmp_path: Path) -> None:
    plain = made(tmp_path, "table-head")
    rich = made(tmp_path, "table-head", "--play", "--rotary-motions", "--tool-lengths")
    more = {e.spec for e in rich.effects} - {e.spec for e in plain.effects}
    assert {spec.split()[0] for spec in more} == {
        *("backlash", "rotary_axial", "rotary_radial", "rotary_tilt", "spindle_squareness"),
    }
    assert {f"backlash axis={axis}" for axis in "XYZ"} < more
    short = made(tmp_path, "c-frame", "--shape", "polynomial:3")
    assert {e.where()["shape"] for e in short.effects if "shape" in e.where()} == {"polynomial:3"}


def test_a_bare_machine_is_what_the_diagnosis_begins_with(tmp_path: Path) -> None:
    model = made(tmp_path, "bridge", "--bare", "--sensor", "T_x=scale,X")
    assert model.effects == ()
    assert model.machine.signals["T_x"].axis == "X"
    out = tmp_path / "bare.toml"
    command = ("new", "--structure", "bridge", *travels("bridge"), "--bare", "-o", out)
    said = abbe(*command, "--force").out
    assert f"abbe diagnose {out} CAMPAIGN.csv --apply" in said
    assert "diagnose bare.toml CAMPAIGN.csv --apply" in out.read_text("utf-8")
    done = abbe(*command, "--force", "--play")
    assert done.status == 1
    assert "beside none at all" in done.err


def test_positioning_alone_is_what_tables_over_single_axes_hold(tmp_path: Path) -> None:
    model = made(tmp_path, "table-table", "--positioning", "--play", "--sensor", "T_x=scale,X")
    kinds = sorted(effect.spec.split()[0] for effect in model.effects)
    linear = [*(["backlash"] * 3), *(["positioning"] * 3)]
    assert kinds == [*linear, *(["rotary_positioning"] * 2), "scale_expansion"]
    done = abbe("new", "--structure", "bridge", *travels("bridge"), "--bare", "--positioning",
                "-o", tmp_path / "b.toml")  # fmt: skip
    assert done.status == 1
    assert "--positioning" in done.err


def test_rotary_axes_are_where_they_were_said_to_be(tmp_path: Path) -> None:
    model = made(tmp_path, "table-table", "--location", "C=300,250,0", "--location", "A=0,250,-80")
    assert model.machine.axes["C"].location == (300.0, 250.0, 0.0)
    assert model.machine.axes["A"].location == (0.0, 250.0, -80.0)
    assert model.machine.axes["A"].travel == pytest.approx(np.radians([-120.0, 30.0]))


def test_json_is_one_object(tmp_path: Path) -> None:
    out = tmp_path / "m.toml"
    words = ("--structure", "lathe", *travels("lathe"), "--sensor", "T_z=screw,Z", "--play")
    done = abbe("new", *words, "-o", out, "--json")
    found = json.loads(done.out)
    model = load_model(out)
    assert found["structure"] == "w (C') b Z X t"
    assert found["travels"] == {"Z": [0.0, 600.0], "X": [0.0, 250.0]}
    assert found["signals"] == {"T_z": {"role": "screw", "unit": "degC"}}
    assert found["effects"] == [effect.spec for effect in model.effects]
    assert "screw_heating axis=Z signal=T_z" in found["effects"]
    sizes = [len(effect.linear(model.machine)) for effect in model.effects]
    assert found["parameters"] == sum(sizes)
    assert found["columns"] == columns_of(model)
    assert {"time", "Z", "X", "Z_dir", "X_dir", "T_z"} < set(found["columns"])


def test_a_unit_may_be_spelled_as_on_a_display(tmp_path: Path) -> None:
    model = made(tmp_path, "c-frame", "--sensor", "T_x=scale,X,°C", "--sensor", "n=speed,,1/min")
    units = {signal.name: signal.unit for signal in model.machine.signals.values()}
    assert units == {"T_x": "degC", "n": "rpm"}
    assert "scale_expansion axis=X signals=T_x" in {effect.spec for effect in model.effects}


def test_names_of_all_kinds_come_back(tmp_path: Path) -> None:
    name = 'Fräs "5" \\ Halle\t#2'
    model = made(tmp_path, "bridge", "--name", name, "--sensor", "T links.1=scale,X")
    assert model.machine.name == name
    assert list(model.machine.signals) == ["T links.1"]


REFUSED = {
    "no travel": (("--structure", "bridge"), "expected --travel Y=LOW,HIGH --travel X=LOW,HIGH"),
    "code": (("--structure", "w b X"), "structure code: t missing"),
    "an axis too many": ((*travels("lathe"), "--structure", "lathe", "--travel", "Y=0,1"), "'Y'"),
    "backwards": (("--structure", "w b X t", "--travel", "X=700,0"), "LOW < HIGH"),
    "one end": (("--structure", "w b X t", "--travel", "X=700"), "LOW,HIGH in mm"),
    "a word": (("--structure", "w b X t", "--travel", "X=0,long"), "found 'long'"),
    "too far": (("--structure", "w b X t", "--travel", "X=0,1e9"), "-100000 to 100000 mm"),
    "a line of X": (
        ("--structure", "w b X t", "--travel", "X=0,9", "--location", "X=0,0,0"),
        "rotary",
    ),
    "role": (("--structure", "w b X t", "--travel", "X=0,9", "--sensor", "T=warm"), "unknown role"),
    "sensor's axis": (
        ("--structure", "w b X t", "--travel", "X=0,9", "--sensor", "T=scale,Q"),
        "no such axis",
    ),
    "sensor's name": (
        ("--structure", "w b X t", "--travel", "X=0,9", "--sensor", "value=scale,X"),
        "has this column for something else",
    ),
    "shape": (
        ("--structure", "w b X t", "--travel", "X=0,9", "--shape", "wavy:3"),
        "unknown shape",
    ),
    "no structure": (("--travel", "X=0,9"), "expected --structure CODE"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_in_a_line(tmp_path: Path, case: str) -> None:
    options, words = REFUSED[case]
    done = abbe("new", *options, "-o", tmp_path / "m.toml")
    assert done.status == 1
    assert words in done.err
    assert len(done.err.splitlines()) == 1
    assert not (tmp_path / "m.toml").exists()


def test_a_file_of_another_kind_is_not_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "notes.txt"
    out.write_text("my notes\n", "utf-8")
    words = ("new", "--structure", "lathe", *travels("lathe"), "-o", out)
    done = abbe(*words)
    assert done.status == 1
    assert "--force overwrites it" in done.err
    assert out.read_text("utf-8") == "my notes\n"
    assert abbe(*words, "--force").status == 0
    load_model(out)


def test_a_model_that_has_values_already_is_not_written(tmp_path: Path) -> None:
    model = start_model(made(tmp_path, "lathe").machine)
    save_commented(model, tmp_path / "again.toml")
    assert load_model(tmp_path / "again.toml") == model
    square = next(e for e in model.effects if e.kind == "squareness")
    fitted = Model(model.machine, (Term(square, {"angle": Value(1e-5)}),))
    with pytest.raises(AbbeError, match="not written"):
        save_commented(fitted, tmp_path / "fitted.toml")
    assert not (tmp_path / "fitted.toml").exists()


def test_every_effect_says_what_it_is_and_every_section_what_it_is_for(tmp_path: Path) -> None:
    made(tmp_path, "table-table", "--sensor", "T=scale,X", "--sensor", "S=spindle", "--play")
    text = (tmp_path / "table-table.toml").read_text("utf-8")
    assert "abbe fit table-table.toml CAMPAIGN.csv" in text
    for block in text.split("\n\n")[1:]:
        assert "#" in block, block
    assert "[[effects]]  # E_YX: leaves its straight line in Y\n" in text


# ---------------------------------------------------------------------------- asked on a terminal

ANSWERS = "\n".join(
    [
        *("99", "w C' b Y Z X", "w C' b Y X Z t", "Little mill"),
        *("0,360", "100,80,0", "400", "0,400", "", "-300,0"),
        *("T_y1,T_y2", "T_y1", "T_x", "", "", "", "T_air"),
        *("y", ""),
    ]
)


def test_everything_is_asked_on_a_terminal_and_asked_again(tmp_path: Path) -> None:
    near, far = pty.openpty()
    command = [sys.executable, "-m", "abbe.daemon", "new", "-o", "mill.toml", "--json"]
    process = subprocess.Popen(
        command, stdin=far, stderr=far, stdout=subprocess.PIPE, cwd=tmp_path, text=True
    )
    os.close(far)
    os.write(near, ANSWERS.encode() + b"\n")
    shown = _read_all(near)
    out, _ = process.communicate(timeout=60)
    os.close(near)
    assert process.returncode == 0, shown
    assert json.loads(out)["name"] == "Little mill"
    model = load_model(tmp_path / "mill.toml")
    machine = model.machine
    assert str(machine.structure) == "w C' b Y X Z t"
    assert machine.axes["C"].location == (100.0, 80.0, 0.0)
    assert machine.axes["X"].travel == (0.0, 500.0)
    assert [(s.name, s.role, s.axis) for s in machine.signals.values()] == [
        *(("T_y1", "scale", "Y"), ("T_y2", "scale", "Y"), ("T_x", "scale", "X")),
        ("T_air", "ambient", None),
    ]
    assert "backlash axis=Y" in [effect.spec for effect in model.effects]
    for again in ("t missing", "not two ends", "a name is given twice"):
        assert again in shown
    for kind in COMMON_MACHINES.values():
        assert kind.structure in shown


def _read_all(terminal: int) -> str:
    data = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:
            break
        if not part:
            break
        data += part
    return data.decode("utf-8").replace("\r\n", "\n")


def test_without_a_terminal_nothing_is_asked(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "abbe.daemon", "new", "-o", "m.toml"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        cwd=tmp_path,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert "no terminal to ask on" in done.stderr


# ------------------------------------------------------------------------------------------- page


def test_every_option_and_machine_is_on_the_page() -> None:
    command = typer.main.get_command(app).commands["new"]  # type: ignore[attr-defined]
    options = [o for p in command.params for o in p.opts if o.startswith("--") and o != "--help"]
    assert "--sensor" in options
    assert [o for o in options if f"`{o}`" not in PAGE] == []
    for name, kind in COMMON_MACHINES.items():
        assert f"| `{name}` | {kind.title} | `{kind.structure}` |" in PAGE
    (structure,) = (p for p in command.params if p.name == "structure")
    assert ", ".join(COMMON_MACHINES) in structure.help


def test_an_axis_with_two_drives(tmp_path):
    model = made(tmp_path, "gantry", "--two-drives", "Y=Y_ahead,X,-50,1250")
    assert model.machine.signals["Y_ahead"].unit == "mm"
    (spec,) = [e.spec for e in model.effects if e.kind == "two_drives"]
    assert spec == "two_drives axis=Y signal=Y_ahead across=X master=-50 slave=1250"


@pytest.mark.parametrize("text", ["Y", "Y=a,X,0", "Y=a,Y,0,900", "Q=a,X,0,900", "Y=a,X,here,900"])
def test_two_drives_that_cannot_be_are_one_line(text, tmp_path):
    done = abbe("new", "--structure", "gantry", *travels("gantry"), "--two-drives", text,
                "-o", tmp_path / "m.toml")  # fmt: skip
    assert done.status == 1
    assert len(done.err.strip().splitlines()) == 1
    assert not (tmp_path / "m.toml").exists()


def test_an_arm_is_told_where_its_tools_count_from(tmp_path: Path) -> None:
    arm = ["--structure", "w b C1 B2 A3 t", "--bare"]
    for name in ("C1", "B2", "A3"):
        arm += ["--travel", f"{name}=-90,90"]
    arm += ["--location", "B2=150,0,400", "--location", "A3=0,0,1000"]
    done = CliRunner().invoke(app, ["new", "-o", str(tmp_path / "arm.toml"), *arm])
    assert done.exit_code == 0, done.output
    (said,) = [line for line in done.output.splitlines() if line.startswith("tools ")]
    assert "not from the flange" in said
    assert said.endswith("A3 then turns about a line along X through 0, 0, 1000")
    machine = ["--structure", "bridge", "--travel", "X=0,700", "--travel", "Y=0,900"]
    machine += ["--travel", "Z=-300,0"]
    done = CliRunner().invoke(app, ["new", "-o", str(tmp_path / "cmm.toml"), *machine])
    assert done.exit_code == 0, done.output
    assert "flange" not in done.output
