"""The sample configuration beside each link: its own first lines make the model, and it checks."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from importlib import resources
from pathlib import Path

import pytest

from abbe.drivers.link import PLUGINS
from tests.support.daemon.command_line import abbe

OURS = {
    name: entry.value
    for name, entry in PLUGINS.entries().items()
    if entry.value.startswith("abbe.")
}
ROOT = Path(__file__).parents[2]


def folder_of(driver: str) -> Path:
    """The link's package, as it is installed."""
    package = OURS[driver].split(":")[0].rpartition(".")[0]
    return Path(str(resources.files(package)))


def test_all_links_are_looked_at() -> None:
    assert set(OURS) == {
        "modbus",
        "serial",
        "linuxcnc",
        "can",
        "canopen",
        "ipp",
        "opcua",
        "mtconnect",
    }


@pytest.mark.parametrize("driver", sorted(OURS))
def test_the_sample_beside_the_link_is_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, driver: str
) -> None:
    for file in folder_of(driver).glob("sample.*"):
        shutil.copy(file, tmp_path)
    text = (tmp_path / "sample.toml").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^#   abbe (.*)$", text, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["new", "check"]
    made = abbe(*shlex.split(commands[0]))
    assert (made.status, made.err) == (0, "")
    checked = abbe(*shlex.split(commands[1]), "--json")
    assert (checked.status, checked.err) == (0, "")
    found = json.loads(checked.out)
    assert {link["driver"] for link in found["links"].values()} == {driver}
    assert {row["what"].split()[-1] for row in found["inputs"]} >= {"X", "Y", "Z"}
    # every channel is used: what a sample shows, it also explains
    channels = {row["channel"] for row in (*found["inputs"], *found["outputs"])}
    assert sum(link["channels"] for link in found["links"].values()) == len(channels)


@pytest.mark.parametrize("driver", sorted(OURS))
def test_the_page_of_the_link_leads_to_its_sample(driver: str) -> None:
    sample = folder_of(driver).resolve().relative_to(ROOT.resolve()) / "sample.toml"
    text = (ROOT / sample).read_text("utf-8")
    (page,) = set(re.findall(r"docs/\w+\.md", text)) - {"docs/daemon.md"}
    assert f"(../{sample})" in (ROOT / page).read_text("utf-8")
