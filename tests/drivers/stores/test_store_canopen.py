"""Tables in a CANopen node over slcan: whatever frame goes wrong, old or new is active, whole.

The node and its adapter run in a process of their own. What is active is taken from the simulated
controller itself, not from what the store believes.
"""

from __future__ import annotations

import asyncio
import hashlib
import math
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from pydantic import ValidationError

from abbe.drivers.link import LinkDownError, LinkError, LinkTimeoutError
from abbe.drivers.simulated.process import SimulatedProcess
from abbe.drivers.stores.base import RefusedError, store_class
from abbe.drivers.stores.canopen.config import CanopenStoreConfig
from abbe.drivers.stores.canopen.store import CanopenStore

pytestmark = pytest.mark.integration

Files = dict[str, str]
HEAD = """# format = "abbe-table/1"
# sign = "error"
# holds = "moves"
# entries = "absolute"
# reversal = "columns"
{0} [mm],E_{0}{0} (+) [mm],E_{0}{0} (-) [mm]
"""


def error(axis: str, q: float, upward: bool, size: float) -> float:
    return size * (math.sin(q / 60.0 + ord(axis)) + (0.2 if upward else -0.1))


def tables(size: float, rows: int = 8) -> Files:
    """What the control takes: errors of X and Y, both ways."""
    files = {}
    for axis in "XY":
        lines = [HEAD.format(axis)]
        for q in (100.0 * i / (rows - 1) for i in range(rows)):
            up, down = error(axis, q, True, size), error(axis, q, False, size)
            lines.append(f"{q:.6f},{up:.6f},{down:.6f}\n")
        files[f"{axis.lower()}.csv"] = "".join(lines)
    return files


OLD, NEW = tables(0.010), tables(0.015)


def sums(files: Files) -> dict[str, str]:
    return {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedProcess]:
    memory = tmp_path_factory.mktemp("control") / "active"
    with SimulatedProcess("controller", "canopen", "--memory", str(memory)) as process:
        yield process


@asynccontextmanager
async def store(control: SimulatedProcess, **settings: Any) -> AsyncIterator[CanopenStore]:
    section = {
        "interface": "slcan",
        "channel": control.ready["channel"],
        "bitrate": 500_000,
        "options": {"sleep_after_open": 0.0},
        "node": control.ready["node"],
        "timeout": 2.0,
        "attempts": 10,
    }
    one = CanopenStore("mill", CanopenStoreConfig.model_validate(section | settings))
    await one.open()
    try:
        yield one
    finally:
        await one.close()


def begin(control: SimulatedProcess, active: Files = OLD) -> None:
    control.order("reset")
    control.order("load", files=active)


async def upload(one: CanopenStore, files: Files) -> None:
    """The steps of an upload, in its order; an error is a `LinkError`."""
    name = (await one.identity()).serial
    if name != "4711":
        raise LinkError("another controller")
    if not (await one.readiness()).ready:
        raise RefusedError("not ready")
    await one.active()
    await one.stage(files)
    if await one.staged() != files:
        raise LinkError("something else is staged")
    await one.activate(files)
    if await one.active() != files:
        raise LinkError("something else is active")
    await one.effects()
    await one.discard()


async def test_an_upload(control: SimulatedProcess) -> None:
    begin(control, {})
    assert store_class("canopen") is CanopenStore
    async with store(control) as one:
        assert (await one.identity()).name == "ABBE SIMULATED CONTROL 1.0"
        assert await one.active() == {}
        assert await one.staged() == {}
        done: list[float] = []
        big = tables(0.02, rows=400)
        await one.stage(big, done.append)
        assert done == sorted(done)
        assert done[-1] == 1.0
        assert len(done) > 10
        assert control.order("truth")["active"] == {}
        assert await one.staged(done.append) == big
        with pytest.raises(RefusedError, match="something else is staged"):
            await one.activate(NEW)
        await one.activate(big)
        assert control.order("truth")["active"] == sums(big)
        assert await one.active() == big
        await one.discard()
        assert await one.staged() == {}
        ways = set()
        for _ in range(40):
            (effect,) = await one.effects()
            x, way = effect.position["X"], effect.direction["X"]
            # 0.6 nm of the table's straight lines, 1 nm of the node's counts
            wanted = -error("X", x, way > 0, 0.02)
            assert effect.correction["X"] == pytest.approx(wanted, abs=2.5e-6)
            assert effect.correction["Z"] == 0.0
            ways.add(way)
        assert ways == {1, -1}
        await one.deactivate()
        assert control.order("truth")["active"] == {}
        assert await one.active() == {}


