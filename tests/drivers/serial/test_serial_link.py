"""A serial link against simulated devices in their own process: values, checksums, commands."""

from __future__ import annotations

import asyncio
import contextlib
import math
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.drivers.link import (
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkState,
    Quality,
)
from abbe.drivers.serial.link import SerialLink
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.opening import until
from tests.support.drivers.serial.links import ALL, DRO, NUMBER, ONE_BY_ONE, PRESET, XOR, linked

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def standing() -> Iterator[SimulatedProcess]:
    """A read-out whose axes stand at 0, 90.9297 and −75.6802 mm."""
    with SimulatedProcess("serial", "dro", "--speed", "0") as dro:
        yield dro


STANDING = {"x": 0.0, "y": round(100 * math.sin(2.0), 4), "z": round(100 * math.sin(4.0), 4)}


@pytest.mark.parametrize("parts", [DRO, ONE_BY_ONE], ids=["one query", "a query each"])
async def test_positions_are_read(standing: SimulatedProcess, parts: dict) -> None:
    async with linked(standing.ready["device"], parts) as link:
        before = standing.order("queries")["queries"]
        samples = await link.read(("x", "y", "z"))
        assert {name: sample.value for name, sample in samples.items()} == STANDING
        assert all(0 <= s.age() < 1.0 for s in samples.values())
        assert link.status.state is LinkState.UP
        assert 0.0 < link.status.round_trip < 1.0
        after = standing.order("queries")["queries"]
        assert after - before == len(parts["messages"])


async def test_a_url_with_a_scheme_and_parity_that_a_pseudo_terminal_lacks(
    standing: SimulatedProcess,
) -> None:
    port = "serial://" + standing.ready["device"]
    async with linked(port, DRO, parity="E", bytesize=7, stopbits=2, baudrate=19200) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        assert (await link.read(("x",)))["x"].good


async def test_values_that_are_written_by_commands(standing: SimulatedProcess) -> None:
    parts = DRO | {"channels": DRO["channels"] | PRESET}
    async with linked(standing.ready["device"], parts) as link:
        await link.write({"preset_X": 12.5, "preset_Y": -3.25})
        samples = await link.read(("x", "y"))
        assert [s.value for s in samples.values()] == [12.5, -3.25]
        await link.write({"preset_X": STANDING["x"], "preset_Y": STANDING["y"]})
        with pytest.raises(LinkError, match="nothing written; not writable: x"):
            await link.write({"preset_X": 1.0, "x": 2.0})
        with pytest.raises(LinkError, match="nothing written; nan cannot be sent"):
            await link.write({"preset_X": 1.0, "preset_Y": math.nan})
        assert (await link.read(("x",)))["x"].value == STANDING["x"]
        assert (await link.read(("preset_X",)))["preset_X"].quality is Quality.BAD
        assert link.info("preset_X").writable
        assert not link.info("x").writable


async def test_a_command_that_the_device_refuses(standing: SimulatedProcess) -> None:
    bad = {"command": "NO{value}", "acknowledge": "OK"}
    parts = DRO | {"channels": DRO["channels"] | {"bad": bad, "preset_X": PRESET["preset_X"]}}
    async with linked(standing.ready["device"], parts) as link:
        with pytest.raises(LinkProtocolError, match=r"not written: bad: .*'\?' came.*before: pres"):
            await link.write({"preset_X": STANDING["x"], "bad": 1.0})


async def test_what_does_not_exist_is_said() -> None:
    async with linked("/dev/abbe-no-such-port", DRO) as link:
        assert link.status.state is LinkState.DOWN
        assert "there is no such device" in link.status.detail
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "/dev/abbe-no-such-port" in sample.reason
        with pytest.raises(LinkConfigError, match="no channel 'u'; there are: x, y, z"):
            await link.read(("u",))


async def test_a_second_link_on_the_same_port_is_refused_with_the_reason(
    standing: SimulatedProcess,
) -> None:
    port = standing.ready["device"]
    async with linked(port, DRO) as first, linked(port, DRO) as second:
        assert second.status.state is LinkState.DOWN
        assert "another program has it" in second.status.detail
        assert (await first.read(("x",)))["x"].good
    async with linked(port, DRO) as third:
        assert third.status.state is LinkState.UP


async def test_a_checksum_is_sent_and_checked() -> None:
    with SimulatedProcess("serial", "dro", "--speed", "0", "--checksum") as dro:
        position = {"query": "R", "pattern": ALL, "checksum": XOR}
        parts = DRO | {"messages": {"position": position}}
        async with linked(dro.ready["device"], parts) as link:
            assert (await link.read(("y",)))["y"].value == STANDING["y"]
            dro.order("fault", garbled=1)
            sample = (await link.read(("y",)))["y"]
            assert sample.quality is Quality.BAD
            assert "checksum" in sample.reason
            assert link.status.state is LinkState.UP
            assert (await link.read(("y",)))["y"].value == STANDING["y"]


async def test_without_a_checksum_only_the_pattern_protects(standing: SimulatedProcess) -> None:
    async with linked(standing.ready["device"], DRO) as link:
        standing.order("fault", garbled=1)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.BAD
        assert "does not fit" in sample.reason
        assert "'X+0~000.0000" in sample.reason
        assert (await link.read(("x",)))["x"].good


