"""Orders to a simulated device over its standard input: one JSON object a line, each answered.

``{"do": "silent", "seconds": 0.5}`` is answered by ``{"done": "silent"}`` on standard output, or
by ``{"failed": …}``. When the input ends, the device ends too (its parent is gone).
"""

from __future__ import annotations

import asyncio
import inspect
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

Orders = Mapping[str, Callable[..., Any]]
"""Order → what carries it out; takes the object's other keys, may hand back more for the answer."""


def announce(**facts: Any) -> None:
    """Write one line of JSON to standard output."""
    sys.stdout.write(json.dumps(facts) + "\n")
    sys.stdout.flush()


async def serve_orders(orders: Orders, *, die_with_stdin: bool) -> None:
    """Carry out orders until SIGTERM, SIGINT, or the end of the input where so wanted."""
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    if die_with_stdin:
        reader = threading.Thread(target=_read_orders, args=(loop, orders, stop), daemon=True)
        reader.start()
    await stop.wait()


def _read_orders(loop: asyncio.AbstractEventLoop, orders: Orders, stop: asyncio.Event) -> None:
    held = b""
    # os.read holds no lock of sys.stdin, which would trouble the interpreter's end.
    while data := os.read(0, 4096):
        *lines, held = (held + data).split(b"\n")
        for line in lines:
            loop.call_soon_threadsafe(_carry_out, orders, line)
    loop.call_soon_threadsafe(stop.set)


def _carry_out(orders: Orders, line: bytes) -> None:
    try:
        order = json.loads(line)
        name = order.pop("do")
        function = orders[name]
        inspect.signature(function).bind(**order)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        announce(failed=f"{type(error).__name__}: {error}", known=sorted(orders))
        return
    announce(done=name, **(function(**order) or {}))
