"""docs/upload.md names every key, the example loads, what watch-tables proposes can be typed."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.daemon.application import app
from abbe.daemon.config import load_config
from abbe.daemon.config.sections.upload import UploadSection
from abbe.daemon.table_watch.watch import words
from abbe.drivers.stores.modbus.config import ModbusStoreConfig
from abbe.drivers.stores.modbus.registers import RegisterMap
from abbe.drivers.stores.serial.config import Texts
from tests.support.daemon.upload_cases import make_tables

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "upload.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("section", [UploadSection, RegisterMap, Texts, ModbusStoreConfig])
def test_every_key_is_on_the_page(section: type):
    keys = [k for k in section.model_fields if not k.endswith("_answer")]

    def named(key: str) -> tuple[str, ...]:
        return f"`{key}", f"{key} =", f"[upload.{key}]", f"[upload.store.{key}]"

    assert [key for key in keys if any(text in PAGE for text in named(key))] == keys


def test_defaults_on_the_page_are_those_of_the_code():
    section = PAGE.partition("## Configuration")[2].partition("## Before")[0]
    compared = 0
    for line in section.splitlines():
        cells = [c.strip() for c in line.split("|")]
        if len(cells) == 5 and cells[1].startswith("`") and cells[3] not in ("required", "none"):
            keys = [k.strip("` ") for k in cells[1].split(",")]
            found = [UploadSection.model_fields.get(k) for k in keys]
            if None in found or "the guard's" in cells[3] or "required" in cells[3]:
                continue
            documented = [d.strip("` ") for d in cells[3].split(",")]
            assert [str(f.default).removesuffix(".0") for f in found] == [
                t.strip('"') for t in documented
            ], line
            compared += len(found)
    assert compared >= 9


def test_the_example_is_in_order_and_its_tables_fit_it(tmp_path: Path):
    configuration = load_config(ROOT / "examples" / "upload" / "mill.toml")
    assert configuration.upload is not None
    assert configuration.upload.section.max_change_um == 20.0
    folder = make_tables(ROOT / "examples" / "upload" / "model.toml", tmp_path / "tables")
    from abbe.daemon.upload.checks.preflight import check_tables, limits_of
    from abbe.daemon.upload.upload_plan import load_plan

    plan = load_plan(folder, configuration, configuration.upload)
    check_tables(plan, configuration.model, limits_of(configuration.upload, None))
    assert not plan.warnings


def test_what_the_watch_proposes_can_be_typed():
    proposal = words({"event": "propose", "folder": "tables"}, Path("mill.toml"))
    typed = proposal.partition(": ")[2].split()
    assert typed[:2] == ["abbe", "upload"]
    assert "upload" in [command.name for command in app.registered_commands]
    assert typed[2:] == ["mill.toml", "tables"]