async def test_slow_messages_keep_their_value_and_its_time() -> None:
    with SimulatedProcess("serial", "thermometer") as modules:
        parts = {
            "messages": {
                "module_1": {"query": "#01", "pattern": rf">(?P<a>{NUMBER})(?P<b>{NUMBER})"},
                "module_2": {
                    "query": "#02",
                    "pattern": rf">(?P<a>{NUMBER})(?P<b>{NUMBER})",
                    "every": 30.0,
                },
            },
            "channels": {
                f"T{n}{field}": {"message": f"module_{n}", "field": field, "unit": "degC"}
                for n in (1, 2)
                for field in "ab"
            },
        }
        async with linked(modules.ready["device"], parts) as link:
            names = tuple(parts["channels"])
            first = await link.read(names)
            assert [s.value for s in first.values()] == [21.0, 21.5, 22.0, 22.5]
            modules.order("temperature", address=1, values=[23.125, 1.0])
            modules.order("temperature", address=2, values=[24.0, 2.0])
            await asyncio.sleep(0.05)
            second = await link.read(names)
            assert [s.value for s in second.values()] == [23.125, 1.0, 22.0, 22.5]
            assert second["T2a"].time == first["T2a"].time
            assert second["T1a"].time > first["T1a"].time
            assert link.info("T2a").every == 30.0
            assert "every 30 s" in link.channels["T2a"]


async def test_a_device_that_streams() -> None:
    with SimulatedProcess("serial", "dro", "--stream", "100", "--speed", "1") as dro:
        parts = DRO | {"messages": {"position": {"pattern": ALL, "within": 0.6}}}
        async with linked(dro.ready["device"], parts) as link:
            assert link.status.state is LinkState.UP
            seen = set()
            deadline = time.monotonic() + 5.0
            while len(seen) < 5 and time.monotonic() < deadline:
                samples = await link.read(("x", "y", "z"))
                assert len({s.time for s in samples.values()}) == 1
                if samples["x"].good:
                    seen.add(samples["x"].value)
                await asyncio.sleep(0.02)
            assert len(seen) == 5
            dro.order("silent", seconds=1.5)
            await until(lambda: link.status.state is LinkState.DOWN)
            sample = (await link.read(("x",)))["x"]
            assert sample.quality is Quality.UNAVAILABLE
            assert "message position did not come" in sample.reason
            await until(lambda: link.status.state is LinkState.UP)
            assert (await link.read(("x",)))["x"].good


async def test_one_of_two_streamed_messages_stops(tmp_path: Path) -> None:
    with SimulatedProcess("serial", "thermometer", "--stream", "50") as modules:
        parts = {
            "messages": {
                "all": {"pattern": rf"(?P<T>{NUMBER})( {NUMBER})+", "within": 1.0},
                "alarm": {"pattern": "ALARM (?P<alarm>ON|OFF)", "within": 0.2},
            },
            "channels": {
                "T": {"message": "all", "unit": "degC"},
                "alarm": {"message": "alarm", "values": {"ON": 1, "OFF": 0}},
            },
        }
        async with linked(modules.ready["device"], parts) as link:
            modules.order("say", text="noise\r\nALARM ON\r\n")
            await until(lambda: link.status.state is LinkState.UP)

            async def alarm_is_on() -> bool:
                return (await link.read(("alarm",)))["alarm"].value == 1.0

            await until(alarm_is_on)
            await until(lambda: link.status.state is LinkState.DEGRADED)
            assert list(link.status.quarantined) == ["message alarm"]
            samples = await link.read(("T", "alarm"))
            assert samples["T"].value == 21.0
            assert samples["alarm"].quality is Quality.UNAVAILABLE
            modules.order("say", text="ALARM OFF\r\n")
            await until(lambda: link.status.state is LinkState.UP)


async def answered(link: SerialLink, channel: str) -> float:
    """A channel's value, asked for again where a busy machine answered too late."""
    for _ in range(40):
        sample = (await link.read((channel,)))[channel]
        if sample.good:
            return sample.value
        await asyncio.sleep(0.1)
    return float("nan")


async def test_over_socat_and_a_socket(standing: SimulatedProcess, tmp_path: Path) -> None:
    """An unrelated program in between: device ⇄ socat ⇄ TCP ⇄ socat ⇄ pseudo-terminal ⇄ link."""
    near = tmp_path / "near"
    parts = DRO | {"channels": DRO["channels"] | PRESET}
    device = standing.ready["device"]
    with listening(device) as port:
        async with linked(f"socket://127.0.0.1:{port}", DRO, timeout=2.0) as link:
            assert link.status.state is LinkState.UP, link.status.detail
            assert await answered(link, "y") == STANDING["y"]
    with listening(device) as port:
        # ignoreeof: the link may close and open its side
        join = subprocess.Popen(  # noqa: ASYNC220
            ["socat", f"PTY,link={near},raw,echo=0,ignoreeof", f"TCP:127.0.0.1:{port}"]
        )
        try:
            await until(near.exists)
            async with linked(str(near), parts, timeout=2.0) as link:
                await until(lambda: link.status.state is LinkState.UP)
                assert await answered(link, "y") == STANDING["y"]
                join.terminate()
                join.wait(5)
                await until(lambda: link.status.state is LinkState.DOWN)
                with pytest.raises(LinkDownError):
                    await link.write({"preset_X": 1.0})
        finally:
            join.terminate()
            join.wait(5)


@contextlib.contextmanager
def listening(device: str) -> Iterator[int]:
    """The device behind a TCP port of socat's, for one connection; the port."""
    serve = subprocess.Popen(
        ["socat", "-d", "-d", "TCP-LISTEN:0,bind=127.0.0.1,reuseaddr", f"OPEN:{device},raw,echo=0"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert serve.stderr is not None
    try:
        line = next(line for line in serve.stderr if "listening on" in line)
        yield int(line.rsplit(":", 1)[1])
    finally:
        serve.terminate()
        serve.wait(5)
        serve.stderr.close()
