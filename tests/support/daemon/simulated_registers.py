"""What the simulated bench would say of itself, for configurations that open nothing."""

from __future__ import annotations

from typing import Any

from abbe.drivers.simulated.bridge.registers import BLOCKS, transducer_configs


def ready_line() -> dict[str, Any]:
    """Its ready line, with a laser and a port that nobody listens at."""
    return {
        "host": "127.0.0.1",
        "port": 9,
        "unit": 1,
        "laser": "/nowhere",
        "registers": [{"block": b.name} | r.to_dict() for b in BLOCKS for r in b.registers],
        "transducers": transducer_configs(),
    }
