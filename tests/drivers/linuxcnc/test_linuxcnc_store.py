"""Compensation files uploaded to a real LinuxCNC, which shows on both ways what they do."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import abbe.drivers.linuxcnc
import abbe.drivers.stores.linuxcnc.running
from abbe.drivers.link import (
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
)
from abbe.drivers.stores.base import Readiness, RefusedError, ShownCorrection
from abbe.drivers.stores.linuxcnc.config import LinuxCncStoreConfig
from abbe.drivers.stores.linuxcnc.store import LinuxCncStore
from tests.support.drivers.linuxcnc.machine import EXAMPLE, PATIENCE, PYTHON
from tests.support.drivers.linuxcnc.mill import Mill

pytestmark = pytest.mark.integration

ROWS = np.linspace(-280.0, 280.0, 57) + 0.31
Files = dict[str, str]


def error(axis: str, q: float, upward: bool, size: float) -> float:
    """What the machine is told to have, mm."""
    curve = {"x": np.sin(q / 90.0), "y": np.cos(q / 70.0), "z": q / 200.0}[axis]
    return float(size * (curve + (0.3 if upward else -0.2)))


def files(size: float) -> Files:
    """Type 0: nominal, actual on the way up, actual on the way down."""
    return {
        f"{a}.comp": "".join(
            f"{q:.3f} {q + error(a, q, True, size):.7f} {q + error(a, q, False, size):.7f}\n"
            for q in ROWS
        )
        for a in "xyz"
    }


def added(axis: str, q: float, upward: bool, size: float) -> float:
    """What LinuxCNC has to add between the rows, mm."""
    return -float(np.interp(q, ROWS, [error(axis, r, upward, size) for r in ROWS]))


SMALL, LARGE = 0.02, 0.035


@pytest.fixture(scope="module")
def mill() -> Iterator[Mill]:
    with Mill() as machine:
        yield machine


@asynccontextmanager
async def store(mill: Mill, **settings: Any) -> AsyncIterator[LinuxCncStore]:
    config = LinuxCncStoreConfig.model_validate({"ini": str(mill.folder / "mill.ini")} | settings)
    one = LinuxCncStore("mill", config)
    await one.open()
    try:
        yield one
    finally:
        await one.close()


async def upload(one: LinuxCncStore, wanted: Files) -> None:
    await one.stage(wanted)
    assert await one.staged() == wanted
    await one.activate(wanted)
    await one.discard()
    assert await one.active() == wanted


async def until(one: LinuxCncStore, true: Callable[[tuple[str, ...]], bool]) -> Readiness:
    """Wait until what speaks against an upload is this; LinuxCNC may be starting until then."""
    began = time.monotonic()
    while True:
        latest: object
        try:
            latest = found = await one.readiness()
            if true(found.hindrances):
                return found
        except LinkDownError as error:
            latest = error
            if "LinuxCNC is starting" not in str(error):
                raise
        assert time.monotonic() - began < PATIENCE, latest
        await asyncio.sleep(0.05)


def order_at_once(order: str) -> None:
    """Have LinuxCNC do something without waiting for it."""
    subprocess.run([PYTHON, "-c", f"import linuxcnc; c = linuxcnc.command(); {order}"], check=True)


def check(effects: Any, size: float) -> set[tuple[str, int]]:
    """Compare what LinuxCNC adds with what it has to; axes and directions that were seen."""
    seen = set()
    for effect in effects:
        assert isinstance(effect, ShownCorrection)
        for axis, at in effect.position.items():
            direction = effect.direction.get(axis, 0)
            if direction:
                # LinuxCNC keeps single precision
                wanted = added(axis.lower(), at, direction > 0, size)
                assert effect.correction[axis] == pytest.approx(wanted, abs=2e-7)
                seen.add((axis, direction))
    return seen


EVERYWHERE = {(axis, direction) for axis in "XYZ" for direction in (1, -1)}


async def test_upload_restart_verify_roll_back(mill: Mill) -> None:
    """In one test, because each LinuxCNC that is started takes seconds."""
    async with store(mill) as one:
        assert (await one.identity()).name.endswith(", mill")
        assert await one.active() == {}
        assert (await one.readiness()).ready  # nothing runs, nothing can move
        assert list(await one.effects()) == []
        await upload(one, files(SMALL))
        assert not one.restart_needed
        with pytest.raises(RefusedError, match="restarted by hand"):
            await one.restart()
    await asyncio.to_thread(mill.start)
    async with store(mill) as one:
        await until(one, lambda hindrances: hindrances == ("not homed: joint 0, 1, 2",))
        assert list(await one.effects()) == []
    await asyncio.to_thread(mill.ready)

    # the way up and the way down, between rows, and the user's modal state stays as it was
    await asyncio.to_thread(mill.order, "mdi", "G20 G91 G0 X1 Y-2 Z0.5")
    moving = {"verify_by_moving": True, "verify_step": 2.3, "verify_points": 2}
    async with store(mill, **moving, verify_feed=3000.0) as one:
        assert (await one.readiness()).ready
        effects = await one.effects()
        assert check(effects, SMALL) == EVERYWHERE
        assert len(effects) == 12
        assert max(abs(e.position["X"] - 25.4) for e in effects) == pytest.approx(4.6, abs=1e-6)
    await asyncio.to_thread(mill.order, "mdi", "G0 X1")
    async with store(mill, watch=0.2) as one:
        (effect,) = await one.effects()
        assert effect.position["X"] == pytest.approx(50.8, abs=1e-6)
        assert effect.direction == dict.fromkeys("XYZ", 0)
        assert effect.correction["X"] == pytest.approx(added("x", 50.8, True, SMALL), abs=2e-7)

    # moved by somebody else while it is watched
    async with store(mill, watch=2.0) as one:
        watching = asyncio.create_task(one.effects())
        await asyncio.sleep(0.2)
        await asyncio.to_thread(mill.order, "mdi", "G90 G21 G0 X60 Y-60 Z10")
        await asyncio.to_thread(mill.order, "mdi", "G0 X50 Y-50 Z20")
        check(await watching, SMALL)

    # a second table: LinuxCNC keeps the first until it is started anew
    async with store(mill, **moving, verify_feed=3000.0) as one:
        await upload(one, files(LARGE))
        assert one.restart_needed
        check(await one.effects(), SMALL)
        # taken back before any restart: what runs has it loaded already
        await upload(one, files(SMALL))
        assert not one.restart_needed
        await upload(one, files(LARGE))
    async with store(mill) as one:
        assert one.restart_needed
    async with store(mill, restart=mill.restart_command()) as one:
        assert one.restart_needed
        await one.restart()
        assert not one.restart_needed
    async with store(mill, **moving, verify_feed=3000.0) as one:
        assert await one.active() == files(LARGE)
        assert check(await one.effects(), LARGE) == EVERYWHERE

        # a programme runs: not ready, and not restarted
        order_at_once("c.mdi('G21 G90 G1 F60 X-200')")
        ready = await until(one, lambda hindrances: hindrances[:1] == ("a programme runs",))
        assert not ready.idle
        order_at_once("c.abort()")
        assert (await until(one, lambda hindrances: hindrances == ())).ready

        # back to none: files without effect, for LinuxCNC does not start without files
        await one.deactivate()
        assert await one.active() == {}
        assert one.restart_needed
    await asyncio.to_thread(mill.end)
    async with store(mill, restart=mill.restart_command(), **moving) as one:
        assert not one.restart_needed
        await one.restart()
        effects = await one.effects()
        assert len(effects) == 12
        assert all(c == 0.0 for e in effects for c in e.correction.values())


async def test_nothing_is_switched_that_could_not_be_meant(mill: Mill) -> None:
    async with store(mill) as one:
        before = await one.active()
        with pytest.raises(RefusedError, match=r"nothing to upload; mill.ini reads x.comp, y.comp"):
            await one.stage({})
        with pytest.raises(RefusedError, match=r"\.\./mill\.ini to upload"):
            await one.stage({"x.comp": "0 0 0\n", "../mill.ini": "gone\n"})
        # trims in a file of actual positions: LinuxCNC would move by hundreds of millimetres
        with pytest.raises(RefusedError, match="correct by 200, more than max_correction = 1"):
            await one.stage({"x.comp": "-200 0 0\n100 0.005 0.005\n"})
        await one.stage(files(SMALL))
        with pytest.raises(RefusedError, match="something else is staged"):
            await one.activate(files(LARGE))
        with pytest.raises(RefusedError, match="something else is staged"):
            await one.activate({})
        ini = mill.folder / "mill.ini"
        text = ini.read_text()
        ini.write_text(text.replace("current/z.comp", "current/zz.comp", 1))
        with pytest.raises(LinkConfigError, match="not named after its axis"):
            await one.activate(files(SMALL))
        ini.write_text(text.replace("COMP_FILE_TYPE = 0", "COMP_FILE_TYPE = 1", 1))
        with pytest.raises(RefusedError, match="was changed; nothing was switched"):
            await one.activate(files(SMALL))
        ini.write_text(text)
        assert await one.active() == before
        await one.discard()
        assert await one.staged() == {}
    with pytest.raises(LinkDownError, match="is closed"):
        await one.active()


async def test_a_set_without_some_joints_lets_linuxcnc_start(mill: Mill) -> None:
    async with store(mill) as one:
        only_x = {"x.comp": files(SMALL)["x.comp"]}
        await upload(one, only_x)
        assert (mill.folder / "comp" / "current" / "z.comp").read_text() == "0 0 0\n"


@pytest.mark.parametrize(
    ("script", "within", "kind", "why"),
    [
        ("echo nothing >&2; exit 3", 60.0, RefusedError, "ended with status 3: nothing"),
        ("exec sleep 100", 2.0, LinkTimeoutError, "did not end in 2 s"),
        ("exit 0", 5.0, LinkTimeoutError, "LinuxCNC is not back 5 s after"),
    ],
)
async def test_a_restart_that_fails_is_reported(
    mill: Mill, script: str, within: float, kind: type[LinkError], why: str
) -> None:
    restart = ["/bin/sh", "-c", script]
    async with store(mill, restart=restart, restart_timeout=within) as one:
        before = await one.active()
        with pytest.raises(kind, match=why):
            await one.restart()
        assert await one.active() == before


PLAIN = "[JOINT_{0}]\nCOMP_FILE = {1}.comp\nCOMP_FILE_TYPE = 1"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ["no joint has a COMP_FILE", "[JOINT_2]\n  COMP_FILE = comp/current/z.comp"]),
        (
            {f"[JOINT_{i}]": PLAIN.format(i, f"screw{i}") for i in (0, 1)},
            ["is not named after its axis", "cp 'screw1.comp' comp/mine/y.comp", "echo 0 0 0 >"],
        ),
        (
            {f"[JOINT_{i}]": PLAIN.format(i, a) for i, a in enumerate("xyz")},
            [
                "are not in one folder named current",
                "COMP_FILE_TYPE = 1",
                "ln -s mine comp/current",
            ],
        ),
    ],
)
async def test_an_ini_file_whose_files_cannot_be_switched(
    tmp_path: Path, changes: dict[str, str], said: list[str]
) -> None:
    text = (EXAMPLE / "mill.ini").read_text()
    for old, new in changes.items():
        text = text.replace(old, new)
    ini = tmp_path / "mill.ini"
    ini.write_text(text)
    one = LinuxCncStore("mill", LinuxCncStoreConfig(ini=str(ini)))
    with pytest.raises(LinkConfigError) as caught:
        await one.open()
    for part in said:
        assert part in str(caught.value)


async def test_while_linuxcnc_starts_nothing_is_switched(tmp_path: Path) -> None:
    """It could read files of both tables. A process with the name and arguments of its task."""
    ini = tmp_path / "mill.ini"
    text = (EXAMPLE / "mill.ini").read_text()
    ini.write_text(text.replace("[JOINT_0]", "[JOINT_0]\nCOMP_FILE = comp/current/x.comp"))
    one = LinuxCncStore("mill", LinuxCncStoreConfig(ini=str(ini)))
    await one.open()
    await one.stage({"x.comp": "0 0 0\n"})
    command = ["milltask", "-c", "import time; time.sleep(300)", "-ini", str(ini)]
    starting = await asyncio.create_subprocess_exec(*command, executable=sys.executable)
    try:
        for switch in (one.activate({"x.comp": "0 0 0\n"}), one.deactivate()):
            with pytest.raises(RefusedError, match="starting or ending.*nothing was switched"):
                await switch
    finally:
        starting.kill()
        await starting.wait()
    assert not (tmp_path / "comp" / "current").exists()
    await one.stage({"x.comp": "0 0 0\n"})
    await one.activate({"x.comp": "0 0 0\n"})
    assert (tmp_path / "comp" / "current" / "x.comp").exists()


async def test_axes_of_other_kinematics_are_not_moved(tmp_path: Path) -> None:
    text = (EXAMPLE / "mill.ini").read_text().replace("trivkins", "genhexkins")
    text = text.replace("[JOINT_0]", "[JOINT_0]\nCOMP_FILE = comp/current/x.comp")
    ini = tmp_path / "mill.ini"
    ini.write_text(text)
    one = LinuxCncStore("mill", LinuxCncStoreConfig(ini=str(ini), verify_by_moving=True))
    with pytest.raises(LinkConfigError, match="needs .* trivkins"):
        await one.open()
    one = LinuxCncStore("mill", LinuxCncStoreConfig(ini=str(ini)))
    await one.open()


async def test_what_is_missing_is_reported(tmp_path: Path) -> None:
    one = LinuxCncStore("mill", LinuxCncStoreConfig(ini=str(tmp_path / "no.ini")))
    with pytest.raises(LinkDownError, match="there is no such file"):
        await one.open()
    config = LinuxCncStoreConfig(ini=str(tmp_path / "no.ini"), python="/no/python")
    with pytest.raises(LinkDownError, match="cannot start /no/python"):
        await LinuxCncStore("mill", config).open()


DEAF = """
import sys
sys.path.insert(0, {drivers!r})
import table_bridge
from bridge import run