async def test_a_node_without_block_transfer_gets_segments(control: SimulatedProcess) -> None:
    begin(control)
    control.order("blocks", refused=True)
    try:
        async with store(control) as one:
            await upload(one, NEW)
        assert control.order("truth")["active"] == sums(NEW)
    finally:
        control.order("blocks", refused=False)


@pytest.mark.parametrize(
    ("machine", "why"),
    [
        ({"idle": False}, "because of the present device state"),
        ({"referenced": False}, "because of the present device state"),
        ({"protected": True}, "because of local control"),
    ],
)
async def test_a_control_that_is_not_ready(
    control: SimulatedProcess, machine: dict[str, bool], why: str
) -> None:
    begin(control)
    control.order("machine", **machine)
    async with store(control) as one:
        assert not (await one.readiness()).ready
        await one.stage(NEW)
        with pytest.raises(RefusedError, match=f"2302h:01 of node 16: refused.*{why}"):
            await one.activate(NEW)
        with pytest.raises(RefusedError, match=why):
            await one.deactivate()
    assert control.order("truth")["active"] == sums(OLD)


async def test_what_the_control_does_not_understand_never_acts(control: SimulatedProcess) -> None:
    begin(control)
    wrong = {"x.csv": NEW["x.csv"].replace('"moves"', '"slopes"')}
    async with store(control) as one:
        await one.stage(wrong)
        assert await one.staged() == wrong
        with pytest.raises(RefusedError, match="Value range"):
            await one.activate(wrong)
    assert control.order("truth")["active"] == sums(OLD)


MILD = ("lost_request", "lost_answer", "late_answer", "twice", "bad_request", "bad_answer")
"""Once, at anything but the commit, they only cost time."""
TOUCHED = {
    "identity": (0,),
    "state": (0,),
    "begin": (0,),
    "block": (0, 60, 132, 133),
    "status": (0, 8),
    "read_staged": (0, 1, 2),
    "commit": (0,),
    "discard": (0,),
    "read_active": (0, 5),
    "show": (0, 3),
}
"""What an upload asks for → which of its frames something happens to. A table has 133 segments, and
a frame that ends them; reading one takes four frames."""


LATER = ("lost_request", "lost_answer", "twice", "bad_request", "bad_answer", "restart", "hang")
"""What happens to frames that are not the first of their operation."""
STUBBORN = ("lies", "refuses")
"""What goes on for ever, from the first frame. The rest of first frames: tests/upload."""
CASES = [
    (operation, skip, kind)
    for operation, skips in TOUCHED.items()
    for skip in skips
    for kind in (LATER if skip else STUBBORN)
]


