"""The answer of ``abbe fleet compare``: effects' parameters over the machines of a type."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from abbe.compcore.fleet.pooled import PooledParameter, PooledType
from abbe.compcore.units import in_digits, read_in

_UNLIKE = 3.0
"""Standard deviations from what the others lead one to expect that are said."""


def as_json(found: PooledType) -> dict[str, Any]:
    """One object for ``--json``; values in the units that people read."""
    return {
        "machines": list(found.names),
        "parameters": [_parameter(p, found.names) for p in found.parameters],
        "left_out": list(found.left_out),
    }


def _parameter(p: PooledParameter, names: tuple[str, ...]) -> dict[str, Any]:
    unit, factor = read_in(p.parameter)
    return {
        "spec": p.effect.spec,
        "parameter": p.parameter.name,
        "unit": unit,
        "mean": p.mean * factor,
        "mean_sd": p.mean_sd * factor,
        "spread": p.spread * factor,
        "next_sd": p.next_sd * factor,
        "q": p.q,
        "dof": p.dof,
        "machines": {
            name: {
                "value": p.values[i] * factor,
                "sd": p.sds[i] * factor,
                "pooled": p.pooled[i] * factor,
                "pooled_sd": p.pooled_sds[i] * factor,
            }
            for i, name in enumerate(names)
        },
    }


def lines(found: PooledType, kind: str = "") -> Iterator[str]:
    """The same for people; of one kind of effect, with each machine's own."""
    yield f"{len(found.names)} machines: {', '.join(found.names)}"
    chosen = [p for p in found.parameters if kind in ("", p.effect.kind)]
    texts = [(f"{p.effect.spec}: {p.parameter.name}", p) for p in chosen]
    width = max((len(text) for text, _ in texts), default=0)
    for text, p in texts:
        unit, factor = read_in(p.parameter)
        sure = f"{p.mean * factor:10.4g} ± {in_digits(p.mean_sd * factor, 2)} {unit}"
        scatter = f"machines scatter by {in_digits(p.spread * factor, 2)}{_apart(p, found)}"
        yield f"{text:{width}}  {sure}, {scatter}"
        if kind:
            for i, name in enumerate(found.names):
                yield (
                    f"  {name}: {in_digits(p.values[i] * factor, 4)} ± "
                    f"{in_digits(p.sds[i] * factor, 2)}, with what "
                    f"the others say {in_digits(p.pooled[i] * factor, 4)} ± "
                    f"{in_digits(p.pooled_sds[i] * factor, 2)}"
                )
    if found.left_out:
        yield f"not compared, because not all models have them: {'; '.join(found.left_out)}"


def _apart(p: PooledParameter, found: PooledType) -> str:
    far = [n for n, u in zip(found.names, p.unlike, strict=True) if abs(u) > _UNLIKE]
    return f"; unlike the others: {', '.join(far)}" if far else ""
