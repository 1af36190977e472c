"""A correction that runs is switched, typed into and given datums over its control socket."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import stat
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.errors import AbbeError
from abbe.compcore.machine.conditions import Conditions
from abbe.daemon.config import load_config
from abbe.daemon.control.client import ask
from abbe.daemon.control.requests import DatumRequest, EnterRequest, StateRequest, SwitchRequest
from abbe.daemon.guard import GuardState
from abbe.daemon.pipeline.compensate import LiveCompensator
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.service import Service
from tests.daemon.pipeline.test_pipeline import (
    AT,
    EXAMPLE,
    OHMS,
    QUICK,
    SENSORS,
    VALUES,
    compensating,
)
from tests.support.compcore.table_models import rigid, thermal
from tests.support.daemon.memory_link import MemoryLink

SOCKET = '\n[control]\nsocket = "c.sock"\n'
TOOL = (0.0, 0.0, -150.0)


class Run:
    """A service at work, and who asks it."""

    def __init__(self, folder: Path, text: str, link: MemoryLink) -> None:
        self.config = folder / "config.toml"
        self.config.write_text(text, encoding="utf-8")
        self.link = link
        self.service = Service(load_config(self.config), {"cmm": link})
        self.records: list[CycleRecord] = []
        self.service.add([self.records.append])
        self.socket = folder / "c.sock"

    async def until(self, what: Any, since: int | None = None) -> CycleRecord:
        at = len(self.records) if since is None else since
        async with asyncio.timeout(60.0):
            while True:
                while at < len(self.records):
                    if what(self.records[at]):
                        return self.records[at]
                    at += 1
                await asyncio.sleep(0.002)

    async def ask(self, request: Any) -> dict[str, Any]:
        return await asyncio.to_thread(ask, self.socket, request)

    async def command(self, *words: str) -> tuple[int, str, str]:
        done = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "abbe.daemon", *words,
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        out, err = await done.communicate()
        return done.returncode or 0, out.decode(), err.decode()


@asynccontextmanager
async def running(
    folder: Path, changes: dict[str, str] | None = None, more: str = ""
) -> AsyncIterator[Run]:
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8") + SOCKET + more
    slow = {"ramp = 2.0": "ramp = 0.5"}
    for old, new in {**QUICK, **slow, **(changes or {})}.items():
        assert old in text, old
        text = text.replace(old, new)
    run = Run(folder, text, MemoryLink("cmm", VALUES))
    task = asyncio.create_task(run.service.run())
    try:
        yield run
    finally:
        run.service.stop()
        await asyncio.wait_for(task, 60.0)


def expected(run: Run, **signals: float) -> list[float]:
    at = Conditions.at(AT, tool=TOOL, signals={**dict.fromkeys(SENSORS, 21.0), **signals})
    model = run.service.configuration.model.switched()
    return [float(v[0]) for v in model.axis_error(at).values()]


async def test_switched(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Off, shown and on again: without a step, said in the journal, with by whom."""
    caplog.set_level(logging.INFO, "abbe")
    async with running(tmp_path) as run:
        before = await run.until(compensating)
        whole = expected(run)
        assert before.decision.correction == pytest.approx(whole, abs=2e-5)
        names = list((await run.ask(StateRequest()))["switches"])
        # the effect that does most here
        parts = {}
        for name in names:
            without = run.service.configuration.model.with_switch(name, "off").switched()
            at = Conditions.at(AT, tool=TOOL, signals=dict.fromkeys(SENSORS, 21.0))
            left = [float(v[0]) for v in without.axis_error(at).values()]
            parts[name] = [w - v for w, v in zip(whole, left, strict=True)]
        name = max(parts, key=lambda n: max(map(abs, parts[n])))
        assert max(map(abs, parts[name])) > 2e-3
        for to in ("off", "shown", "on"):
            began = len(run.records)
            answer = await run.ask(SwitchRequest(effect=name, to=to))
            assert answer["switches"][name] == to
            wanted = expected(run)
            last = await run.until(compensating, since=len(run.records) + 1)
            assert last.decision.correction == pytest.approx(wanted, abs=2e-5)
            story = run.records[began - 1 : run.records.index(last) + 1]
            if to != "shown":
                assert any(GuardState.RISING in r.decision.states for r in story)
            for one, two in pairwise(story):
                for k in range(3):
                    way = abs(two.decision.correction[k] - one.decision.correction[k])
                    # 0.5 s for the whole difference, and no more at once than in 0.3 s of it
                    assert way <= abs(parts[name][k]) * (two.time - one.time + 0.02) / 0.5 + 2e-6
            if to == "shown":
                assert last.shown == pytest.approx(parts[name], abs=2e-5)
            else:
                assert last.shown is None
        assert last.decision.correction == pytest.approx(whole, abs=2e-5)
    said = [r.getMessage() for r in caplog.records if "compensation:" in r.getMessage()]
    assert len(said) == 3
    assert said[0].startswith(f"compensation: {name} is off (was on), by ")
    assert f"process {os.getpid()}" in said[0]
    assert not run.socket.exists()


