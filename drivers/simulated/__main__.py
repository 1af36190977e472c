"""``python -m abbe.drivers.simulated``: machines and devices that exist only as numbers.

``bridge``, ``measure``, ``registers``: a coordinate measuring machine over Modbus. ``serial``:
ASCII devices and a tape reader on pseudo-terminals. ``can``: encoders and thermometers on CAN.
``controller``: a control with a memory for compensation tables, over Modbus, a serial line or CAN.
``ipp``: the measuring machine behind an I++ DME server.

What serves prints one line of JSON on standard output when it listens, then serves until SIGTERM,
SIGINT, or (``--die-with-stdin``) until its standard input ends.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

_MODULES = {
    "serial": "serial_commands",
    "can": "can_commands",
    "controller": "controller_commands",
    "ipp": "ipp_commands",
}
"""Commands with a file of their own, so that what others import does not slow them down."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    module = _MODULES.get(words[0] if words else "", "bridge_commands")
    status: int = import_module(f"abbe.drivers.simulated.{module}").main(words)
    return status


if __name__ == "__main__":
    sys.exit(main())
