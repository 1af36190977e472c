"""What ``make demo-fleet`` writes is a configuration in order; somebody's folder is left alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.compcore.errors import AbbeError
from abbe.daemon.config import load_config
from abbe.daemon.demo.prepare import START
from tools.demo_fleet.__main__ import MARK, _clear
from tools.demo_fleet.machines import Ports, configuration, named


def test_a_machine_of_the_demo(tmp_path: Path) -> None:
    model = named(START.read_text("utf-8"), "CMM 2", "2026-01-01T00:00:00+00:00")
    (tmp_path / "model.toml").write_text(model, "utf-8")
    (tmp_path / "store.secret").write_text("x\n", "utf-8")
    (tmp_path / "store.secret").chmod(0o600)
    (tmp_path / "http-tokens.toml").write_text("", "utf-8")
    config = tmp_path / "config.toml"
    config.write_text(configuration("abbe_cmm_2", Ports(5021, 8471, 1883, 5432)), "utf-8")
    try:
        found = load_config(config)
    except AbbeError as error:
        # a token is made by the demo itself, once the configuration is there
        assert "token" in str(error)  # noqa: PT017
        return
    assert found.model.machine.name == "CMM 2"


def test_somebody_s_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("all of it", "utf-8")
    with pytest.raises(AbbeError, match="not of this demo"):
        _clear(tmp_path)
    assert (tmp_path / "thesis.txt").exists()
    own = tmp_path / "own"
    _clear(own)
    (own / "old").touch()
    _clear(own)
    assert [path.name for path in own.iterdir()] == [MARK]
