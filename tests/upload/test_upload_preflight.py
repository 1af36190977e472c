"""What is refused before anything is written, each with its message, and that nothing was."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.compcore.files.model_file import save_model
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import SLOW, Place, make_tables, model, sums, texts
from tests.support.daemon.upload_truth import attempt

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def control() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("controller", "modbus", "--capacity", "20000") as process:
        yield process


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    control.order("load", files=texts(made / "old"))
    keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
    here = Place(tmp_path, control, keys, SLOW)
    here.configure(**SLOW)
    return here


def refused(place: Place, made: Path, folder: Path, **request: object) -> str:
    """The message; nothing was written, nothing was begun."""
    result, message = attempt(lambda: place.upload(folder, **request))
    assert result is None
    truth = place.truth()
    assert truth["active"] == sums(made / "old")
    assert truth["staged"] == 0
    assert not {"begin", "block", "commit", "discard", "deactivate"} & set(truth["asked"])
    assert not place.journal.exists()
    return message


def test_machine_not_idle_not_referenced_or_protected(place: Place, made: Path):
    place.control.order("machine", idle=False)
    assert "the machine is not idle" in refused(place, made, made / "new")
    place.control.order("machine", referenced=False)
    assert "not referenced" in refused(place, made, made / "new")
    place.control.order("machine", protected=True)
    assert "write-protected" in refused(place, made, made / "new")


def test_another_controller(place: Place, made: Path):
    text = place.config.read_text()
    place.config.write_text(text.replace("CONTROL 1.0", "CONTROL 2.0"))
    assert "it calls itself 'ABBE SIMULATED CONTROL 1.0'" in refused(place, made, made / "new")
    place.config.write_text(text.replace("SIM-4711", "SIM-4712"))
    assert "its serial number is 'SIM-4711'" in refused(place, made, made / "new")


def test_nobody_answers(place: Place, made: Path):
    place.configure(port=1)
    assert "Nothing was written" in refused(place, made, made / "new")


def test_a_file_that_was_changed(place: Place, made: Path, tmp_path: Path):
    folder = tmp_path / "changed"
    shutil.copytree(made / "new", folder)
    text = (folder / "x.csv").read_text()
    (folder / "x.csv").write_text(text.replace("1", "2", 1))
    assert "the file was changed after it was made" in refused(place, made, folder)


def test_tables_of_another_dialect_other_options_another_machine(
    place: Place, made: Path, tmp_path: Path
):
    folder = tmp_path / "other"
    for key, value, words in (
        ("controller", "fanuc", "another controller"),
        ("options", {"holds": "moves", "sign": "compensation"}, "other options"),
    ):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(made / "new", folder)
        record = json.loads((folder / "abbe-tables.json").read_text())
        (folder / "abbe-tables.json").write_text(json.dumps(record | {key: value}))
        assert words in refused(place, made, folder)
    record["controller"], record["options"] = "csv", {"holds": "moves"}
    record["model"]["machine"] = "lathe"
    (folder / "abbe-tables.json").write_text(json.dumps(record))
    message = refused(place, made, folder)
    assert "another machine" in message
    assert "found 'lathe', expected mill" in message


def test_entries_slopes_corrections_and_changes_out_of_bounds(
    place: Place, made: Path, tmp_path: Path
):
    text = place.config.read_text()
    for key, found, words in (
        ("max_entry_um = 60.0", "max_entry_um = 2.0", "upload.max_entry_um allows 2 µm"),
        ("max_change_um = 120.0", "max_change_um = 0.5", "upload.max_change_um allows 0.5 µm"),
        (
            "max_change_um = 120.0",
            "max_change_um = 120.0\nmax_slope_um_per_mm = 0.001",
            "upload.max_slope_um_per_mm allows 0.001 µm/mm",
        ),
        (
            "max_change_um = 120.0",
            "max_change_um = 120.0\nmax_correction_um = 3.0",
            "upload.max_correction_um allows 3 µm",
        ),
    ):
        place.config.write_text(text.replace(key, found))
        assert words in refused(place, made, made / "new")
    place.config.write_text(text)
    assert "--max-change" in refused(place, made, made / "new", max_change_um=0.5)
    place.config.write_text(text.replace("max_change_um = 120.0", "max_change_um = 0.5"))
    assert place.upload(made / "new", max_change_um=50.0).ok


def test_the_guard_bounds_the_correction_where_the_section_does_not(place: Place, made: Path):
    text = place.config.read_text()
    place.config.write_text(text.replace("max_correction = 0.1", "max_correction = 0.001"))
    assert "upload.max_correction_um allows 1.73205 µm" in refused(place, made, made / "new")


def test_what_is_active_cannot_be_read(place: Place, made: Path):
    # this control takes a NaN; the dialect does not
    text = texts(made / "old")["x.csv"]
    last = text.splitlines()[-1].split(",")[-1]
    place.control.order("load", files={"x.csv": text.removesuffix(f"{last}\n") + "nan\n"})
    result, message = attempt(lambda: place.upload(made / "new"))
    assert result is None
    assert "what is active on the controller cannot be read as csv" in message
    assert "begin" not in place.truth()["asked"]


def test_a_dry_run_writes_nothing_and_says_what_would_change(place: Place, made: Path):
    result = place.upload(made / "new", dry_run=True)
    assert result.ok
    assert result.outcome is None
    assert 0.5 < result.cleared.change_um < 10.0
    assert "idle and referenced" in result.cleared.lines()[0]
    assert place.truth()["active"] == sums(made / "old")
    assert not place.journal.exists()


def test_what_is_active_already_is_left_alone(place: Place, made: Path):
    result = place.upload(made / "old")
    assert result.ok
    assert result.cleared.nothing_to_do
    assert not place.journal.exists()


def test_tables_that_do_not_fit_into_the_controller(place: Place, made: Path, tmp_path: Path):
    save_model(model(0.011), tmp_path / "model.toml")
    folder = make_tables(tmp_path / "model.toml", tmp_path / "long", points=400)
    result = place.upload(folder)
    assert not result.ok
    assert "do not fit" in result.outcome.why
    assert result.outcome.active == "old"
    assert place.truth()["active"] == sums(made / "old")


def test_tables_that_the_controller_does_not_understand(place: Place, made: Path, tmp_path: Path):
    """Its own check refuses the commit; motions with levers are not for this control."""
    options = {"holds": "motions"}
    folder = make_tables(place.folder / "model.toml", tmp_path / "motions", options)
    text = place.config.read_text()
    place.config.write_text(text.replace('holds = "moves"', 'holds = "motions"'))
    place.control.order("load", files={})
    result = place.upload(folder)
    assert not result.ok
    assert "does not understand the tables" in result.outcome.why
    assert result.outcome.old.none
    assert "no table is active, as before" in "\n".join(result.outcome.lines())
    assert place.truth()["active"] == {}
