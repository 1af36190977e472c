"""``abbe run --json`` with positions and temperatures of an OPC UA server that is not Abbe's."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.drivers.live_run import (
    PLACE,
    assert_corrected_as_foretold,
    configuration,
    in_full,
    running,
    until,
)
from tests.support.drivers.opcua.mill import URI, Mill

pytestmark = pytest.mark.integration

LINK = f"""\
[links.mill]
driver = "opcua"
url = "URL"
timeout = 2.0
[links.mill.channels]
x = {{ node = "nsu={URI};s=Mill/x", unit = "mm" }}
y = {{ node = "nsu={URI};s=Mill/y", unit = "mm" }}
z = {{ node = "nsu={URI};s=Mill/z", unit = "mm" }}
T = {{ node = "nsu={URI};s=Mill/T", unit = "degC", every = 0.2 }}
"""


def test_positions_that_are_bad_or_old_end_the_correction(server: Mill, tmp_path: Path) -> None:
    server.say(**{axis.lower(): {"value": at} for axis, at in PLACE.items()})
    server.say(T={"value": 22.5})
    config = tmp_path / "config.toml"
    config.write_text(configuration(LINK.replace("URL", server.url)), encoding="utf-8")
    with running(config) as run:
        assert_corrected_as_foretold(until(run, in_full))
        # the server goes on answering, with what it has not measured
        server.say(x={"value": 350.0, "status": "UncertainLastUsableValue"})
        ended = until(run, lambda c: not c["guard"]["compensating"])
        assert "UncertainLastUsableValue" in ended["faults"]["axis X"]
        # held, then led to zero
        until(run, lambda c: not any(c["correction"].values()))
        server.say(x={"value": 350.0})
        until(run, in_full)
        # nor does it help that the status is good, where the source has stopped
        server.say(x={"value": 350.0, "source_age": 30.0})
        until(run, lambda c: not c["guard"]["compensating"])
        server.say(x={"value": 350.0})
        until(run, in_full)
