"""The null space of a campaign: mere convention (frame, zero), and what is truly unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.linalg import svd
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import SPINDLE, WORKPIECE, Component, ErrorMotion
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

VOLUME = "volume"
"""Places all over the machine's volume, with tools and all that a campaign recorded."""

_POINTS = 60
_ARM = 100.0
"""A rotation is compared with displacements over this length, mm."""
_FELT = 1e-5
"""A believable move of the unknowns that changes the error nowhere by more than this (mm), but for
one rigid displacement of the workpiece or of the tool in its holder, is convention: where a
workpiece or a tool sits is found on the machine itself."""
_UNFELT = 1e-3
"""A direction along which a believable move changes the data by less than this many standard
uncertainties may be moved along freely."""


@dataclass(frozen=True, eq=False)
class NullSpace:
    """The null space: the combinations of unknowns that a campaign does not determine.

    Attributes
    ----------
    convention
        Orthonormal (in units of the scales), shape (m, k): moving along them changes no error
        inside the machine's volume, or only displaces the frame in which errors are stated.
    unknown
        Shape (m, l): moving along them changes the machine's error, and nobody has measured it.
    """

    convention: F64
    unknown: F64

    def prior_covariance(self, scale: F64) -> F64:
        """Covariance of the unknown combinations, one scale along each, shape (m, m)."""
        half = scale[:, None] * self.unknown
        return np.asarray(half @ half.T)


def split_null_space(
    fields: ParameterFields, theta: F64, decomposition: Decomposition
) -> NullSpace:
    """Divide the null space into convention (moves nothing relative) and true ignorance.

    Parameters
    ----------
    fields
        What the parameters of what was fitted do to the error.
    theta, decomposition
        The solution and what of it is determined.
    """
    layout = fields.layout
    null, weak = decomposition.null, decomposition.singular[decomposition.rank :]
    stepped = [i for i, p in layout.searched.items() if not p.smooth]
    if stepped:
        # found by search, not by least squares: they are not undetermined
        keep = np.ones(layout.size, dtype=np.bool_)
        keep[stepped] = False
        others = np.linalg.norm(null[keep], axis=0) > 1e-9
        null, weak = null[:, others], weak[others]
    if not null.shape[1]:
        return NullSpace(null, null)
    field, frame = _displacements(fields, theta)
    felt = field @ (layout.scale[: layout.model_size, None] * null[: layout.model_size])
    left, size, _ = svd(frame)
    left = left[:, size > 1e-12 * size[0]]
    felt -= left @ (left.T @ felt)
    convention, unknown = null[:, :0], []
    # what the data feel, however weakly, must not be moved far for a convention's sake
    for exact in (True, False):
        own = (weak < _UNFELT) == exact
        square, turns = np.linalg.eigh(felt[:, own].T @ felt[:, own] / _POINTS)
        mixed = null[:, own] @ turns
        unknown.append(mixed[:, square > _FELT**2])
        if exact:
            convention = mixed[:, square <= _FELT**2]
    return NullSpace(convention, np.hstack(unknown))


def unsure(fields: ParameterFields, theta: F64, covariance: F64) -> float:
    """Standard uncertainty of the error over the volume, mm, root mean square.

    Without displacements of the workpiece and of the tool in its holder, which are convention.

    Parameters
    ----------
    fields, theta
        What the parameters do to the error, and the solution.
    covariance
        Of the model's parameters, (model_size, model_size).
    """
    field, frame = _displacements(fields, theta)
    left, size, _ = svd(frame)
    left = left[:, size > 1e-12 * size[0]]
    field = field - left @ (left.T @ field)
    return float(np.sqrt(max(0.0, np.sum((field @ covariance) * field)) / _POINTS))


def _displacements(fields: ParameterFields, theta: F64) -> tuple[F64, F64]:
    """Displacements over the volume by each parameter, and by moves of workpiece and tool."""
    machine = fields.model.machine
    somewhere = fields.place(VOLUME, lambda: sample_volume(machine, fields.campaign))
    field = _stacked(*fields.at(theta, VOLUME))
    chain = Chain.of(machine, somewhere)
    conventions = []
    for place in (WORKPIECE, SPINDLE):
        for component in get_args(Component):
            moved, turned = chain.influence(ErrorMotion(place, component))
            conventions.append(_stacked(moved[:, :, None], turned[:, :, None]))
    return field, np.hstack(conventions)


def _stacked(translation: F64, rotation: F64) -> F64:
    both = np.concatenate([translation, _ARM * rotation], axis=1)
    # without any effect there are no columns
    return both.reshape(both.shape[0] * both.shape[1], both.shape[2])


def sample_volume(machine: Machine, campaign: Campaign, count: int = _POINTS) -> Conditions:
    """Conditions spread over the machine's volume and somewhat beyond the campaign's ranges."""
    rng = np.random.default_rng(16907)
    c = campaign.conditions
    tool = c.tool if c.n else np.zeros((1, 3))
    sampled = Conditions(
        positions={a: rng.uniform(*machine.axes[a].travel, count) for a in machine.structure.axes},
        directions={a: rng.choice([-1.0, 1.0], count) for a in machine.structure.axes},
        tool=rng.uniform(tool.min(axis=0) - _ARM, tool.max(axis=0) + _ARM, (count, 3)),
        time=np.sort(rng.uniform(0.0, max(float(c.time.max(initial=0.0)), 1.0), count)),
        signals=_signals(c.signals, count, rng),
    )
    if c.spindle_angle is None:
        return sampled
    return replace(sampled, spindle_angle=rng.uniform(0.0, 2.0 * np.pi, count))


def _signals(recorded: Mapping[str, F64], count: int, rng: np.random.Generator) -> dict[str, F64]:
    found = {}
    for name, values in recorded.items():
        low, high = float(values.min()), float(values.max())
        wide = 0.5 * (high - low) + 1.0
        found[name] = rng.uniform(low - wide, high + wide, count)
    return found
