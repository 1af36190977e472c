"""What acts in the controller is asked of it before a calibration measures: none, ours, others."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import save_model
from abbe.daemon.commands.calibration.acting_tables import require_acting
from abbe.daemon.config import load_config
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import SLOW, Place, model, texts

pytestmark = pytest.mark.integration


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Iterator[Place]:
    """A control without a table; ``model.toml`` is what the new ones were made from."""
    shutil.copy(made / "model.toml", tmp_path)
    save_model(model(0.010), tmp_path / "other.toml")
    with SimulatedProcess("controller", "modbus") as control:
        keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
        here = Place(tmp_path, control, keys, SLOW)
        here.configure(**SLOW)
        yield here


def require(place: Place, active: str, uploaded: str = "") -> str:
    """What is said against measuring with this stated, or after this upload; empty: nothing."""
    place.configure(**SLOW)
    text = place.config.read_text("utf-8")
    place.config.write_text(text + f'[measure]\nactive = "{active}"\n', encoding="utf-8")
    try:
        require_acting(load_config(place.config), place.folder / uploaded if uploaded else None)
    except InputError as error:
        return str(error)
    return ""


def test_a_bare_machine(place: Place) -> None:
    assert require(place, "none") == ""
    assert "no tables act in the controller" in require(place, "model.toml")
    assert "no tables act in the controller" in require(place, "none", "model.toml")


def test_after_an_upload(place: Place, made: Path) -> None:
    assert place.upload(made / "new").ok
    said = require(place, "none")
    assert "tables act in the controller" in said
    assert "--rollback" in said
    assert require(place, "model.toml") == ""
    assert require(place, "none", "model.toml") == ""
    assert "were made from another model" in require(place, "other.toml")
    assert "were made from another model" in require(place, "none", "other.toml")


def test_tables_that_somebody_else_loaded(place: Place, made: Path) -> None:
    place.control.order("load", files=texts(made / "old"))
    assert "tables act in the controller" in require(place, "none")
    # nobody knows of which model they are: what is stated counts, but not for ours
    assert require(place, "model.toml") == ""
    assert "were made from another model" in require(place, "none", "model.toml")
