"""docs/fit.md says what the commands offer."""

from pathlib import Path

import pytest
import typer

from abbe.daemon.application import app

PAGE = (Path(__file__).parents[4] / "docs" / "fit.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["fit", "compare"])
def test_every_option_is_explained(command: str) -> None:
    found = typer.main.get_command(app).commands[command]  # type: ignore[attr-defined]
    options = [o for p in found.params for o in p.opts if o.startswith("--") and o != "--help"]
    assert "--json" in options
    assert [o for o in options if f"`{o}`" not in PAGE] == []
