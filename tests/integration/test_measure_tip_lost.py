"""A probe that loses its tip in the middle of a measurement: what is told, moved and kept."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.commands.measurements.measure import run
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.plate_measuring import Listener, machine, measured
from tests.support.daemon.sphere_measuring import stand, write_files

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

ANGLES = (-80.0, 25.0, 140.0)
LOST = {"severity": 2, "number": 8104, "text": "Tip lost", "unasked": True}
MOVES = ("GoTo", "PtMeas", "Set", "ClearAllErrors")


@pytest.fixture
def table(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """A sphere on the rotary table, and the machine."""
    with machine() as process:
        write_files(tmp_path, process.ready["port"], ANGLES)
        stand(process, tmp_path)
        yield process, tmp_path


def visits(folder: Path) -> list[tuple[str, float]]:
    """Set-up and angle (degrees) of every sphere in the campaign."""
    found = read_campaign(folder / "campaign.csv", load_model(folder / "model.toml").machine)
    assert found.conditions.setup is not None
    angles = np.degrees(found.conditions.positions["C"][::3]).round(3)
    return list(zip(found.conditions.setup[::3].tolist(), angles.tolist(), strict=True))


@pytest.mark.parametrize("missed", ["stop", "leave out"])
def test_the_operator_is_told_nothing_is_moved_and_the_sphere_under_way_has_no_row(
    table: tuple[SimulatedProcess, Path], missed: str
) -> None:
    """Also where what is missed is left out: who has no tip does not go on to the next angle."""
    process, folder = table
    config = folder / "config.toml"
    config.write_text(config.read_text("utf-8") + f'missed = "{missed}"\n', encoding="utf-8")
    before: list[int] = []

    def lose() -> None:
        process.order("error", **LOST)
        before.append(len(process.order("report")["commands"]))

    heard = Listener(("s1 target 2", lose))
    paths = (folder / name for name in ("plan.toml", "config.toml", "campaign.csv"))
    with pytest.raises(AbbeError) as told:
        run(*paths, (), heard, yes=True, once=False)
    assert heard.heard
    for words in ("8104", "Tip lost", "not measured; the same command goes on"):
        assert words in str(told.value)
    (stopped,) = (e.text for e in heard.events if e.kind == "stopped")
    assert "Tip lost" in stopped
    assert stopped.endswith("the machine is left where it is")
    # no error is cleared, and nothing is moved, by who has no tip
    after = process.order("report")["commands"][before[0] :]
    assert after
    assert not [c for c in after if c.startswith(MOVES)]
    kept = visits(folder)
    assert kept == [("s1", ANGLES[0]), ("s1", ANGLES[1])]
    assert len(kept) == heard.rows()
    # a new tip: the sphere is found anew, in a set-up of its own, and nothing is touched twice
    stand(process, folder)
    again = measured(folder)
    assert again.rows() == 4
    found = visits(folder)
    assert found[:2] == kept
    assert {name for name, _ in found[2:]} == {"s1.2"}
    assert sorted(a for _, a in found) == sorted([*ANGLES, *ANGLES])
