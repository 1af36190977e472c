"""A campaign's rows prepared for a model: conditions, measurement equations, error motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.effects.base import Effect, ErrorMotion, Motion
from abbe.compcore.fitting.design.common_errors import CommonErrors
from abbe.compcore.fitting.design.nuisance import (
    Eliminator,
    SetupNuisances,
    rows_of_setups,
    setup_blocks,
)
from abbe.compcore.fitting.design.observation import Observation, with_tools
from abbe.compcore.fitting.design.row_blocks import RowBlock, row_blocks, rows_at_once
from abbe.compcore.fitting.design.run_starts import Bodies, since_begin
from abbe.compcore.fitting.design.turned_frames import TurnedFrames
from abbe.compcore.fitting.design.unknowns import UnknownLayout
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model, Term

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_Key = tuple[tuple[float, ...], bytes]


class OutsideEffect(NamedTuple):
    """An effect that is laid beside a model.

    `nonlinear`: its non-linear parameters by name; `through`: θ for one that acts through the
    model's effects, None where the model stands.
    """

    effect: Effect
    nonlinear: Mapping[str, float]
    through: F64 | None = None

    def at(self, theta: F64) -> F64:
        """Where its columns are made, for a model at θ."""
        return theta if self.through is None else self.through


class PreparedRows:
    """A campaign's rows, prepared for a model that is laid beside them.

    The unknowns θ are the effects' parameters (fitted effects and unfitted ones alike), base points
    and tools, in the order of `layout`. Set-ups' nuisances are kept apart (`eliminator`). What was
    worked out for a θ is kept as long as it stays what the rows ask for.

    Parameters
    ----------
    model, campaign
        The model (values are not used; see `UnknownLayout.of_model`) and the measurements.
    sd
        Standard uncertainty of each row, (n,), mm or rad; default the campaign's own. Every entry
        must be positive (`abbe.compcore.fitting.design.weights` fills gaps); infinity takes a row
        out of the fit.
    bodies
        Whose beginnings are free in each run (`run_starts`).

    Attributes
    ----------
    weight
        1/sd, shape (n,).
    prior_sd
        Shape (layout.size,): how far from 0 an unknown may well lie; infinite for most.
    expected
        Shape (rows, layout.size): combinations of the unknowns that are expected to be 0, each
        divided by its standard uncertainty; None: nothing is.
    """

    def __init__(
        self,
        model: Model,
        campaign: Campaign,
        *,
        sd: F64 | None = None,
        bodies: Bodies = "asked",
    ) -> None:
        self.model = model
        self.campaign = campaign
        self.layout = UnknownLayout.of(model, campaign, bodies)
        self.prior_sd = np.full(self.layout.size, np.inf)
        self.expected: F64 | None = None
        self.sd = campaign.sd if sd is None else sd
        self.weight = 1.0 / self.sd
        self._amending = [i for i, e in enumerate(model.effects) if e.reads_model]
        self._given: dict[int, tuple[Motion, ...]] = {}
        self._beside: dict[str, tuple[Motion, ...]] = {}
        self._motions: dict[int, tuple[_Key, tuple[Motion, ...]]] = {}
        self._settling: dict[int, tuple[tuple[float, ...], tuple[Motion, ...]]] = {}
        self._tool_directions: dict[int, F64] = {}
        self._block = False
        self._moved: tuple[bytes, dict[ErrorMotion, F64]] | None = None
        self._read: tuple[bytes, F64] | None = None
        self._tangent: tuple[bytes, Observation] | None = None
        self._frames: tuple[bytes, TurnedFrames | None] | None = None
        self._turned: tuple[TurnedFrames, list[SetupNuisances]] | None = None
        self._conditions: tuple[bytes, Conditions] | None = None
        self._observation: tuple[bytes, Observation] | None = None
        self._rows_of_setups: list[tuple[str, Index]] | None = None
        self._blocks: tuple[Observation | None, list[SetupNuisances]] | None = None
        self._eliminator: tuple[list[SetupNuisances], Eliminator] | None = None

    def with_sd(self, sd: F64) -> Self:
        """The problem with other uncertainties of the rows, (n,); shares what is prepared."""
        other = self._copy()
        other.sd, other.weight, other._eliminator = sd, 1.0 / sd, None
        if self._frames is not None and self._frames[1] is not None:
            # how instruments stand is found with the rows' weights
            other._frames = other._read = other._tangent = other._blocks = None
        return other

    def part(self, rows: Index, theta: F64) -> Self:
        """The problem of some of the rows with the same unknowns; keeps nothing of this one.

        What an effect of the instrument or a lagged signal means depends on the whole campaign and
        is taken from it.
        """
        other = self._copy()
        self._keep_lags(theta)
        other.campaign = self.campaign.rows(rows)
        other.sd, other.weight = self.sd[rows], self.weight[rows]
        other._motions, other._settling, other._tool_directions = {}, {}, {}
        other._conditions = other._observation = other._blocks = other._eliminator = None
        other._block = self.large
        other._rows_of_setups = other._moved = other._read = other._tangent = None
        other._frames = other._turned = None
        other._given = {
            i: tuple(m.rows(rows) for m in self.motions(i, theta))
            for i, effect in enumerate(self.model.effects)
            if effect.scope == "instrument"
        }
        other._beside = {
            key: tuple(m.rows(rows) for m in motions) for key, motions in self._beside.items()
        }
        return other

    def prepared_for(self, effects: Sequence[OutsideEffect], theta: F64) -> Self:
        """The problem, its parts also prepared for effects that need the whole campaign."""
        other = self._copy()
        for one in effects:
            self._keep_lags_of(one.effect, one.nonlinear)
        other._beside = {
            _named(one.effect, one.nonlinear): self._motions_of(
                one.effect, one.nonlinear, one.at(theta)
            )
            for one in effects
            if one.effect.scope == "instrument"
        }
        return other

    def _copy(self) -> Self:
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def _keep_lags(self, theta: F64) -> None:
        """Have the conditions keep every lagged signal that the effects will ask for."""
        for i, effect in enumerate(self.model.effects):
            self._keep_lags_of(effect, self.layout.nonlinear_values(i, theta))

    def _keep_lags_of(self, effect: Effect, nonlinear: Mapping[str, float]) -> None:
        conditions = self.campaign.conditions
        if effect.signals_needed() and effect.scope != "instrument":
            few = conditions.rows(np.arange(min(2, conditions.n)))
            effect.motions(self.model.machine, few, nonlinear)
            for name, tau in few.lags_computed():
                conditions.lag(name, tau)

    @property
    def n(self) -> int:
        """Number of rows."""
        return self.campaign.n

    @property
    def large(self) -> bool:
        """Whether the design matrix is too large to be formed as a whole."""
        return self.n > rows_at_once(self.layout.size + 1)

    @property
    def linear(self) -> bool:
        """Whether the measured values are linear in θ for given non-linear parameters."""
        placed = self.layout.bases or self.layout.tools or self._amending
        return not placed and self.model.composition == "first-order"

    def row_blocks(self, theta: F64) -> Iterator[RowBlock]:
        """The rows in blocks of which each one's design matrix can be formed."""
        return row_blocks(self.eliminator(theta), self.layout.size + 1)

    def observation(self, theta: F64) -> Observation:
        """The measurement equations for the base points and tools in θ."""
        key = theta[self.layout.model_size :].tobytes()
        if self._observation is None or self._observation[0] != key:
            bases = {name: theta[where] for name, where in self.layout.bases.items()}
            conditions = self.conditions(theta)
            chain = None
            if self._observation is not None:
                # θ moves tools and readings, and never where the axes stand
                chain = self._observation[1].chain.with_tool(conditions.tool)
            machine = self.model.machine
            seen = Observation(machine, self.campaign, conditions, bases, chain)
            self._observation = (key, seen)
        return self._observation[1]

    def conditions(self, theta: F64) -> Conditions:
        """The rows' conditions with the tools in θ, and readings as θ's effects amend them."""
        campaign, layout = self.campaign, self.layout
        if not layout.tools and not self._amending:
            return campaign.conditions
        key = self._conditions_key(theta)
        if self._conditions is None or self._conditions[0] != key:
            offsets = {}
            for name, (where, free) in layout.tools.items():
                offsets[name] = np.array(campaign.tools[name].offset, dtype=np.float64)
                offsets[name][list(free)] = theta[where]
            amended = with_tools(campaign.conditions, campaign.tool_name, offsets)
            for i in self._amending:
                own = theta[layout.linear_of(i)]
                amended = self.model.effects[i].amend(self.model.machine, amended, own)
            self._conditions = (key, amended)
        return self._conditions[1]

    def _conditions_key(self, theta: F64) -> bytes:
        parts = [theta[self.layout.linear_of(i)] for i in self._amending]
        parts += [theta[where] for where, _ in self.layout.tools.values()]
        return np.concatenate(parts).tobytes() if parts else b""

    @property
    def framed(self) -> bool:
        """Whether a set-up leaves unknown how its instrument stands."""
        return any("frame" in setup.free for setup in self.campaign.setups.values())

    def setups(self, theta: F64) -> list[SetupNuisances]:
        """The nuisance columns of each set-up, unweighted."""
        observation = self.observation(theta) if self.framed else None
        if self._blocks is None or self._blocks[0] is not observation:
            if self._rows_of_setups is None:
                self._rows_of_setups = rows_of_setups(self.campaign)
            found = setup_blocks(self.campaign, observation, self._rows_of_setups)
            self._blocks = (observation, found)
        return self._blocks[1]

    def eliminator(self, theta: F64) -> Eliminator:
        """The projection of set-ups' nuisances out of weighted columns."""
        blocks = self.setups(theta)
        if self._eliminator is None or self._eliminator[0] is not blocks:
            common = CommonErrors.of(self.campaign, self.weight)
            self._eliminator = (blocks, Eliminator(blocks, self.weight, common))
        return self._eliminator[1]

    def motions(self, term: int, theta: F64) -> tuple[Motion, ...]:
        """A term's error motions at all rows, kept while its non-linear parameters stay."""
        if term in self._given:
            return self._given[term]
        effect = self.model.effects[term]
        if effect.reads_model:
            return self._motions_of(effect, self.layout.nonlinear_values(term, theta), theta)
        nonlinear = self.layout.nonlinear_values(term, theta)
        depends = effect.signals_needed() or effect.reads_tool
        key = (tuple(nonlinear.values()), self._conditions_key(theta) if depends else b"")
        if term not in self._motions or self._motions[term][0] != key:
            self._motions[term] = (key, self._motions_of(effect, nonlinear, theta))
        return self._motions[term][1]

    def settling(self, term: int, nonlinear: Mapping[str, float]) -> tuple[Motion, ...]:
        """What a term's bodies move while they settle from 1 unit above their signals."""
        key = tuple(nonlinear.values())
        if term not in self._settling or self._settling[term][0] != key:
            conditions = self.campaign.conditions
            since = since_begin(self.layout.starts_of(term), conditions)
            effect = self.model.effects[term]
            moved = effect.settling(self.model.machine, conditions, nonlinear, since)
            self._settling[term] = (key, moved)
        return self._settling[term][1]

    def effect_motions(
        self, effect: Effect, nonlinear: Mapping[str, float], theta: F64
    ) -> tuple[Motion, ...]:
        """The error motions of any effect at all rows; arguments as of `effect_columns`."""
        found = self._beside.get(_named(effect, nonlinear)) if self._beside else None
        return self._motions_of(effect, nonlinear, theta) if found is None else found

    def _motions_of(
        self, effect: Effect, nonlinear: Mapping[str, float], theta: F64
    ) -> tuple[Motion, ...]:
        conditions, machine = self.conditions(theta), self.model.machine
        if not effect.reads_model:
            return effect.motions(machine, conditions, nonlinear)
        values = self.layout.values(theta, np.zeros(self.layout.size))
        terms = [
            Term(other.effect, own) for other, own in zip(self.model.terms, values, strict=True)
        ]
        return effect.motions_among(machine, conditions, nonlinear, terms)


def _named(effect: Effect, nonlinear: Mapping[str, float]) -> str:
    return f"{effect.spec} {sorted(nonlinear.items())}"
