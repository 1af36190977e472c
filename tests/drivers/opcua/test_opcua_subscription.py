"""A subscription to another maker's server, through a wire that holds back, repeats and cuts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from abbe.drivers.link import LinkState, Quality, Sample
from abbe.drivers.opcua.link import OpcuaLink
from tests.support.drivers.opcua.mill import Mill, linked, mill, node
from tests.support.drivers.opcua.wire import wired, x_of
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

_EVERY = 0.1
_READ_IN_STEPS = 0.002
"""s: JavaScript's clock has steps of a millisecond."""


def notified(link: OpcuaLink) -> bool:
    """Whether the link's values come from its subscription now."""
    return link.status.state is LinkState.UP and not link.status.detail


async def until_notified(link: OpcuaLink, name: str = "x") -> Sample:
    """Read a channel until its values come from the subscription."""

    async def looked() -> bool:
        return (await link.read((name,)))[name].good and notified(link)

    await until(looked, 30.0)
    return (await link.read((name,)))[name]


class Honesty:
    """Reads x, the true time at which the server sampled it, and holds it against its age."""

    def __init__(self, link: OpcuaLink) -> None:
        self._link, self._ours = link, time.time() - time.monotonic()
        self.good = 0
        self.oldest = 0.0

    async def look(self, wanted: Callable[[], bool] = lambda: False, seconds: float = 30.0) -> None:
        """Read until something is so, or for some s."""
        until = time.monotonic() + seconds
        while not wanted() and time.monotonic() < until:
            found = await x_of(self._link)
            if found.good:
                self.good += 1
                self.oldest = max(self.oldest, found.age())
                assert found.time <= found.value - self._ours + _READ_IN_STEPS
            await asyncio.sleep(0.01)


@pytest.mark.thorough
async def test_values_come_without_being_asked_for(server: Mill) -> None:
    async with linked(server.url, {"x": "x", "T": "T"}, subscribe=_EVERY) as link:
        await until_notified(link)
        asked = link.status.requests
        server.say(x={"value": 7.5}, T={"value": 21.5})
        await until(partial(shows, link, 7.5))
        assert (await link.read(("T",)))["T"].value == 21.5
        server.say(x={"value": 8.5, "status": "BadSensorFailure"})
        await until(partial(says, link, "BadSensorFailure"))
        assert (await link.read(("T",)))["T"].good
        # a busy computer may be late for three messages, and ask
        assert link.status.requests - asked < 20


@pytest.mark.one_in(2)
@pytest.mark.parametrize("stamp", ["none", "source"])
@pytest.mark.parametrize("step", [0.0, 1.8, -1.8])
async def test_what_a_stalled_network_kept_back_never_passes_as_new(
    server: Mill, stamp: str, step: float
) -> None:
    """Nothing comes for 2 s, then all at once; meanwhile the server's clock is set by that."""
    server.say(x={"clock": True})
    try:
        async with wired(server, subscribe=_EVERY, stamp=stamp, timeout=10.0) as (wire, link):
            await until_notified(link)
            honesty = Honesty(link)
            await honesty.look(seconds=0.3)
            wire.hold()
            asyncio.get_running_loop().call_later(2.0, wire.release)
            asyncio.get_running_loop().call_later(1.0, server.set_clock, step)
            await honesty.look(lambda: not wire.held)
            await honesty.look(seconds=0.5)
            await until_notified(link)
            await honesty.look(lambda: honesty.good > 10)
            assert honesty.good > 10
    finally:
        server.set_clock(0.0)


@pytest.mark.parametrize(
    ("again", "stamp"),
    [
        ("whole", "none"), ("whole", "source"), ("restamped", "none"), ("restamped", "source"),
        # without any stamp nothing tells an old value under a new number from a new one
        ("renumbered", "source"),
    ],
)  # fmt: skip
async def test_a_message_that_comes_again_never_passes_as_new(
    server: Mill, again: str, stamp: str
) -> None:
    server.say(x={"clock": True})
    async with wired(server, subscribe=_EVERY, stamp=stamp) as (wire, link):
        await until_notified(link)
        honesty = Honesty(link)
        wire.again = again
        await honesty.look(seconds=0.6)
        wire.again = ""
        await honesty.look(lambda: notified(link) and honesty.good > 5)
        assert honesty.good > 5
        assert notified(link)


