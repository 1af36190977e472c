"""abbe calibrate, corrected live: what `abbe run` is given comes after the check, and says so."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import pytest

from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.calibration.state import CalibrationState
from abbe.daemon.commands.calibration.guide import steps_now
from abbe.daemon.config import load_config
from tests.support.daemon.command_line import Done, abbe
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import configuration
from tests.support.daemon.simulated_registers import ready_line

EFFECTS = "".join(
    f'[[effects]]\nkind = "positioning"\naxis = "{a}"\nshape = "polynomial:1"\n' for a in "YXZ"
)
PPM = {"X": 80.0, "Y": -60.0, "Z": 40.0}
"""What the machine's scales are wrong by."""
TRAVELS = {"X": (10.0, 690.0), "Y": (10.0, 890.0), "Z": (-350.0, -10.0)}
HEAD = (
    '# format = "abbe-campaign/1"\n# machine = "Bridge CMM (simulated)"\n# instrument = "laser"\n'
)
COLUMNS = (
    "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,tool_x,tool_y,tool_z,ux,uy,uz,value,sd,"
    "T_x1,T_x2,T_y1,T_y2,T_z1,T_z2,T_amb"
)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A configuration, and a folder in which the campaign was measured."""
    text = MODEL.read_text("utf-8")
    (tmp_path / "model.toml").write_text(text[: text.index("[[effects]]")] + EFFECTS, "utf-8")
    made = configuration(ready_line(), tmp_path)
    folder = tmp_path / "c"
    assert calibrate(made, "--upto", "start").status == 0
    (folder / "plan.toml").write_text("# by hand\n", encoding="utf-8")
    note(made, "plan", "start.toml")
    targets = []
    for k, (axis, (low, high)) in enumerate(TRAVELS.items()):
        for i in range(16):
            at = [0.5 * (a + b) for a, b in TRAVELS.values()]
            at[k] = low + (high - low) * i / 15.0
            targets.append((f"{axis}_line", at, [float(j == k) for j in range(3)], 1))
    write(folder / "campaign.csv", [*targets, *targets])
    note(made, "measure", "plan.toml")
    return made


def calibrate(config: Path, *more: str) -> Done:
    return abbe("calibrate", config, "--folder", config.parent / "c", "--yes", "--check-time",
                "50min", "--tool", "P=0,0,-150", *more)  # fmt: skip


def note(config: Path, step: str, *made_from: str) -> None:
    folder = config.parent / "c"
    CalibrationState.read(folder, config).note(step, [folder / name for name in made_from])


def write(
    path: Path, targets: list[tuple[str, list[float], list[float], int]], *, turned: float = 1.0
) -> None:
    """Rows as the machine shows them; `turned` −1: as if a sign were another one."""
    rows = [COLUMNS]
    for k, (setup, at, u, sense) in enumerate(targets):
        error = sum(PPM[a] * 1e-3 * q * c for a, q, c in zip("XYZ", at, u, strict=True))
        value = turned * error + 0.1 * ((k * 7) % 5 - 2)
        came = [sense * (1 if c > 0 else -1 if c < 0 else 0) for c in u]
        numbers = [*at, *came, 0, 0, -150, *u]
        rows.append(
            f"{5 * k},{setup},displacement," + ",".join(f"{v:g}" for v in numbers)
            + f",{value:.3f},0.3,20,20,20,20,20,20,20"
        )  # fmt: skip
    path.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")


def write_check(folder: Path, *, turned: float = 1.0) -> None:
    """The lines of the check plan, each as often as it says."""
    targets = []
    for setup in tomllib.loads((folder / "check.toml").read_text("utf-8"))["setups"]:
        order = list(setup["targets"])
        ways = [(1, order), (-1, order[::-1])] if setup["both_ways"] else [(1, order)]
        for sense, run in ways * setup["runs"]:
            for target in run:
                at = dict(zip(setup["axes"], target, strict=True))
                targets.append((setup["name"], [at[a] for a in "XYZ"], setup["read"][0][0], sense))
    write(folder / "check.csv", targets, turned=turned)


def test_nothing_is_written_for_a_run_before_the_check_and_nothing_where_it_is_worse(
    config: Path,
) -> None:
    folder = config.parent / "c"
    done = calibrate(config, "--upto", "check-plan")
    assert done.status == 0, done.err + done.out
    assert (folder / "calibrated.toml").exists()
    assert not [*folder.glob("live*"), *folder.glob("model-*")]
    # as if the machine, or a sign, had changed since: worse after than before
    write_check(folder, turned=-1.0)
    note(config, "check", "check.toml")
    done = calibrate(config)
    assert done.status == 1
    assert "verify is not done" in done.out
    assert "the check does not pass: Y 01_laser: E " in done.err
    assert "nothing is written for abbe run" in done.err
    assert (folder / "certificate.html").exists()
    assert not [*folder.glob("live*"), *folder.glob("model-*")]
    # measured again: the same command goes on
    write_check(folder)
    done = calibrate(config)
    assert done.status == 0, done.err
    live = folder / "live.toml"
    assert live.read_text("utf-8").startswith("# VERIFIED. Written by abbe calibrate")
    assert ": E 5" in live.read_text("utf-8").splitlines()[1]
    assert not (folder / "live-not-verified.toml").exists()
    assert load_config(live).model_path.read_bytes() == (folder / "calibrated.toml").read_bytes()
    # and there is nothing left to do
    again = calibrate(config)
    assert again.out.count(": done 20") == 9, again.out
    state = json.loads((folder / "calibration.json").read_text("utf-8"))
    assert state["steps"]["verify"]["outcome"].startswith("verified: ")


def test_a_check_of_which_a_part_is_missing_gives_a_configuration_that_says_so(
    config: Path,
) -> None:
    folder = config.parent / "c"
    assert calibrate(config, "--upto", "check-plan").status == 0
    write_check(folder)
    rows = (folder / "check.csv").read_text("utf-8").splitlines()
    (folder / "check.csv").write_text("\n".join(rows[:-3]) + "\n", encoding="utf-8")
    note(config, "check", "check.toml")
    done = calibrate(config)
    assert done.status == 0, done.err
    assert not (folder / "live.toml").exists()
    text = (folder / "live-not-verified.toml").read_text("utf-8")
    assert text.startswith("# NOT VERIFIED. ")
    assert "not measured in one go" in text.splitlines()[1]
    assert f"calibrated: {folder}; not verified" in done.out


def test_a_line_that_was_broken_off_and_measured_anew_verifies(config: Path) -> None:
    folder = config.parent / "c"
    assert calibrate(config, "--upto", "check-plan").status == 0
    assert "\nin_one_go = true" in (folder / "check.toml").read_text("utf-8")
    write_check(folder)
    lines = (folder / "check.csv").read_text("utf-8").splitlines()
    head, rows = lines[:4], [line.split(",") for line in lines[4:]]
    assert head[-1] == COLUMNS
    name = rows[0][1]
    # as abbe measure leaves it: three rows of a line, and all of it once more from another zero
    broken = [[str(k - 100), *row[1:]] for k, row in enumerate(rows[:3])]
    whole = [[r[0], f"{name}.2", *r[2:]] if r[1] == name else r for r in rows]
    text = "\n".join([*head, *(",".join(r) for r in [*broken, *whole])])
    (folder / "check.csv").write_text(text + "\n", encoding="utf-8")
    note(config, "check", "check.toml")
    done = calibrate(config)
    assert done.status == 0, done.err
    assert (folder / "live.toml").exists(), done.out
    state = json.loads((folder / "calibration.json").read_text("utf-8"))
    assert state["steps"]["verify"]["outcome"].startswith("verified: ")


def test_what_was_left_out_with_nobody_there_is_said_and_asked_for_by_the_next_person(
    config: Path,
) -> None:
    folder = config.parent / "c"
    assert calibrate(config, "--upto", "check-plan").status == 0
    said = "established, and left out: backlash axis=X; hysteresis lies outside what"
    state = CalibrationState.read(folder, config)
    state.note("diagnose", [folder / "fitted.toml", folder / "campaign.csv"], outcome=said)
    write_check(folder)
    note(config, "check", "check.toml")
    done = calibrate(config)
    assert done.status == 0, done.err
    assert said in done.out.splitlines()
    assert "without --yes asks" in done.out
    assert (folder / "live.toml").read_text("utf-8").splitlines()[2] == f"# {said}"
    assert said in (folder / "certificate.html").read_text("utf-8")

    def diagnosed(*, yes: bool) -> bool:
        request = CalibrationRequest(
            load_config(config), folder, "4h", "50min", ("P=0,0,-150",), "", "", yes
        )
        (step,) = [s for s in steps_now(request) if s.step.name == "diagnose"]
        return bool(step.at)

    assert diagnosed(yes=True)
    assert not diagnosed(yes=False)
    # somebody has said no to it: that counts, and is not asked again
    state = CalibrationState.read(folder, config)
    made_from = [folder / "fitted.toml", folder / "campaign.csv"]
    state.note("diagnose", made_from, settings={"asked": "somebody"}, outcome=said)
    assert diagnosed(yes=False)


@pytest.mark.parametrize(("size", "status"), [("1um", 1), ("500um", 0)])
def test_a_stated_tolerance_counts(config: Path, size: str, status: int) -> None:
    folder = config.parent / "c"
    assert calibrate(config, "--upto", "check-plan").status == 0
    write_check(folder, turned=0.7)
    note(config, "check", "check.toml")
    done = calibrate(config, "--tolerance", f"E={size}")
    assert done.status == status, done.err + done.out
    assert ("a stated tolerance is not kept" in done.err) is bool(status)
    assert not (folder / "live.toml").exists()
    refused = calibrate(config, "--tolerance", "E=8")
    assert refused.status == 1
    assert "a tolerance needs its unit" in refused.err
    shutil.rmtree(folder)


def test_another_language_alone_makes_the_certificate_anew_and_stays(config: Path) -> None:
    folder = config.parent / "c"
    assert calibrate(config, "--upto", "check-plan").status == 0
    write_check(folder)
    note(config, "check", "check.toml")
    page = folder / "certificate.html"
    languages = []
    for typed in ([], ["--language", "de"], [], ["--language", "en"]):
        assert calibrate(config, *typed).status == 0
        languages.append('lang="de"' in page.read_text("utf-8"))
    assert languages == [False, True, True, False]
