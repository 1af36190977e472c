"""The configurations of a soak: the tormentor's, with records, control, HTTP and other limits."""

from __future__ import annotations

import socket
from pathlib import Path

from abbe.drivers.simulated.torment.configuration import write_configuration
from abbe.drivers.simulated.torment.judge.promises import Promises
from abbe.drivers.simulated.torment.wires.base import TormentWire

_BESIDE = """
[records]
file = "records.sqlite"
every = 0.2

[control]

[http]
listen = ["127.0.0.1:{port}"]

"""


def write_configurations(
    path: Path, wire: TormentWire, promises: Promises
) -> tuple[int, list[str]]:
    """Write the configuration, and ``model.toml`` beside it.

    Returns
    -------
    Where Abbe listens on this computer, and two texts of the configuration: as it is, and with a
    lower `max_rate`, which is within what was promised.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    write_configuration(path.parent, wire, promises)
    beside = _BESIDE.format(port=port)
    text = path.read_text(encoding="utf-8").replace("[controller]\n", beside + "[controller]\n")
    rate = f"max_rate = {promises.max_rate}"
    slower = text.replace(rate, f"max_rate = {0.9 * promises.max_rate:g}")
    if slower == text:
        raise ValueError(f"the tormentor's configuration has no {rate!r}")
    path.write_text(text, encoding="utf-8")
    return port, [text, slower]
