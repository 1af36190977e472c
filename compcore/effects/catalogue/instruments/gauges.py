"""Effects of a gauge or plate: its lengths were brought to 20 °C with a wrong coefficient."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.campaign.named_alike import named_alike
from abbe.compcore.effects.base import Effect, Motion, Parameter
from abbe.compcore.effects.catalogue.instruments.setup import MEASURED
from abbe.compcore.effects.keys import Names
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import by_sense, excess, recorded, require_temperatures
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine

_LENGTH = 10.0
"""mm: what is shorter is not measured as a length."""


@register
class GaugeExpansion(Effect):
    """A gauge or plate expands otherwise than was reckoned: a wrong coefficient, in all set-ups.

    Formula
        ``value = −α·(T − T0)·u·(p − p̄)`` for displacements along u in the set-ups that hold it; p
        the functional point in the workpiece's frame, p̄ the middle of the set-up's points. One
        coefficient for all set-ups; that of one set-up alone is `setup_scale`.
    Parameters
    ----------
        alpha in 1/K, true coefficient − the one that was reckoned with, within ±25 ppm/K: steel
        taken for Zerodur 11.5, aluminium for steel 12, ceramic for steel −7.
    Signals
        One temperature of the gauge or plate, °C.
    Typical causes
        The wrong material in the gauge's file or in the measuring program, a coefficient from a
        catalogue in place of the certificate, a correction made twice or not at all.
    Cure
        The coefficient of the certificate; the lengths reckoned anew. It is the gauge's, and never
        put right in the machine's tables.
    Source
        ISO 1:2022; ISO/TR 16015 (length measurements away from 20 °C); ISO 10360-2, annex D.
    """

    kind = "gauge_expansion"
    scope = "instrument"
    reads_tool = True
    signal: str
    setups: Names

    def check(self, machine: Machine) -> None:
        """A temperature."""
        super().check(machine)
        require_temperatures(machine, "signal", [self.signal])

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """What the coefficient is wrong by."""
        return (Parameter("alpha", "1/K", (-25e-6, 25e-6), "coefficient, true less reckoned"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``−(T − T0)·u·(p − p̄)`` on the set-ups' rows."""
        column = np.zeros((conditions.n, 1))
        if conditions.u is not None:
            warmth = excess(machine, conditions, self.signal, None)
            for name in self.setups:
                rows = np.flatnonzero(_displacements(conditions, name))
                if rows.size:
                    chain = Chain(machine, conditions.rows(rows))
                    toward = chain.to_workpiece(conditions.u[rows])
                    arm = chain.point - chain.point.mean(axis=0)
                    column[rows, 0] = -warmth[rows] * np.einsum("ni,ni->n", arm, toward)
        return (Motion(MEASURED, column),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None of the machine's: an instrument's effects are never folded."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[GaugeExpansion]:
        """Temperatures of the workpiece, on set-ups whose names begin alike.

        In several directions: what is seen along one axis only is that axis's own.
        """
        signals = [
            s for s in recorded(machine, coverage, temperature=True) if s.role == "workpiece"
        ]
        for signal in by_sense(signals, ("workpiece",)):
            for names in _alike(coverage):
                yield cls(signal=signal.name, setups=names)


def _displacements(conditions: Conditions, name: str) -> NDArray[np.bool_]:
    mask = conditions.setup_rows().mask(name)
    if conditions.kind is not None:
        mask = mask & np.equal(conditions.kind, Kind.DISPLACEMENT)
    return np.asarray(mask)


def _alike(coverage: Coverage) -> list[tuple[str, ...]]:
    """Set-ups of lengths that may hold one gauge: those whose names begin alike, less than all."""
    lengths = {
        name: seen
        for name, seen in coverage.setup_details.items()
        if seen.kinds == {"displacement"}
        and not seen.all_round
        and "slope" not in seen.free
        and (seen.spread > 1 or seen.along > max(_LENGTH, seen.across))
    }
    found = []
    for names in named_alike(lengths):
        toward = np.array([lengths[n].toward for n in names if lengths[n].toward])
        spread = max(lengths[n].spread for n in names)
        if toward.size:
            spread = max(spread, int(np.linalg.matrix_rank(toward, tol=0.3)))
        if spread > 1 and len(names) < len(coverage.setup_details):
            found.append(names)
    return found
