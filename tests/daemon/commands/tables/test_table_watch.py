"""``abbe watch-tables``: when tables are out of date, when a machine is idle, and a real one."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.effects import ScaleExpansion
from abbe.compcore.files.model_file import save_model
from abbe.compcore.files.table_set import TableSet
from abbe.compcore.model.lags import lags_of
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.tables.volume import Volume
from abbe.daemon.config import load_config
from abbe.daemon.demo.configuration import demo_configuration
from abbe.daemon.demo.simulator import simulated_bridge
from abbe.daemon.table_watch.follow import TableTarget, follow
from abbe.daemon.table_watch.follower import Follower
from abbe.daemon.table_watch.watch import words
from abbe.drivers.controllers import make_controller
from tests.support.compcore.table_models import rigid, thermal
from tests.support.daemon.memory_link import MemoryLink

MODEL = thermal(rigid())
VOLUME = Volume.of(MODEL.machine)
PATIENCE = 180.0
"""s that a busy computer may take."""


def follower(limit: float = 1e-3, idle: float = 5.0) -> Follower:
    return Follower(MODEL, VOLUME, limit, idle)


def test_the_first_tables_are_due_at_once_and_the_next_when_the_error_has_changed():
    watch = follower(limit=2e-3)
    assert watch.missing({}) == ["T_x", "T_y"]
    assert watch.missing({"T_x": math.nan, "T_y": 20.0}) == ["T_x"]
    watch.take(0.0, {"T_x": 20.0, "T_y": 20.0})
    assert watch.change() == math.inf
    assert watch.due()
    watch.made()
    assert watch.change() == 0.0
    # 1.1e-5/K over the 500 mm from zero: 2 µm are reached at 0.36 K
    watch.take(10.0, {"T_x": 20.3, "T_y": 20.0})
    assert watch.change() == pytest.approx(1.1e-5 * 0.3 * 500.0, rel=0.01)
    assert not watch.due()
    watch.take(20.0, {"T_x": 20.4, "T_y": 20.0})
    assert watch.due()


def test_a_lagged_signal_counts_with_its_lag():
    """The spindle grows 2 µm/K, ten minutes late: a jump asks for nothing at first."""
    assert lags_of(MODEL) == (("T_y", 600.0),)
    watch = follower(limit=3e-3)
    watch.take(0.0, {"T_x": 20.0, "T_y": 20.0})
    watch.made()
    watch.take(1.0, {"T_x": 20.0, "T_y": 24.0})
    assert watch.change() < 0.1e-3
    watch.take(601.0, {"T_x": 20.0, "T_y": 24.0})
    assert watch.change() == pytest.approx(2e-3 * 4.0 * (1.0 - math.exp(-1.0)), rel=0.02)
    assert watch.due()


def test_idle_is_no_motion_for_a_while_at_known_positions():
    watch = follower(idle=5.0)
    assert not watch.stand(0.0, (0.0, 0.0, 0.0))
    assert not watch.stand(4.9, (0.0, 0.005, 0.0))
    assert watch.stand(5.1, (0.0, 0.0, 0.0))
    assert not watch.stand(6.0, (0.0, 0.5, 0.0))
    assert not watch.stand(10.0, (0.0, 0.5, 0.0))
    assert watch.stand(11.5, (0.0, 0.5, 0.0))
    assert not watch.stand(12.0, (math.nan, 0.5, 0.0))
    assert not watch.stand(30.0, (math.nan, 0.5, 0.0))
    assert not watch.stand(31.0, (0.0, 0.5, 0.0))
    assert watch.stand(36.5, (0.0, 0.5, 0.0))


CONFIG = """
format = "abbe-config/1"
model = "model.toml"
[links.m]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = 1
[links.m.channels]
{channels}
[guard]
max_correction = 0.1
max_rate = 1.0
signals_stale_after = 60.0
stale_after = 30.0
{sections}
"""


@pytest.fixture
def configured(tmp_path: Path):
    """A configuration whose link is exchanged for one in memory."""
    save_model(MODEL, tmp_path / "model.toml")
    names = ["X", "Y", "Z", "T_x", "T_y"]
    channels = "\n".join(
        f'{n} = {{ table = "input", address = {2 * i}, type = "float32", unit = "{u}" }}'
        for i, (n, u) in enumerate(zip(names, ["mm"] * 3 + ["degC"] * 2, strict=True))
    )
    sections = "\n".join(
        [f'[axes.{a}]\nsource = "m.{a}"' for a in "XYZ"]
        + [f'[signals.{s}]\nsource = "m.{s}"' for s in ("T_x", "T_y")]
    )
    text = CONFIG.format(channels=channels, sections=sections)
    (tmp_path / "config.toml").write_text(text, encoding="utf-8")
    return load_config(tmp_path / "config.toml")


async def test_tables_are_made_when_due_and_an_upload_proposed_when_idle(configured, tmp_path):
    link = MemoryLink("m", {"X": 1.0, "Y": 2.0, "Z": 3.0, "T_x": None, "T_y": 20.0})
    target = TableTarget(
        make_controller("linuxcnc", MODEL.machine), {}, VOLUME, None, tmp_path / "out", "me"
    )
    events: asyncio.Queue[dict] = asyncio.Queue()

    async def until(kind: str) -> dict:
        while True:
            event = await asyncio.wait_for(events.get(), 60.0)
            if event["event"] == kind:
                return event

    watch = follower(2e-3, 0.2)
    tell = events.put_nowait
    task = asyncio.create_task(follow(configured, {"m": link}, watch, target, tell, every=0.05))
    waiting = await until("waiting")
    assert waiting["signals"] == ["T_x"]
    link.values["T_x"] = 20.0
    first = await until("tables")
    assert first["change_um"] is None
    assert first["signals"] == {"T_x": 20.0, "T_y": 20.0}
    assert (await until("propose"))["folder"] == str(tmp_path / "out")
    made = TableSet.load(tmp_path / "out")
    assert made.checksum == first["sha256"]
    assert made.record["by"] == "me"
    link.values["T_x"] = 21.0
    second = await until("tables")
    assert second["change_um"] == pytest.approx(5.5, rel=0.02)
    assert second["sha256"] != first["sha256"]
    await until("propose")
    assert link.written == []
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


SD_ALPHA = 2e-7
"""Standard uncertainty of the one coefficient, 1/K."""


async def test_how_sure_the_model_is_goes_with_every_set_of_tables(configured, tmp_path):
    """One coefficient: ± = 2·sd·|x|·ΔT, by the exact formula; beyond 24 °C nobody measured."""
    grows = Term(ScaleExpansion(axis="X", signals=("T_x",)), {"alpha": Value(1.1e-5, SD_ALPHA)})
    seen = {"measured": {"signals": {"T_x": [19.0, 24.0]}}}
    known = Model(MODEL.machine, (grows,), fit=seen, covariance=np.array([[SD_ALPHA**2]]))
    assert known.measured_signals == {"T_x": (19.0, 24.0)}
    save_model(known, tmp_path / "model.toml")
    configuration = load_config(configured.path)
    link = MemoryLink("m", {"X": 1.0, "Y": 2.0, "Z": 3.0, "T_x": 22.0, "T_y": 20.0})
    target = TableTarget(
        make_controller("linuxcnc", MODEL.machine), {}, VOLUME, None, tmp_path / "out", "me"
    )
    events: asyncio.Queue[dict] = asyncio.Queue()
    watch = Follower(known, VOLUME, 1e-3, 1e9)
    task = asyncio.create_task(
        follow(configuration, {"m": link}, watch, target, events.put_nowait, every=0.05)
    )
    try:
        inside = await asyncio.wait_for(events.get(), 60.0)
        # the trial points stand half a step inside the ends, ± 500 mm from zero
        assert inside["uncertainty"]["largest"] == pytest.approx(
            2e3 * SD_ALPHA * 500.0 * 2.0, rel=0.05
        )
        assert inside["uncertainty"]["k"] == 2.0
        assert inside["beyond"] == []
        link.values["T_x"] = 34.0
        beyond = await asyncio.wait_for(events.get(), 60.0)
        # beside the coefficient's the 10 K that nobody saw, as a rectangle
        wide = 2e3 * 500.0 * math.hypot(SD_ALPHA * 14.0, 1.1e-5 * 10.0 / math.sqrt(3.0))
        assert beyond["uncertainty"]["largest"] == pytest.approx(wide, rel=0.05)
        assert beyond["beyond"] == ["T_x = 34 degC was not measured (19 … 24 degC)"]
        said = words(beyond, Path("c.toml"))
        assert f"the model ± {beyond['uncertainty']['largest']:.1f} µm at most (k = 2)" in said
        assert "T_x = 34 degC was not measured" in said
    finally:
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task


def test_what_is_said_of_an_event():
    config = Path("c.toml")
    assert words({"event": "waiting", "signals": ["T_x"]}, config) == "waiting for T_x"
    assert "abbe upload c.toml out" in words({"event": "propose", "folder": "out"}, config)
    hall = Path("hall 3/c.toml")
    said = words({"event": "propose", "folder": "my out"}, hall)
    assert said.endswith("abbe upload 'hall 3/c.toml' 'my out'")
    event = {
        "event": "tables", "folder": "out", "change_um": 3.21, "signals": {"T_x": 21.0},
        "left_um": {"max": 4.0, "rms": 1.0}, "uncertainty": None, "beyond": [],
    }  # fmt: skip
    assert "changed by 3.2 µm" in words(event, config)
    assert "± is not known" in words(event, config)
    assert "first" in words({**event, "change_um": None}, config)


@pytest.mark.thorough
@pytest.mark.integration
def test_a_machine_that_warms_up_is_followed_over_modbus(tmp_path):
    """The simulated bridge in its own process; its shop warms by hours in seconds."""
    example = Path(__file__).parents[4] / "examples" / "bridge-cmm" / "model.toml"
    (tmp_path / "model.toml").write_bytes(example.read_bytes())
    with simulated_bridge(1, 600.0) as machine:
        config, folder = tmp_path / "config.toml", tmp_path / "t"
        config.write_text(demo_configuration(machine.ready, "model.toml"), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "abbe.daemon",
            "watch-tables",
            str(config),
            "-o",
            folder,
        ]
        command += ["--controller", "cmm-map", "--change", "0.5", "--idle", "0", "--json"]
        watch = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert watch.stdout is not None
        # nothing is waited for by the clock, but not for ever
        overdue = threading.Timer(PATIENCE, watch.kill)
        overdue.start()
        events = []
        try:
            for line in watch.stdout:
                events.append(json.loads(line))
                kinds = [e["event"] for e in events]
                if kinds.count("tables") >= 2 and kinds[-1] == "propose":
                    break
            # a machine that stands still for good: no more tables, so those there are the last
            machine.process.send_signal(signal.SIGSTOP)
            for line in watch.stdout:
                events.append(json.loads(line))
                if events[-1]["event"] == "waiting":
                    break
            tables = [e for e in events if e["event"] == "tables"]
            made = TableSet.load(folder)
            watch.send_signal(signal.SIGINT)
            _, errors = watch.communicate()
            assert watch.returncode == 130, errors
        finally:
            overdue.cancel()
            watch.kill()
            watch.wait()
            machine.process.send_signal(signal.SIGCONT)
    assert tables[0]["change_um"] is None
    assert all(e["change_um"] > 0.5 for e in tables[1:])
    assert made.checksum == tables[-1]["sha256"]
    assert set(made.record["conditions"]["signals"]) >= {"T_x1", "T_z2"}
