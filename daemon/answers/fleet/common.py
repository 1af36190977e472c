"""The answer of ``abbe fleet common``: causes that several machines have."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.errors import InputError
from abbe.compcore.fleet.common_cause import CommonCause
from abbe.compcore.fleet.told import DiagnosedMachine, diagnosed
from abbe.daemon.answers.inputs import load
from abbe.daemon.fleet.asked.machine_folders import MachineFolder, measured_at


def diagnosed_machines(
    machines: Sequence[MachineFolder], tell: Callable[[str], None]
) -> list[DiagnosedMachine]:
    """Every campaign of every machine, diagnosed by itself.

    Raises
    ------
    InputError
        Where no machine has campaigns, and for bad files.
    """
    found = []
    for machine in machines:
        for path in machine.campaigns:
            tell(f"{machine.name}: {path.name}")
            model, campaign = load(machine.model, [path])
            at = measured_at(campaign, path)
            found.append(diagnosed(machine.name, at, diagnose(model, campaign)))
    if not found:
        raise InputError("no machine has campaigns", expected="[fleet] campaigns = [...]")
    return found


def as_json(asked: Sequence[DiagnosedMachine], found: Sequence[CommonCause]) -> dict[str, Any]:
    """One object for ``--json``; parameters in their units inside the code."""
    return {
        "machines": sorted({m.name for m in asked}),
        "campaigns": len(asked),
        "common": [
            {
                "spec": c.effect.spec,
                "evidence": c.evidence,
                "on": list(c.having),
                "asked": list(c.machines),
                "chances": {
                    n: float(chance) for n, chance in zip(c.machines, c.chances, strict=True)
                },
                "named_alone": list(c.alone),
                "since": None if c.since is None else c.since.isoformat(),
                "parameters": {
                    p.name: {"mean": float(mean), "spread": float(spread), "unit": p.unit}
                    for p, mean, spread in zip(c.parameters, c.mean, c.spread, strict=True)
                },
                "confusable_with": list(c.confusable),
            }
            for c in found
        ],
    }


def lines(asked: Sequence[DiagnosedMachine], found: Sequence[CommonCause]) -> Iterator[str]:
    """The same for people."""
    count = len({m.name for m in asked})
    yield f"{count} machines, {len(asked)} campaigns"
    for cause in found:
        yield from cause.words()
    if not found:
        yield "no cause is common to several machines"
