"""± of a running correction: closed form, what is said of it, and that it costs no cycle."""

from __future__ import annotations

import asyncio
import io
import json
import logging
import math
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from abbe.daemon.guard import Decision, GuardState
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.show.json_lines import JsonLines
from abbe.daemon.show.plain import PlainLines
from abbe.daemon.show.screen import LiveScreen
from abbe.daemon.show.writer import LineWriter
from tests.support.daemon.command_line import abbe
from tests.support.daemon.small_line import ALPHA, SD, write_campaign, write_model

AXES = ("Y", "X", "Z")
LEVER = np.outer(np.linspace(20.0, 27.0, 5) - 20.0, np.linspace(50.0, 450.0, 17))
SD_ALPHA = SD * 1e-3 / math.sqrt(3.0 * float((LEVER**2).sum()))
"""Of a line through the origin, three readings at each point."""


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Model:
    folder: Path = tmp_path_factory.mktemp("live")
    out = folder / "fitted.toml"
    campaign = write_campaign(folder / "c.csv", seed=5)
    done = abbe("fit", write_model(folder), campaign, "-o", out)
    assert done.status == 0, done.err
    return load_model(out)


def cycle(x: float = 300.0, warm: float = 25.0, number: int = 1) -> CycleRecord:
    at = (120.0, x, -80.0)
    decision = Decision((0.01, 0.0, 0.0), (GuardState.ACTIVE,) * 3, False, False)
    signals = {"T_x": SignalReading(warm, "", 1.0), "T_hall": SignalReading(20.5, "", 1.0)}
    return CycleRecord(
        number, 0.02 * number, at, at, decision, 0x7003, signals, {}, (math.nan,) * 3, 0.002, True
    )


def sure(model: Model, every: float = 1e-3) -> LiveUncertainty:
    return LiveUncertainty(model, AXES, lambda: (0.0, 0.0, 0.0), every)


async def looked(live: LiveUncertainty, record: CycleRecord) -> None:
    """Have the task look once at a record."""
    live.latest = None
    live(record)
    running = asyncio.create_task(live.run())
    await known(live)
    running.cancel()


async def known(live: LiveUncertainty) -> None:
    """Wait until it is known how sure the correction is."""
    for _ in range(20_000):
        if live.latest is not None:
            return
        await asyncio.sleep(1e-3)
    raise AssertionError("nothing was worked out")


def test_inside_it_is_that_of_the_parameter_at_the_machines_position(model):
    found = sure(model).at(cycle(), (0.0, 0.0, 0.0))
    assert found is not None
    assert found.wide == pytest.approx((2.0 * SD_ALPHA * 5.0 * 300.0, 0.0, 0.0), rel=5e-3)
    assert found.beyond == ()


def test_outside_it_is_wider_and_says_why(model):
    found = sure(model).at(cycle(warm=32.0), (0.0, 0.0, -50.0))
    assert found is not None
    change = ALPHA * 5.0 * 300.0 / math.sqrt(3.0)
    wide = 2.0 * math.hypot(SD_ALPHA * 12.0 * 300.0, change)
    assert found.wide[0] == pytest.approx(wide, rel=5e-3)
    assert [b.name for b in found.beyond] == ["T_x", "tool z"]


def test_nothing_is_said_where_it_cannot_be_known(model):
    live = sure(model)
    assert live.at(cycle(warm=math.nan), (0.0, 0.0, 0.0)) is None
    assert live.at(cycle(x=math.nan), (0.0, 0.0, 0.0)) is None
    assert live.at(cycle()._replace(signals={}), (0.0, 0.0, 0.0)) is None


async def test_screen_lines_and_json_show_it(model):
    live = sure(model)
    await looked(live, cycle(warm=32.0))
    record = cycle(warm=32.0)
    wide = 1e3 * live.latest.wide[0]
    screen = LiveScreen(model.machine, AXES, AXES, {}, "Abbe", None, live)
    screen(record)
    console = Console(file=io.StringIO(), width=100)
    console.print(screen.picture(100))
    drawn = console.file.getvalue()
    assert f"X ± {wide:.1f}  Y ± 0.0  Z ± 0.0 µm" in drawn
    assert "T_x = 32 degC was not measured (20 … 27 degC)" in drawn
    stream = io.StringIO()
    writer = LineWriter(stream)
    assert f"(± {wide:.1f}, 0.0, 0.0)" in PlainLines(writer, {}, (0, 1, 2), live).line(record)
    shown = JsonLines(writer, model.machine, AXES, AXES, {}, live).line(record)["uncertainty"]
    writer.end()
    assert shown == {
        "X": pytest.approx(wide, abs=1e-3), "Y": 0.0, "Z": 0.0, "unit": "um", "k": 2.0,
        "beyond": ["T_x"],
    }  # fmt: skip
    assert json.dumps(shown)
    assert "uncertainty" not in JsonLines(writer, model.machine, AXES, AXES, {}).line(record)


async def test_the_journal_knows_once_when_a_signal_leaves_and_when_it_is_back(model, caplog):
    live = sure(model)
    with caplog.at_level(logging.INFO, "abbe.pipeline"):
        for warm in (25.0, 32.0, 33.0, 25.0, 26.0):
            await looked(live, cycle(warm=warm))
    said = [r.getMessage() for r in caplog.records]
    assert len(said) == 2
    assert said[0].startswith("T_x = 32 degC was not measured")
    assert "again" in said[1]


async def test_a_position_that_was_not_measured_is_shown_and_not_journalled(model, caplog):
    live = sure(model)
    with caplog.at_level(logging.INFO, "abbe.pipeline"):
        await looked(live, cycle(x=499.0))
    assert [b.name for b in live.latest.beyond] == ["X"]
    assert caplog.records == []


async def test_without_a_covariance_nothing_is_computed(model, tmp_path):
    bare = load_model(write_model(tmp_path))
    live = sure(bare, every=0.0)
    live(cycle())
    running = asyncio.create_task(live.run())
    for _ in range(100):
        await asyncio.sleep(0)
    assert live.latest is None
    live.change_model(model)
    await known(live)
    running.cancel()


def test_a_cycle_only_leaves_its_record(model, monkeypatch):
    """What is worked out is worked out in the task: the listener itself computes nothing."""
    live = sure(model)
    monkeypatch.setattr(live, "at", lambda *_: pytest.fail("worked out within the cycle"))
    live(cycle())
    assert live.latest is None