async def test_a_switch_counts_until_the_end_or_a_reload_and_it_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The model file decides at every start and reload; nobody need guess what is on."""
    caplog.set_level(logging.INFO, "abbe")

    def logged(words: str) -> list[str]:
        return [r.getMessage() for r in caplog.records if words in r.getMessage()]

    async with running(tmp_path) as run:
        await run.until(compensating)
        model = run.service.configuration.model_path
        (started,) = logged("compensations as ")
        assert started == f"compensations as {model} says: all on"
        name, other = list((await run.ask(StateRequest()))["switches"])[:2]
        answer = await run.ask(SwitchRequest(effect=name, to="off"))
        assert answer["in_file"] == {name: "on"}
        assert f"then {model} counts again: {name} is on" in answer["until"]
        _, out, _ = await run.command("switch", str(run.config))
        assert f"off    {name}  (model file: on)\n" in out
        assert out.count("model file") == 1
        assert answer["until"] in out
        # the files are those that run: all the same the model file's switches count
        run.service.reload()
        await run.until(lambda _: run.service.configuration.model.switches[name] == "on")
        back = f"compensation: {name} was off by abbe switch, from here on it is on, as {model}"
        assert len(logged(back)) == 1
        state = await run.ask(StateRequest())
        assert (state["in_file"], state["until"]) == ({}, "")
        await run.ask(SwitchRequest(effect=other, to="shown"))
    assert len(logged(back.replace(f"{name} was off", f"{other} was shown"))) == 1

    caplog.clear()
    text = model.read_text(encoding="utf-8")
    whole = f'[[effects]]\nkind = "{name.split()[0]}"\n'
    assert whole in text
    off = text.replace(whole, f'{whole}switch = "off"\n', 1)
    (tmp_path / "model.toml").write_text(off, encoding="utf-8")
    where = {f'"{EXAMPLE / "model.toml"}"': f'"{tmp_path / "model.toml"}"'}
    async with running(tmp_path, where) as run:
        await run.until(compensating)
        state = await run.ask(StateRequest())
        assert (state["switches"][name], state["switches"][other]) == ("off", "on")
        assert (state["in_file"], state["until"]) == ({}, "")
    assert logged("compensations as ")[0].endswith(f"says: {name} is off")
    assert not logged("by abbe switch")


async def test_commands(tmp_path: Path) -> None:
    """As a person types them; what cannot be changes nothing and is said."""
    async with running(tmp_path) as run:
        await run.until(compensating)
        mode = run.socket.stat().st_mode
        assert stat.S_ISSOCK(mode)
        assert stat.S_IMODE(mode) == 0o600
        name = next(iter((await run.ask(StateRequest()))["switches"]))
        status, out, _ = await run.command("switch", str(run.config), name, "off")
        assert status == 0
        assert f"{name} is off (was on)" in out
        status, out, _ = await run.command("switch", str(run.config), "--json")
        assert json.loads(out)["switches"][name] == "off"
        for words, why in (
            (("switch", name, "sometimes"), "on, off or shown"),
            (("switch", "nothing of this", "off"), "no effect is called that"),
            (("switch", name, "off", "--table", "E_XX"), "no such table"),
            (("enter", "T_x1=20"), "not a signal that is typed in"),
            (("datum", "X=0"), "not an axis whose datum is set"),
        ):
            status, out, err = await run.command(words[0], str(run.config), *words[1:])
            assert status == 1, words
            assert why in err
            assert out == ""
        connection = await asyncio.open_unix_connection(run.socket)
        connection[1].write(b'{"do": "format the disk"}\n')
        assert b"not a request" in await connection[0].readline()
        connection[1].close()
        other = Service(load_config(run.config), {"cmm": MemoryLink("cmm", VALUES)})
        with pytest.raises(AbbeError, match="another correction is controlled there"):
            await other.run()
        assert (await run.ask(StateRequest()))["ok"]
    status, _, err = await run.command("switch", str(run.config))
    assert status == 1
    assert "no correction runs that listens" in err


@pytest.mark.thorough
async def test_typed_in(tmp_path: Path) -> None:
    """A temperature that no sensor reads: absent, entered, implausible, expired."""
    old = """[signals.T_x1]