@pytest.mark.one_in(24)
@pytest.mark.parametrize(("operation", "skip", "kind"), CASES)
async def test_whatever_frame_goes_wrong(
    control: SimulatedProcess, operation: str, skip: int, kind: str
) -> None:
    begin(control)
    often = 10_000 if kind in STUBBORN else 1
    mild = kind in MILD and operation != "commit"
    # where it must come through, it is tried often: this machine may stall for a second
    patience = {"attempts": 10} if mild else {"attempts": 2, "reconnect_within": 0.3}
    seconds = 0.5 if kind == "late_answer" else 0.1
    failed = ""
    async with store(control, timeout=0.3, command_timeout=0.3, **patience) as one:
        control.order("fault", kind=kind, at=operation, skip=skip, times=often, seconds=seconds)
        try:
            await asyncio.wait_for(upload(one, NEW), 100.0)
        except LinkError as failure:
            failed = str(failure)
            assert failed
    truth = control.order("truth")
    assert [kind, operation] in truth["happened"], truth["asked"]
    assert truth["active"] in (sums(OLD), sums(NEW))
    if not failed:
        assert truth["active"] == sums(NEW)
    if mild:
        assert not failed
    if kind in ("hang", "hang_after", "refuses") and operation not in ("show", "discard"):
        assert failed
    if kind in STUBBORN and operation in ("begin", "commit", "read_staged") and not skip:
        assert truth["active"] == sums(OLD)

    # whatever it was: once it is over, what is active can be read, and an upload comes through
    control.order("reset")
    async with store(control) as one:
        active = await one.active()
        assert sums(active) == control.order("truth")["active"]
        await upload(one, NEW)
    assert control.order("truth")["active"] == sums(NEW)


@pytest.mark.thorough
@pytest.mark.one_in(2)
@pytest.mark.parametrize("how", ["unplug", "break"])
async def test_an_adapter_that_goes_amid_the_transfer_and_comes_back(
    control: SimulatedProcess, how: str
) -> None:
    begin(control)
    back = {"unplug": "plug", "break": "mend"}[how]
    async with store(control, timeout=0.5, reconnect_within=60.0) as one:
        seen = asyncio.Event()
        staging = asyncio.create_task(one.stage(tables(0.02, rows=2000), lambda _: seen.set()))
        await asyncio.wait_for(seen.wait(), 60.0)
        control.order(how)
        assert not staging.done()
        await asyncio.sleep(0.3)
        control.order(back)
        await asyncio.wait_for(staging, 100.0)
        assert control.order("truth")["active"] == sums(OLD)
        await one.activate(tables(0.02, rows=2000))
    assert control.order("truth")["active"] == sums(tables(0.02, rows=2000))


async def test_an_adapter_that_stays_away_is_reported(control: SimulatedProcess) -> None:
    begin(control)
    async with store(control, timeout=1.5, reconnect_within=0.5, attempts=2) as one:
        control.order("unplug")
        try:
            with pytest.raises((LinkDownError, LinkTimeoutError)):
                await one.stage(NEW)
            with pytest.raises((LinkDownError, LinkTimeoutError)):
                await one.activate(NEW)
            other = CanopenStore("mill", one.config)
            with pytest.raises(LinkDownError, match="cannot open slcan"):
                await other.open()
        finally:
            control.order("plug")
    assert control.order("truth")["active"] == sums(OLD)
    with pytest.raises(LinkDownError, match="is not open"):
        await one.active()


async def test_a_node_that_restarts_has_lost_what_was_staged(control: SimulatedProcess) -> None:
    begin(control)
    async with store(control) as one:
        await one.stage(NEW)
        control.order("power_cut")
        assert await one.staged() == {}
        with pytest.raises(RefusedError, match="something else is staged"):
            await one.activate(NEW)
        await upload(one, NEW)
    assert control.order("truth")["active"] == sums(NEW)


@pytest.mark.parametrize(
    ("objects", "why"),
    [
        ({"staged": "2301"}, "is not an object like '2301:01'"),
        ({"staged": "2301:01h"}, "is not an object like"),
        ({"stagd": "2301:01"}, "Extra inputs"),
        ({"step": 0.0}, "greater than 0"),
    ],
)
def test_an_object_map_that_cannot_be(objects: dict[str, Any], why: str) -> None:
    section = {"interface": "socketcan", "channel": "can0", "node": 16, "objects": objects}
    with pytest.raises(ValidationError, match=why):
        CanopenStoreConfig.model_validate(section)


async def test_an_object_that_the_node_has_not_is_reported(control: SimulatedProcess) -> None:
    begin(control)
    async with store(control, objects={"serial": "1018:07"}, attempts=2) as one:
        with pytest.raises(RefusedError, match="1018h:07 of node 16: refused.*not exist"):
            await one.identity()
    async with store(control, objects={"axes": []}) as one:
        assert await one.effects() == ()
