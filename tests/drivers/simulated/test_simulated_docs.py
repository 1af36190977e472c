"""The documentation of the simulated bridge says what the code does."""

from __future__ import annotations

from pathlib import Path

from abbe.drivers.simulated.bridge.measure import campaign
from abbe.drivers.simulated.bridge.registers import register_map
from abbe.drivers.simulated.commands.bridge import _parser

DOC = (Path(__file__).parents[3] / "docs" / "simulated-cmm.md").read_text(encoding="utf-8")


def test_the_register_map_is_the_code_s() -> None:
    # To renew it: python -m abbe.drivers.simulated registers
    assert DOC.endswith(register_map())


def test_the_campaign_s_size_is_right() -> None:
    text = campaign(1)
    rows = [line for line in text.splitlines() if not line.startswith("#")][1:]
    setups = [line for line in text.splitlines() if line.startswith("# [setups.")]
    assert f"{len(rows)} rows in {len(setups)} set-ups" in " ".join(DOC.split())


def test_every_command_and_every_connection_option_is_documented() -> None:
    help_text = _parser().format_help()
    for word in ("bridge", "measure", "registers"):
        assert word in help_text
        assert f"python -m abbe.drivers.simulated {word}" in DOC
    for option in (
        "--seed",
        "--port",
        "--time-factor",
        "--noise",
        "--tool",
        "--rtu",
        "--serial-port",
        "--encoder-zero",
        "--stand-at",
        "--die-with-stdin",
        "--kind",
    ):
        assert option in DOC
