"""The service's page names every key of the configuration, every bit and every guard state."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

from abbe.daemon.config.sections.config_file import ConfigFile
from abbe.daemon.config.sections.guard import PerDirection
from abbe.daemon.config.sections.http import HttpSection
from abbe.daemon.config.sections.section import Section
from abbe.daemon.config.sections.upload import UploadSection
from abbe.daemon.guard import GuardState
from abbe.daemon.status.run_status import AxisStatus, RunStatus
from abbe.daemon.status_word import Status

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "daemon.md").read_text(encoding="utf-8")
DEMO = (ROOT / "docs" / "demo.md").read_text(encoding="utf-8")
PAGES = {
    "RecordsSection": (ROOT / "docs" / "records.md").read_text("utf-8"),
    "MqttSection": (ROOT / "docs" / "mqtt.md").read_text("utf-8"),
    "FleetSection": (ROOT / "docs" / "fleet-store.md").read_text("utf-8"),
    "OpcuaServerSection": (ROOT / "docs" / "opcua-server.md").read_text("utf-8"),
    "HttpSection": (ROOT / "docs" / "status.md").read_text("utf-8"),
    "InstrumentSection": (ROOT / "docs" / "measure.md").read_text("utf-8"),
    "ProbingSection": (ROOT / "docs" / "measure.md").read_text("utf-8"),
    "MeasureSection": (ROOT / "docs" / "measure.md").read_text("utf-8"),
}
"""Section → the page of its keys, where it is not the service's."""


def sections(kind: type[Section]) -> Iterator[type[Section]]:
    yield kind
    for field in kind.model_fields.values():
        for part in (field.annotation, *get_args(field.annotation)):
            ours = isinstance(part, type) and issubclass(part, Section)
            if ours and part not in (PerDirection, UploadSection):
                yield from sections(part)


def test_every_key_of_the_configuration_is_explained() -> None:
    found = list(sections(ConfigFile))
    assert len(found) > 8
    top = set(ConfigFile.model_fields)
    for kind in found:
        for key in kind.model_fields:
            words = f"[{key}" if key in top else f"`{key}`"
            page = PAGES.get(kind.__name__, PAGE)
            assert words in page or f"`{key}`" in page, f"{kind.__name__}.{key}"


def test_the_page_of_http_explains_its_keys_paths_and_the_status() -> None:
    page = (ROOT / "docs" / "status.md").read_text("utf-8")
    keys = (*HttpSection.model_fields, *RunStatus.model_fields, *AxisStatus.model_fields)
    assert [key for key in keys if f"`{key}`" not in page] == []


def test_defaults_are_as_stated() -> None:
    rows = re.findall(r"^\| (?:`\[[^|]*)? ?\| `(\w+)` \| ([\d. ]+) \|", PAGE, re.MULTILINE)
    stated = {key: float(value.replace(" ", "")) for key, value in rows}
    assert len(stated) >= 8
    real: dict[str, set[object]] = {}
    for kind in sections(ConfigFile):
        for key, field in kind.model_fields.items():
            if isinstance(field.default, int | float):
                real.setdefault(key, set()).add(float(field.default))
    for key, value in stated.items():
        assert value in real[key], key


def test_every_bit_and_state_is_explained() -> None:
    for bit in Status:
        assert f"`{bit.name}`" in PAGE, bit
        number = int(bit).bit_length() - 1
        if number < 12:
            assert re.search(rf"^\| {number} \| `{bit.name}`", PAGE, re.MULTILINE), bit
    for state in GuardState:
        assert state.value in PAGE


def test_links_between_pages_lead_somewhere() -> None:
    for page in (PAGE, DEMO):
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page):
            assert (ROOT / "docs" / target).resolve().exists(), target


def test_the_demo_page_names_registers_that_exist() -> None:
    from abbe.drivers.simulated.bridge.registers import REGISTERS

    addresses = set(map(int, re.findall(r"-r (\d+)", DEMO)))
    assert addresses == {
        REGISTERS[name].address for name in ("corrected_X", "thermistors_open", "hang")
    }
