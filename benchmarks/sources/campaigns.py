"""Simulated rows as a campaign, without the way through a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup, Tool
from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]


@dataclass
class Rows:
    """Measured rows, gathered set-up by set-up; mm, rad, s.

    Attributes
    ----------
    axes
        Names of the axes, whose positions each block of rows must give.
    """

    axes: tuple[str, ...]
    blocks: list[dict[str, F64 | NDArray[np.str_]]] = field(default_factory=list)
    setups: dict[str, Setup] = field(default_factory=dict)

    def add(
        self,
        setup: str,
        kind: Kind,
        positions: Mapping[str, F64 | float],
        value: F64,
        sd: float,
        *,
        u: F64 | tuple[float, float, float] = (0.0, 0.0, 0.0),
        free: tuple[str, ...] = ("zero",),
        tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
        tool_name: str = "",
        base: str = "",
        base2: str = "",
        time: F64 | float = 0.0,
        signals: Mapping[str, F64 | float] | None = None,
        spindle: F64 | float = 0.0,
        directions: Mapping[str, F64 | float] | None = None,
    ) -> None:
        """Add rows of one set-up; numbers stand for all of them."""
        n = len(value)

        def column(v: F64 | float) -> F64:
            return np.broadcast_to(np.asarray(v, dtype=np.float64), (n,))

        block: dict[str, F64 | NDArray[np.str_]] = {
            "value": value,
            "sd": column(sd),
            "kind": column(float(kind)),
            "time": column(time),
            "u": np.broadcast_to(np.asarray(u, dtype=np.float64), (n, 3)),
            "tool": np.broadcast_to(np.asarray(tool), (n, 3)),
            "spindle": column(spindle),
        }
        names = {"setup": setup, "tool_name": tool_name, "base": base, "base2": base2}
        block |= {key: np.full(n, text) for key, text in names.items()}
        block |= {f"axis {a}": column(positions.get(a, 0.0)) for a in self.axes}
        block |= {f"dir {a}": column((directions or {}).get(a, 0.0)) for a in self.axes}
        block |= {f"signal {k}": column(v) for k, v in (signals or {}).items()}
        self.blocks.append(block)
        self.setups[setup] = Setup(setup, free)

    def campaign(
        self,
        name: str,
        *,
        bases: Mapping[str, tuple[float, float, float]] | None = None,
        tools: Mapping[str, Tool] | None = None,
        order: NDArray[np.int64] | None = None,
    ) -> Campaign:
        """All rows as a campaign; `order` rearranges them (measured in random order)."""
        whole = {k: np.concatenate([b[k] for b in self.blocks]) for k in self.blocks[0]}
        if order is not None:
            whole = {k: v[order] for k, v in whole.items()}
        tool = whole["tool"].astype(np.float64)
        for known in (tools or {}).values():
            tool[whole["tool_name"] == known.name] = known.offset
        conditions = Conditions(
            positions={a: whole[f"axis {a}"] for a in self.axes},
            directions={a: whole[f"dir {a}"] for a in self.axes},
            tool=tool,
            time=whole["time"],
            signals={k[7:]: v for k, v in whole.items() if k.startswith("signal ")},
            spindle_angle=whole["spindle"] if np.any(whole["spindle"]) else None,
            setup=whole["setup"],
            u=whole["u"],
            base=whole["base"],
        )
        return Campaign(
            name=name,
            conditions=conditions,
            kind=whole["kind"].astype(np.int8),
            value=whole["value"],
            sd=whole["sd"],
            base2=whole["base2"],
            tool_name=whole["tool_name"],
            line=np.arange(len(whole["value"]), dtype=np.int64) + 2,
            setups=self.setups,
            bases=dict(bases or {}),
            tools=dict(tools or {}),
        )
