"""``abbe run --json`` with positions and temperatures of an MTConnect agent."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.support.drivers.live_run import (
    PATIENCE,
    PLACE,
    assert_corrected_as_foretold,
    command,
    configuration,
    in_full,
    running,
    until,
)
from tests.support.drivers.mtconnect.agent import MillAgent

pytestmark = pytest.mark.integration

LINK = """\
[links.mill]
driver = "mtconnect"
url = "URL"
timeout = 2.0
stamp = "none"
reconnect_max = 0.5
[links.mill.channels]
x = { data = "Xact", unit = "mm" }
y = { data = "Yact", unit = "mm" }
z = { data = "Zact", unit = "mm" }
T = { data = "Stemp", unit = "degC" }
"""


@pytest.mark.thorough
def test_positions_that_are_missing_end_the_correction(agent: MillAgent, tmp_path: Path) -> None:
    agent.say(Stemp=22.5, **{f"{axis}act": at for axis, at in PLACE.items()})
    config = tmp_path / "config.toml"
    url = f"http://127.0.0.1:{agent.port}/Mill"
    config.write_text(configuration(LINK.replace("URL", url)), encoding="utf-8")
    with running(config) as run:
        assert_corrected_as_foretold(until(run, in_full))
        # the adapter lost the machine
        agent.say(Xact="UNAVAILABLE")
        ended = until(run, lambda c: not c["guard"]["compensating"])
        assert "UNAVAILABLE" in ended["faults"]["axis X"]
        # held, then led to zero
        until(run, lambda c: not any(c["correction"].values()))
        agent.instance += 1
        agent.say(Xact=PLACE["X"])
        until(run, in_full)
    # units that are not those of the machine: refused in one line, by place
    agent.units["Yact"] = "INCH"
    refused = subprocess.run(command(config), capture_output=True, text=True, timeout=PATIENCE)
    assert refused.returncode != 0
    assert "unit 'mm', but the agent states 'INCH' for Yact" in refused.stderr
    assert "Traceback" not in refused.stderr