class Deaf(table_bridge.TableBridge):
    lost = 0

    def attach(self):
        super().attach()
        told = self._command

        class Command:
            serial = property(lambda self: told.serial)
            mode = told.mode
            wait_complete = told.wait_complete

            def mdi(self, line):
                if "G53" in line and {loses}:
                    Deaf.lost += 1
                else:
                    told.mdi(line)

        self._command = Command()


sys.exit(run(Deaf))
"""
"""A bridge that loses orders to move on their way to LinuxCNC."""


async def test_what_happens_to_the_moves_of_a_check(
    mill: Mill, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Orders that get lost, an operator's stop, the machine switched off, axes not moved yet."""
    await asyncio.to_thread(mill.end)
    async with store(mill) as one:
        await upload(one, files(SMALL))
    await asyncio.to_thread(mill.start)
    await asyncio.to_thread(mill.ready)
    async with store(mill) as one:  # homed, not moved: LinuxCNC adds nothing yet
        (effect,) = await one.effects()
        assert effect.correction == {}
        assert set(effect.position) == set("XYZ")
    await asyncio.to_thread(mill.order, "mdi", "G90 G21 G0 X5")
    async with store(mill) as one:
        (effect,) = await one.effects()
        assert effect.correction == {"X": pytest.approx(added("x", 5.0, True, SMALL), abs=2e-7)}

    drivers = str(Path(abbe.drivers.linuxcnc.__file__).parent)
    deaf = tmp_path / "deaf.py"
    moving = {"verify_by_moving": True, "verify_step": 2.3, "verify_points": 2}
    monkeypatch.setattr(abbe.drivers.stores.linuxcnc.running, "_BRIDGE", deaf)
    deaf.write_text(DEAF.format(drivers=drivers, loses="Deaf.lost < 2"))
    async with store(mill, **moving, verify_feed=3000.0) as one:
        effects = await one.effects()
        assert check(effects, SMALL) == EVERYWHERE
        assert len(effects) == 12
    deaf.write_text(DEAF.format(drivers=drivers, loses="True"))
    async with store(mill, **moving, verify_feed=3000.0) as one:
        with pytest.raises(LinkTimeoutError, match=r"does not move X to 7\.3, ordered 3 times"):
            await one.effects()
    monkeypatch.undo()

    slow = moving | {"verify_step": 10.0, "verify_feed": 200.0}
    for order, said in [
        ("c.abort()", "told something else meanwhile; it is not moved any further"),
        ("c.state(linuxcnc.STATE_OFF)", "was switched off while X moved"),
    ]:
        async with store(mill, **slow) as one:
            checking = asyncio.create_task(one.effects())
            await until(one, lambda hindrances: hindrances[:1] == ("a programme runs",))
            order_at_once(order)
            with pytest.raises(LinkProtocolError, match=said):
                await checking
        async with store(mill) as one:
            where = (await one.effects())[0].position
            await asyncio.sleep(1.0)
            assert (await one.effects())[0].position == where
