"""``abbe upload`` as it is typed: what it prints, its exit status, its JSON, bad configurations."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from abbe.compcore.effects import Angular
from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.model.model import Model, Term, Value
from abbe.daemon.config import load_config
from abbe.daemon.service import Service
from abbe.daemon.upload.history.upload_log import Journal
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import abbe
from tests.support.daemon.upload_cases import SLOW, Place, make_tables, model, sums, texts

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def control() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("controller", "modbus") as process:
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


def test_products_are_looked_at_and_called_not_tried(place: Place, tmp_path: Path):
    """A dialect that nobody has tried, with levers: the pre-flight says so, and bounds them."""
    bare = model(0.010)
    pitch = Angular(axis="X", about="Y", shape="polynomial:1")
    value = {p.name: Value(4e-5) for p in pitch.linear(bare.machine)}
    save_model(Model(bare.machine, (*bare.terms, Term(pitch, value))), place.folder / "model.toml")
    options = {"products": "mirrored"}
    tables = make_tables(
        place.folder / "model.toml", tmp_path / "levers", options, 20, "siemens-840d"
    )
    text = place.config.read_text()
    text = text.replace('"csv"', '"siemens-840d"').replace(
        'holds = "moves"', 'products = "mirrored"'
    )
    place.config.write_text(text)
    place.control.order("load", files={})
    dry = abbe("upload", place.config, tables, "--dry-run")
    assert dry.status == 0, dry.err
    assert "sign unverified" in dry.out
    assert "nor have products (products=mirrored)" in dry.out
    assert "WARNING: not all of this has been tried" in dry.out
    place.config.write_text(text.replace("max_entry_um = 60.0", "max_entry_um = 1.0"))
    refused = abbe("upload", place.config, tables, "--dry-run")
    assert refused.status == 1
    assert "upload.max_entry_um allows 1 µm" in refused.err
    place.config.write_text(text.replace('products = "mirrored"', 'products = "none"'))
    other = abbe("upload", place.config, tables, "--dry-run")
    assert other.status == 1
    assert "products" in other.err
    assert place.truth()["active"] == {}


def test_the_journal_says_how_the_model_was_measured(place: Place, tmp_path: Path):
    """What stood at the top of the campaign is in every line of the upload."""
    said = {"operator": "R. Meier", "date": "2026-03-02", "warm_up": "2 h"}
    seen = {"positions": {"X": [0.0, 400.0]}}
    campaign = {"file": "day1.csv", "sha256": "c" * 64, "rms": 0.5, "conditions": said | seen}
    path = place.folder / "model.toml"
    save_model(replace(load_model(path), fit={"date": "2026-03-03", "campaigns": [campaign]}), path)
    tables = make_tables(path, tmp_path / "measured")
    done = abbe("upload", place.config, tables, "--yes", "--by", "Ada")
    assert done.status == 0, done.err
    entries = place.entries()
    assert len(entries) > 3
    for entry in entries:
        assert entry["model"]["measured"] == [{"file": "day1.csv", "sha256": "c" * 64, **said}]
    assert entries[0]["record"]["model"]["fit"]["campaigns"] == [campaign]


def test_a_whole_day(place: Place, made: Path):
    """Dry run, upload, status, roll-back, nothing to recover."""
    dry = abbe("upload", place.config, made / "new", "--dry-run")
    assert dry.status == 0, dry.err
    assert "how sure: syntax documented" in dry.out
    assert "the correction changes by at most" in dry.out
    assert dry.out.rstrip().endswith("dry run: nothing was written")
    done = abbe("upload", place.config, made / "new", "--yes", "--by", "Ada", "--note", "warm")
    assert done.status == 0, done.err
    assert "is active, verified by reading it back" in done.out
    assert "backup of what was active before" in done.out
    first = place.entries()[0]
    assert (first["who"], first["note"]) == ("Ada", "warm")
    assert first["record"]["model"]["sha256"] == first["model"]["sha256"]
    assert first["controller"] == {"name": "ABBE SIMULATED CONTROL 1.0", "serial": "SIM-4711"}
    status = abbe("upload", place.config, "--status")
    assert status.status == 0
    assert "from upload" in status.out
    assert "by Ada; version 1 of the model" in status.out
    checked = abbe("upload", place.config, "--check")
    assert checked.status == 0, checked.err
    assert "the controller adds what the table says" in checked.out
    back = abbe("upload", place.config, "--rollback", "--yes")
    assert back.status == 0, back.err
    assert place.truth()["active"] == sums(made / "old")
    assert "nothing to recover" in abbe("upload", place.config, "--recover").out
    again = abbe("upload", place.config, made / "old", "--yes")
    assert again.status == 0
    assert "nothing to do" in again.out


def test_json_is_one_object_and_nothing_else(place: Place, made: Path):
    dry = json.loads(abbe("upload", place.config, made / "new", "--dry-run", "--json").out)
    assert dry["dry_run"]
    assert not dry["done"]
    assert dry["preflight"]["change_um"] > 0.5
    done = abbe("upload", place.config, made / "new", "--yes", "--json")
    answer = json.loads(done.out)
    assert (answer["done"], answer["active"], answer["journal"]) == (True, "new", "closed")
    assert answer["sha256"] == answer["new"] != answer["old"]
    status = json.loads(abbe("upload", place.config, "--status", "--json").out)
    assert status["active"] == answer["new"]
    assert status["from"]["upload"] == answer["upload"]
    assert status["unfinished"] is None
    assert json.loads(abbe("upload", place.config, "--recover", "--json").out) == {
        "recovered": None
    }


def test_a_failure_has_status_1_and_says_which_table_is_active(place: Place, made: Path):
    place.control.order("fault", kind="refuses", at="commit")
    failed = abbe("upload", place.config, made / "new", "--yes")
    assert failed.status == 1
    assert "failed at the step 'activate'" in failed.out
    assert "the old table" in failed.out
    assert "Traceback" not in failed.err + failed.out
    place.control.order("fault", kind="refuses", at="commit")
    answer = json.loads(abbe("upload", place.config, made / "new", "--yes", "--json").out)
    assert (answer["done"], answer["active"], answer["failed_step"]) == (False, "old", "activate")


def test_check_notices_a_control_that_adds_something_else(place: Place, made: Path):
    fine = abbe("upload", place.config, "--check", "--json")
    assert fine.status == 0, fine.err
    assert json.loads(fine.out)["looks"] > 0
    place.control.order("fault", kind="lies", at="show", times=100)
    wrong = abbe("upload", place.config, "--check")
    assert wrong.status == 1
    assert "the table says" in wrong.err
    place.control.order("reset")
    place.control.order("load", files={})
    none = abbe("upload", place.config, "--check")
    assert none.status == 1
    assert "no table is active" in none.err
    assert not place.journal.exists() or not place.entries()


def test_live_correction_beside_tables_is_warned_of(place: Place, made: Path):
    text = place.config.read_text()
    place_of_x = 'table = "holding", address = 20, type = "int32", unit = "mm", writable = true'
    channel = f"out_x = {{ {place_of_x} }}\n"
    text = text.replace("[axes.X]", channel + "[axes.X]", 1)
    place.config.write_text(text + '[output.axes.X]\ntarget = "cnc.out_x"\n')
    dry = abbe("upload", place.config, made / "new", "--dry-run")
    assert dry.status == 0, dry.err
    assert "would correct the machine twice" in dry.out


def test_nobody_to_ask_and_wrong_usage(place: Place, made: Path):
    silent = abbe("upload", place.config, made / "new")
    assert silent.status == 1
    assert "say --yes" in silent.err
    assert abbe("upload", place.config, made / "new", "--json").status == 1
    assert abbe("upload", place.config).status == 2
    assert abbe("upload", place.config, made / "new", "--rollback").status == 2
    assert abbe("upload", place.config, "--status", "--dry-run").status == 2
    assert place.truth()["active"] == sums(made / "old")
    assert "no upload that took effect" in abbe("upload", place.config, "--rollback", "--yes").err


def test_a_journal_that_was_changed_stops_everything(place: Place, made: Path):
    assert abbe("upload", place.config, made / "new", "--yes").status == 0
    text = place.journal.read_text()
    place.journal.write_text(text.replace('"step": "stage"', '"step": "stale"', 1))
    for arguments in ((made / "old", "--yes"), ("--status",), ("--recover",)):
        refused = abbe("upload", place.config, *arguments)
        assert refused.status == 1
        assert "the journal was changed" in refused.err
    assert place.truth()["active"] == sums(made / "new")


@pytest.mark.parametrize(
    ("found", "put", "words"),
    [
        (
            'driver = "modbus"\nhost',
            'driver = "morse"\nhost',
            "unknown store: found 'morse'",
        ),
        ('host = "127.0.0.1"', "hast = 1", "field 'upload.store.hast': unknown key"),
        ('controller = "csv"', 'controller = "csw"', "field 'upload.controller'"),
        ('holds = "moves"', 'hold = "moves"', "field 'upload.options'"),
        ("max_entry_um = 60.0", "max_entry_um = -1.0", "field 'upload.max_entry_um'"),
        ("max_entry_um = 60.0", "", "field 'upload.max_entry_um': missing"),
        ("patience", "pacience", "field 'upload.pacience': unknown key"),
    ],
)
def test_a_bad_section_is_named_with_file_line_and_key(
    place: Place, found: str, put: str, words: str
):
    head, upload, rest = place.config.read_text().partition("[upload]")
    assert found in rest
    place.config.write_text(head + upload + rest.replace(found, put, 1))
    with pytest.raises(InputError) as caught:
        load_config(place.config)
    assert words in str(caught.value)
    assert "mill.toml, line " in str(caught.value)


def test_without_the_section_nothing_is_uploaded(place: Place, made: Path):
    head, _, _ = place.config.read_text().partition("[upload]")
    place.config.write_text(head)
    refused = abbe("upload", place.config, made / "new", "--yes")
    assert refused.status == 1
    assert "no section [upload]" in refused.err


async def test_the_service_warns_of_an_upload_that_was_cut_off(
    place: Place, caplog: pytest.LogCaptureFixture
):
    Journal(place.journal).append(
        {"upload": "a", "step": "begin", "outcome": "begun", "old": "", "new": "ab" * 32}
    )
    with caplog.at_level(logging.WARNING, "abbe.service"):
        await Service(load_config(place.config)).run(0.05)
    assert "was not finished" in caplog.text
    assert "--recover" in caplog.text
