"""abbe calibrate: its steps done once, again where their files changed, stopped, gone on with."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.plan_file import read_plan
from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.commands.calibration.guide import steps_now
from abbe.daemon.config import Configuration, load_config
from abbe.daemon.config.sections.measure import InstrumentSection
from tests.support.daemon.command_line import abbe
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import configuration
from tests.support.daemon.simulated_registers import ready_line

NEW = (
    "new", "--structure", "w b Y X Z t", "--travel", "Y=0,900", "--travel", "X=0,700",
    "--travel", "Z=-360,0", "--shape", "polynomial:1",
)  # fmt: skip


@pytest.fixture
def config(tmp_path):
    shutil.copy(MODEL, tmp_path / "model.toml")
    return configuration(ready_line(), tmp_path)


def calibrate(config, *more):
    return abbe("calibrate", config, "--folder", config.parent / "c", "--time", "60min", "--yes",
                "--controller", "linuxcnc", "--tool", "P=0,0,-150", *more)  # fmt: skip


def test_a_step_that_there_is_not_leaves_no_folder(config):
    done = calibrate(config, "--upto", "WRONG")
    assert done.status == 1
    assert "no such step: found 'WRONG', expected start, plan, program, measure" in done.err
    assert not (config.parent / "c").exists()


@pytest.mark.parametrize("name", ["time", "check-time"])
def test_a_time_that_is_none_is_said_before_anything_is_measured(config, name):
    """Typed: `--check-time 45m` was refused after an hour of measuring, and by broken words."""
    done = calibrate(config, f"--{name}", "45m")
    assert done.status == 1
    assert f"field '{name}': not a time: found '45m', expected such as 4h or 90min" in done.err
    assert not (config.parent / "c").exists()


def test_it_stops_goes_on_and_does_nothing_twice(config):
    done = calibrate(config, "--upto", "plan")
    assert done.status == 0, done.err
    folder = config.parent / "c"
    assert {p.name for p in folder.iterdir()} == {"start.toml", "plan.toml", "calibration.json"}
    before = (folder / "plan.toml").read_bytes()
    done = calibrate(config, "--upto", "program")
    assert done.status == 0, done.err
    assert "plan: which measurements: done" in done.out
    assert (folder / "plan.toml").read_bytes() == before
    program = (folder / "program.nc").read_text("ascii")
    # the plan changed by hand: its program is made anew, the plan is not
    text = before.decode().replace("runs = 2", "runs = 1").replace("both_ways = true",
                                                                   "both_ways = false")  # fmt: skip
    (folder / "plan.toml").write_text(text)
    done = calibrate(config, "--upto", "program")
    assert done.status == 0, done.err
    assert (folder / "plan.toml").read_text() == text
    assert (folder / "program.nc").read_text("ascii") != program
    # another model: all of it anew
    (config.parent / "model.toml").write_text(
        MODEL.read_text("utf-8").replace("Bridge CMM", "Other CMM"), encoding="utf-8"
    )
    done = calibrate(config, "--upto", "plan")
    assert done.status == 0, done.err
    assert (folder / "plan.toml").read_text() != text


@pytest.mark.parametrize("name", ["start.toml", "live.toml", "certificate.html"])
def test_what_lay_in_the_folder_before_is_never_written_over(config, name):
    folder = config.parent / "c"
    folder.mkdir()
    (folder / "notes.txt").write_text("nobody's business\n")
    (folder / name).write_text("mine\n")
    done = calibrate(config, "--upto", "start")
    assert done.status == 1
    assert f"{folder / name}: is there already, and this calibration did not make it" in done.err
    assert {p.name for p in folder.iterdir()} == {"notes.txt", name}
    assert (folder / name).read_text() == "mine\n"
    # out of the way, it begins; killed before its first step was noted, it goes on
    (folder / name).unlink()
    assert calibrate(config, "--upto", "start").status == 0
    state = json.loads((folder / "calibration.json").read_text("utf-8"))
    state |= {"steps": {}, "begun": True}
    (folder / "calibration.json").write_text(json.dumps(state), "utf-8")
    assert calibrate(config, "--upto", "start").status == 0


def test_another_feed_or_another_time_at_a_target_makes_the_program_anew_and_nothing_else(config):
    folder = config.parent / "c"

    def made(*more):
        done = calibrate(config, "--upto", "program", *more)
        assert done.status == 0, done.err
        assert "plan: which measurements: done" in done.out or not more
        return (folder / "program.nc").read_text("ascii")

    plain = made()
    assert "F3000" in plain
    slow = made("--feed", "1200")
    assert "F1200" in slow
    assert "F3000" not in slow
    longer = made("--feed", "1200", "--stands", "7.5")
    assert longer != slow
    assert "7.5" in longer
    again = calibrate(config, "--upto", "program", "--feed", "1200", "--stands", "7.5")
    assert "program: the program of it: done" in again.out
    # who only looks, and says nothing of programs, finds it done
    request = CalibrationRequest(
        load_config(config), folder, "60min", "1h", ("P=0,0,-150",), "linuxcnc", "", yes=False
    )
    now = {one.step.name: one for one in steps_now(request)}
    assert now["program"].at
    assert made() == plain


def test_a_step_that_cannot_be_done_is_named_and_the_same_command_goes_on_there(config):
    assert calibrate(config, "--upto", "plan").status == 0
    plan = config.parent / "c" / "plan.toml"
    good = plan.read_text()
    plan.write_text(good.replace("targets = [", "targets = [ [1.0],", 1))
    done = calibrate(config, "--upto", "program")
    assert done.status == 1
    assert "program is not done; the steps before it are" in done.out
    assert "plan.toml" in done.err
    state = json.loads((config.parent / "c" / "calibration.json").read_text("utf-8"))
    assert list(state["steps"]) == ["start", "plan"]
    plan.write_text(good)
    done = calibrate(config, "--upto", "program")
    assert done.status == 0, done.err
    assert "not done" not in done.out


def test_each_step_is_named_and_an_unknown_one_refused(config):
    done = calibrate(config, "--upto", "zz")
    assert done.status == 1
    for name in ("plan", "program", "measure", "fit", "diagnose", "live", "check", "verify"):
        assert name in done.err
    done = calibrate(config, "--tables", "linuxcnc", "--upto", "zz")
    assert "table" in done.err
    assert "live" not in done.err


def test_a_folder_of_another_configuration_is_refused(config, tmp_path):
    assert calibrate(config, "--upto", "start").status == 0
    other = config.with_name("other.toml")
    shutil.copy(config, other)
    done = abbe("calibrate", other, "--folder", config.parent / "c", "--yes", "--upto", "start")
    assert done.status == 1
    assert "another configuration" in done.err
    state = config.parent / "c" / "calibration.json"
    state.write_text("{}")
    done = calibrate(config, "--upto", "start")
    assert done.status == 1
    assert "not the state of a calibration" in done.err
    assert state.read_text() == "{}"


def test_a_model_without_effects_begins_with_those_of_its_structure(config):
    model = config.parent / "model.toml"
    text = MODEL.read_text("utf-8")
    model.write_text(text[: text.index("[[effects]]")], encoding="utf-8")
    done = calibrate(config, "--upto", "start")
    assert done.status == 0, done.err
    assert "[[effects]]" in (config.parent / "c" / "start.toml").read_text("utf-8")


def test_the_live_configuration_is_the_one_there_is_with_a_model_of_its_own(config):
    from abbe.daemon.calibration.live_configuration import write_live_configuration

    folder = config.parent / "c"
    folder.mkdir()
    shutil.copy(MODEL, folder / "calibrated.toml")
    kept = write_live_configuration(
        config, folder / "calibrated.toml", folder / "live.toml", ["VERIFIED. By", "a\nb"]
    )
    made = load_config(folder / "live.toml")
    assert made.model_path.resolve() == kept.resolve()
    assert kept.read_bytes() == MODEL.read_bytes()
    same = config.read_text("utf-8").replace('"model.toml"', f'"{kept.name}"')
    assert (folder / "live.toml").read_text("utf-8") == "# VERIFIED. By\n# a\n# b\n" + same
    # a later round with another model changes neither what that starts nor its file
    text = MODEL.read_text("utf-8").replace("Bridge CMM", "Other CMM")
    (folder / "calibrated.toml").write_text(text, encoding="utf-8")
    later = write_live_configuration(config, folder / "calibrated.toml", folder / "next.toml")
    assert later != kept
    assert load_config(folder / "live.toml").model.machine.name == made.model.machine.name
    # nor is one that somebody changed taken for what was calibrated
    later.write_text(text + "\n# mine\n", encoding="utf-8")
    with pytest.raises(InputError, match="was changed since it was written"):
        write_live_configuration(config, folder / "calibrated.toml", folder / "next.toml")


def test_nobody_to_ask_and_nothing_to_measure_with(config):
    done = abbe("calibrate", config)
    assert done.status == 1
    assert "--yes" in done.err
    text = config.read_text("utf-8")
    config.write_text(text[: text.index("[instrument.laser]")], encoding="utf-8")
    done = calibrate(config)
    assert done.status == 1
    assert "no instrument" in done.err


def test_instruments_that_write_files_lead_through_it_where_no_other_does(config):
    text = config.read_text("utf-8")
    start, end = text.index("[instrument.laser]"), text.index("[instrument.straightness]")
    by_file = '[instrument.laser]\nreads = "file"\n'
    config.write_text(text[:start] + by_file + text[end:], encoding="utf-8")
    folder = config.parent / "c"
    request = CalibrationRequest(load_config(config), folder, "1h", "1h", (), "", "", yes=True)
    assert request.instruments == "straightness,angle,level"
    last = text.index("[measure]")
    config.write_text(text[:start] + by_file + text[last:], encoding="utf-8")
    done = calibrate(config, "--upto", "plan")
    assert done.status == 0, done.err
    # lines along one axis only, and what to type into the instrument
    setups = read_plan(folder / "plan.toml", load_config(config).model.machine).setups
    assert setups
    assert all(s.axis for s in setups)
    targets = (folder / "targets.csv").read_text("utf-8").splitlines()
    assert len(targets) > sum(s.count for s in setups)
    shutil.rmtree(folder)
    config.write_text(
        text[:start] + '[instrument.ball-bar]\nreads = "file"\n' + text[last:], encoding="utf-8"
    )
    done = calibrate(config)
    assert done.status == 1
    assert "their files cannot be matched with targets along one axis" in done.err
    assert not folder.exists()


def test_the_state_is_plain_json(config):
    assert calibrate(config, "--upto", "start").status == 0
    state = json.loads((config.parent / "c" / "calibration.json").read_text("utf-8"))
    assert state["format"] == "abbe-calibration/1"
    assert list(state["steps"]) == ["start"]


@pytest.mark.parametrize(
    ("instrument", "reads", "checked_by"),
    [
        ("r-test", ["cmm.count_X"] * 3, "r-test"),
        ("ball-bar", ["cmm.count_X"], "ball-bar"),
        ("indicator", ["cmm.count_X"], ""),
    ],
)
def test_a_check_is_made_by_what_is_at_hand(
    instrument: str, reads: list[str], checked_by: str
) -> None:
    """Never by a laser that nobody has: its lines would be refused when they are to be measured."""
    section = InstrumentSection(source=tuple(reads), reads="error")
    file = SimpleNamespace(probing=None, instrument={instrument: section})
    configuration = cast("Configuration", SimpleNamespace(file=file, upload=None))
    request = CalibrationRequest(configuration, Path("c"), "4h", "1h", (), "", "", yes=True)
    assert request.checked_by == checked_by
