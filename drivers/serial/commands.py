"""Commands on a serial line: a text for each value, sent one after the other."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping

from abbe.drivers.batch import Batch
from abbe.drivers.bus_lock import BusLock
from abbe.drivers.link import LinkError
from abbe.drivers.serial.config import SerialConfig


async def send_commands(
    label: str,
    config: SerialConfig,
    bus_lock: BusLock,
    values: Mapping[str, float],
    send: Callable[[str, str], Awaitable[None]],
) -> None:
    """Send a command for each value, in the order in which they are named.

    Parameters
    ----------
    label
        The link, for people.
    config
        Its section: how a channel writes its values.
    bus_lock
        Held while they are sent.
    values
        Channel → value, in the channel's unit.
    send
        Sends one: its channel and the text of its value.

    Raises
    ------
    LinkError
        When a value was not taken; says which, and which were before.
    """
    batch = Batch(label, values)
    try:
        texts = {name: config.channels[name].text_of(value) for name, value in values.items()}
    except ValueError as error:
        raise batch.refused(str(error)) from None
    try:
        async with bus_lock:
            for name, text in texts.items():
                batch.begin(name)
                await send(name, text)
                batch.done()
    except LinkError as error:
        raise batch.failed(error) from error