async def test_an_axis_that_stands_still_is_as_young_as_the_last_message(server: Mill) -> None:
    """Its server renews a stamp when the value changes only."""
    server.say(x={"value": 4.0, "source_at": time.time() - 60.0})
    async with wired(server, subscribe=_EVERY, stamp="none", timeout=10.0) as (wire, link):
        await until_notified(link)
        first = await x_of(link)
        await until(partial(younger, link, first.time + 0.5))
        wire.hold()
        held_at = time.monotonic()
        asyncio.get_running_loop().call_later(1.0, wire.release)
        while wire.held:
            # notified of, or asked for: nothing is younger than the stall
            assert (await x_of(link)).time < held_at + 0.05 or not wire.held
            await asyncio.sleep(0.02)
    async with linked(server.url, {"x": "x"}, subscribe=_EVERY) as link:
        assert (await until_notified(link)).age() > 60.0


async def shows(link: OpcuaLink, value: float) -> bool:
    return (await x_of(link)).value == value


async def says(link: OpcuaLink, why: str) -> bool:
    return why in (await x_of(link)).reason


async def younger(link: OpcuaLink, than: float) -> bool:
    found = await x_of(link)
    assert found.good
    return found.time > than


async def test_a_subscription_that_the_server_forgets_is_made_anew_and_meanwhile_it_is_asked(
    server: Mill, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(server.url, {"x": "x"}, subscribe=_EVERY) as link:
        await until_notified(link)
        assert server.forget_subscriptions() >= 1
        await until(partial(good_but_asked, link))
        assert "asked, not notified" in link.status.detail
        server.say(x={"value": 9.5})
        await until(partial(shows, link, 9.5))
        await until_notified(link)
        assert server.forget_subscriptions() >= 1
    said = [r.message for r in caplog.records if "no subscription, so the server" in r.message]
    assert said
    assert link.status.reconnects == 0


async def good_but_asked(link: OpcuaLink) -> bool:
    assert (await x_of(link)).good
    return not notified(link)


@pytest.mark.thorough
async def test_a_server_that_was_started_again_is_subscribed_to_anew(tmp_path: Path) -> None:
    with mill(tmp_path) as first:
        async with linked(first.url, {"x": "x"}, subscribe=_EVERY) as link:
            await until_notified(link)
            first.kill()
            await until(lambda: link.status.state is LinkState.DOWN)
            assert (await x_of(link)).quality is Quality.UNAVAILABLE
            with mill(tmp_path, first.port, other_namespaces=3) as second:
                second.say(x={"value": 8.25})
                # what is notified of first may have been sampled before that was said
                await until(partial(shows, link, 8.25))
                await until_notified(link)
                await until(partial(shows, link, 8.25))
                assert link.status.reconnects >= 1


async def test_what_the_server_does_not_notify_of_is_asked_for_with_what_belongs_to_it(
    server: Mill,
) -> None:
    channels = {"x": "x", "y": "y", "T": "T", "no": node("nothing")}
    link_channels = ("x", "no")
    async with linked(server.url, channels, subscribe=_EVERY) as link:
        await until_notified(link, "T")
        assert "BadNodeIdUnknown" in (await link.read(link_channels))["no"].reason
        found = await link.read(("x", "y", "T"))
        assert all(sample.good for sample in found.values())


async def test_a_connection_that_is_cut_again_and_again_leaves_nothing_behind(server: Mill) -> None:
    async with wired(server, subscribe=_EVERY) as (wire, link):
        await until_notified(link)
        before = len(asyncio.all_tasks())
        for count in range(1, 3):
            wire.cut()
            await until(partial(reconnected, link, count))
            await until_notified(link)
        await until(lambda: len(asyncio.all_tasks()) <= before)


async def reconnected(link: OpcuaLink, count: int) -> bool:
    await x_of(link)
    return link.status.reconnects >= count
