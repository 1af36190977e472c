"""``python -m abbe.drivers.simulated``: machines and devices that exist only as numbers.

``bridge``, ``measure``, ``registers``: a coordinate measuring machine over Modbus. ``serial``:
ASCII devices and a tape reader on pseudo-terminals. ``can``: encoders and thermometers on CAN.
``controller``: a control with a memory for compensation tables, over Modbus, a serial line or CAN.
``ipp``: the measuring machine behind an I++ DME server. ``bench``: the machine
with a laser beside it. ``fleet``: many machines of one type. ``trunnion``: a five-axis machine with
an R-test in its spindle.

What serves prints one line of JSON on standard output when it listens, then serves until SIGTERM,
SIGINT, or (``--die-with-stdin``) until its standard input ends.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from abbe.drivers.simulated.commands import OWN_FILE


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    command = words[0] if words and words[0] in OWN_FILE else "bridge"
    status: int = import_module(f"abbe.drivers.simulated.commands.{command}").main(words)
    return status


if __name__ == "__main__":
    sys.exit(main())