source = "cmm.R_T_x1"
transducer = { type = "steinhart-hart", a = 1.032e-3, b = 2.387e-4, c = 1.580e-7, r25 = 10000 }
"""
    async with running(tmp_path, {old: "[signals.T_x1]\nentered_for = 2.5\n"}) as run:
        first = await run.until(lambda r: r.decision.states[1] is GuardState.ACTIVE)
        assert first.decision.states[0] is GuardState.OFF
        assert first.faults["signal T_x1"] == "nobody has typed it in yet"
        with pytest.raises(AbbeError, match="500 degC is not"):
            await run.ask(EnterRequest(signal="T_x1", value=500.0))
        with pytest.raises(AbbeError, match="2.5 s at most"):
            await run.ask(EnterRequest(signal="T_x1", value=21.0, seconds=60.0))
        answer = await run.ask(EnterRequest(signal="T_x1", value=21.4))
        assert answer["entered"]["T_x1"]["value"] == 21.4
        full = await run.until(compensating)
        assert full.decision.correction == pytest.approx(expected(run, T_x1=21.4), abs=2e-5)
        stale = await run.until(lambda r: "signal T_x1" in r.faults)
        assert "counts no longer" in stale.faults["signal T_x1"]
        off = await run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        assert off.decision.states[1] is GuardState.ACTIVE
        status, out, _ = await run.command("enter", str(run.config), "T_x1=21.4", "--for", "2")
        assert status == 0, out
        assert out.startswith("T_x1 = 21.4 degC typed in, for 2 s")


async def test_datum(tmp_path: Path) -> None:
    """Without a datum nothing is written; with it all is; a device that was away loses it."""
    old = 'source = "cmm.count_X"\n'
    async with running(tmp_path, {old: old + "datum = true\n"}) as run:
        first = await run.until(lambda r: r.number > 10)
        assert "no datum" in first.faults["axis X"]
        assert not any(c.startswith("corrected_X") for w in run.link.written for c in w)
        assert first.decision.correction == (0.0, 0.0, 0.0)
        with pytest.raises(AbbeError, match="is not on the axis"):
            await run.ask(DatumRequest(axis="X", position=5000.0))
        run.link.values["count_X"] = 1000.0  # wherever it was switched on
        status, out, err = await run.command("datum", str(run.config), "X=350")
        assert status == 0, err
        assert out.startswith("datum: X stands at 350 mm")
        full = await run.until(compensating)
        assert full.indicated[run.service.pipeline.axes.index("X")] == pytest.approx(350.0)
        assert full.decision.correction == pytest.approx(expected(run), abs=2e-5)
        run.link.status.reconnects += 1
        lost = await run.until(lambda r: "axis X" in r.faults)
        assert "may count anew" in lost.faults["axis X"]


async def test_moving(tmp_path: Path) -> None:
    """A datum is not set on an axis that moves."""
    old = 'source = "cmm.count_X"\n'
    async with running(tmp_path, {old: old + "datum = true\n"}) as run:
        await run.until(lambda r: r.number > 3)

        async def move() -> None:
            while True:
                run.link.values["count_X"] = (run.link.values["count_X"] or 0.0) + 100.0
                await asyncio.sleep(0.001)

        moving = asyncio.create_task(move())
        with pytest.raises(AbbeError, match="it moved while its datum was set"):
            await run.ask(DatumRequest(axis="X", position=350.0))
        moving.cancel()


def test_a_lag_goes_on_while_its_effect_is_off() -> None:
    """Switched off for half an hour of warming and on again: as if it never had been."""
    model = thermal(rigid())
    name = next(t.effect.spec for t in model.terms if "T_y" in t.effect.signals_needed())
    always, switched = LiveCompensator(model), LiveCompensator(model)
    here = [250.0] * len(always.axes)

    def readings(t: float) -> dict[str, SignalReading]:
        return {
            "T_x": SignalReading(20.0, "", t), "T_y": SignalReading(20.0 + t / 300.0, "", t)
        }  # fmt: skip

    def go(to: str, now: float) -> LiveCompensator:
        new = LiveCompensator(model.with_switch(name, to))
        new.continue_from(switched, now, readings(now))
        return new

    for second in range(0, 3600, 10):
        if second == 600:
            switched = go("off", float(second))
        if second == 2400:
            switched = go("on", float(second))
        for one in (always, switched):
            one.update(float(second), readings(float(second)))
        if 700 < second < 2300:
            assert switched.step(here, ()) != pytest.approx(always.step(here, ()), abs=1e-5)
    assert switched.step(here, ()) == pytest.approx(always.step(here, ()), abs=1e-9)
    assert OHMS > 0.0
