"""The configurations of a soak: the tormentor's, with records, control and other limits."""

from __future__ import annotations

from pathlib import Path

from abbe.drivers.simulated.torment.configuration import write_configuration
from abbe.drivers.simulated.torment.judge.promises import Promises
from abbe.drivers.simulated.torment.wires.base import TormentWire

_BESIDE = """
[records]
file = "records.sqlite"
every = 0.2

[control]

"""


def write_configurations(path: Path, wire: TormentWire, promises: Promises) -> list[str]:
    """Write the configuration, and ``model.toml`` beside it.

    Returns
    -------
    Two texts of the configuration: as it is, and with a lower `max_rate`, which is within what was
    promised.
    """
    write_configuration(path.parent, wire, promises)
    text = path.read_text(encoding="utf-8").replace("[controller]\n", _BESIDE + "[controller]\n")
    rate = f"max_rate = {promises.max_rate}"
    slower = text.replace(rate, f"max_rate = {0.9 * promises.max_rate:g}")
    if slower == text:
        raise ValueError(f"the tormentor's configuration has no {rate!r}")
    path.write_text(text, encoding="utf-8")
    return [text, slower]
