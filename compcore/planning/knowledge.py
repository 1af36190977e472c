"""What is known of a machine, and what a set-up adds: information from the fit's design matrix.

The unknowns are those of `abbe.compcore.fitting`: the effects' linear parameters, in units of their
believable sizes, so that prior knowledge is the unit matrix (or the covariance of a fit). A set-up
adds ``JᵀWJ`` of the rows that it would give, with everything taken out that its placing leaves
unknown: zero, slope, frame, base point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.effects.base import SPINDLE, WORKPIECE, Component, Effect, ErrorMotion
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.usual_errors import UsualErrors
from abbe.compcore.linalg import svd
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import own_component
from abbe.compcore.model.model import Model
from abbe.compcore.planning.planned_setup import PlannedSetup, resting
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]

_RANK = 1e-10
_POINTS = 150
_SINGULAR = 1e-3
"""Part of its move by which an axis has to move the point aside of what the others can."""
CHANGED = 0.05
"""Part of its believable size by which a parameter may have changed since a model was fitted."""


@dataclass(frozen=True, eq=False)
class VolumeError:
    """The corrected machine's error over the volume, as a linear map of the unknowns.

    Attributes
    ----------
    field
        Shape (3·points, m): what one believable size of each unknown does to X, Y and Z, mm, as far
        as the machine's axes can take it back; moves of the workpiece as a whole, and of the tool
        in the spindle, are taken out.
    weight
        Shape (m, m): ``fieldᵀ field / points``; the trace of its product with a covariance is the
        mean square of the error left.
    """

    field: F64
    weight: F64

    @classmethod
    def of(cls, task: SurveyTask, count: int = _POINTS) -> VolumeError:
        """Points spread over all travels, from both sides, with every tool."""
        rng = np.random.default_rng(16907)
        machine = task.machine
        tools = np.array(list(task.tools.values()))
        at = Conditions(
            positions={a: _spread(rng, *task.ends(a), count) for a in machine.structure.axes},
            directions={a: rng.choice([-1.0, 1.0], count) for a in machine.structure.axes},
            tool=tools[np.arange(count) % len(tools)],
            signals={name: np.full(count, resting(machine, name)) for name in machine.signals},
        )
        chain = Chain(machine, at)
        within = _within_reach(chain)
        parts = [_field(task.model, at, u) for u in np.eye(3)]
        field = (within @ np.stack(parts, axis=1)).reshape(3 * count, -1)
        every = get_args(Component)
        moves = [ErrorMotion(WORKPIECE, k) for k in every]
        moves += [ErrorMotion(SPINDLE, k) for k in every if k in "XYZ"]
        each = np.stack([chain.influence(m)[0] for m in moves], axis=2)
        moved = (within @ each).reshape(3 * count, -1)
        left, size, _ = svd(moved / _sizes(moved))
        left = left[:, size > 1e-9 * size[0]]
        field = field - left @ (left.T @ field)
        return cls(field, field.T @ field / count)

    @classmethod
    def of_parameters(cls, task: SurveyTask, terms: tuple[int, ...]) -> VolumeError:
        """In place of the volume the parameters of some effects, in units of believable sizes.

        What tells these effects apart determines them all at once.
        """
        problem = Problem(task.model, _empty(task.model))
        wanted = np.concatenate([np.arange(problem.layout.model_size)[problem.layout.terms[t]]
                                 for t in terms])  # fmt: skip
        field = np.eye(problem.layout.model_size)[wanted]
        return cls(field, field.T @ field / len(wanted))

    def mean(self, covariance: F64) -> float:
        """Root of the mean square of what is left, over the volume, mm."""
        return float(np.sqrt(max(np.einsum("ij,ji->", self.weight, covariance), 0.0)))


def _within_reach(chain: Chain) -> F64:
    """What of a vector the axes can move the functional point along, as matrices, (n, 3, 3).

    Of a lathe nothing along Y: what it errs there stays, however well it is known.
    """
    structure = chain.machine.structure
    n = chain.conditions.n
    if len(structure.carrying) == len("XYZ"):
        return np.broadcast_to(np.eye(3), (n, 3, 3))
    letters = {k: k for k in get_args(Component)}
    own = {a: ErrorMotion(a, letters[own_component(a)]) for a in structure.axes}
    moves = [chain.influence(own[a])[0] for a in structure.axes]
    size = [np.maximum(np.linalg.norm(move, axis=1, keepdims=True), 1.0) for move in moves]
    columns = np.stack([move / s for move, s in zip(moves, size, strict=True)], axis=2)
    along, much, _ = np.linalg.svd(columns, full_matrices=False)
    along = along * (much > _SINGULAR)[:, None, :]
    return np.asarray(along @ np.swapaxes(along, 1, 2))


def _sizes(columns: F64) -> F64:
    size = np.linalg.norm(columns, axis=0)
    return np.where(size > 0.0, size, 1.0)


def _spread(rng: np.random.Generator, low: float, high: float, count: int) -> F64:
    return np.asarray(rng.permutation(np.linspace(low, high, count)))


def _field(model: Model, at: Conditions, u: F64) -> F64:
    n = at.n
    seen = replace(at, u=np.tile(u, (n, 1)), setup=np.full(n, "volume"))
    none = np.full(n, "", dtype="<U1")
    campaign = Campaign(
        "volume", seen, np.full(n, Kind.DISPLACEMENT, dtype=np.int8), np.zeros(n), np.ones(n),
        none, none, np.arange(n), {"volume": Setup("volume", ())},
    )  # fmt: skip
    return _columns(model, campaign)


def _empty(model: Model) -> Campaign:
    """One row, for the layout of the unknowns."""
    machine = model.machine
    one = np.array(["x"])
    at = Conditions(
        positions={a: np.array([axis.middle]) for a, axis in machine.axes.items()},
        signals={name: np.array([resting(machine, name)]) for name in machine.signals},
        setup=one,
        u=np.array([[1.0, 0.0, 0.0]]),
    )
    none = np.array([""])
    return Campaign(
        "", at, np.zeros(1, dtype=np.int8), np.zeros(1), np.ones(1), none, none, np.arange(1),
        {"x": Setup("x", ())},
    )  # fmt: skip


def _columns(model: Model, campaign: Campaign) -> F64:
    """Weighted columns of the model's unknowns in units of their scales; nuisances taken out."""
    problem = Problem(model, campaign)
    layout = problem.layout
    theta = layout.of_model(model, campaign)
    columns = problem.eliminator(theta).project(problem.columns(theta) * layout.scale)
    own, placed = columns[:, : layout.model_size], columns[:, layout.model_size :]
    if placed.shape[1]:
        left, size, _ = svd(placed / _sizes(placed))
        left = left[:, size > _RANK * size[0]]
        own = own - left @ (left.T @ own)
    return np.asarray(own)


def added(task: SurveyTask, setup: PlannedSetup) -> F64:
    """What one run of a set-up adds: a matrix R with ``RᵀR`` its information, (k, m).

    More runs of it multiply that by their number, since they share what the placing leaves unknown.
    """
    columns = _columns(task.model, setup.rows(task.machine))
    _, size, turned = svd(columns)
    kept = size > _RANK * max(float(size[0]) if len(size) else 0.0, 1e-300)
    return np.asarray(size[kept, None] * turned[kept] / np.sqrt(setup.runs))


def scales(model: Model) -> F64:
    """Believable size of each unknown of a model, (m,), in its unit."""
    problem = Problem(model, _empty(model))
    return np.asarray(problem.layout.scale[: problem.layout.model_size])


def scaled_values(model: Model) -> F64:
    """The values of the unknowns of a model, (m,), in their believable sizes."""
    campaign = _empty(model)
    layout = Problem(model, campaign).layout
    own = slice(0, layout.model_size)
    return np.asarray(layout.of_model(model, campaign)[own] / layout.scale[own])


def prior(model: Model, changed: float = CHANGED) -> F64:
    """What is known beforehand: covariance in units of the unknowns' scales, (m, m).

    Of a new model errors are as uncertain as they are believable, a scale as well as a squareness
    (`fitting.usual_errors`); of a fitted one as its fit says, and by what it may have `changed`
    since, as a part of its believable size.

    Raises
    ------
    InputError
        When the covariance is not that of the model's parameters.
    """
    scale = scales(model)
    if model.covariance is None:
        return _believable(model)
    fitted = [t.fitted for t in model.terms for _ in _parameters(model, t.effect)]
    if model.covariance.shape[0] != sum(fitted):
        raise InputError(
            "the covariance is not that of the model's parameters",
            field="covariance",
            found=model.covariance.shape[0],
            expected=str(sum(fitted)),
        )
    at = np.flatnonzero(fitted)
    found = np.eye(len(scale))
    size = scale[at]
    found[np.ix_(at, at)] = model.covariance / np.outer(size, size)
    found[at, at] += changed**2
    return found


def _believable(model: Model) -> F64:
    errors = UsualErrors.of(model, Problem(model, _empty(model)).layout)
    size = np.ones(len(errors.usual))
    own = len(scales(model))
    return errors.covariance(size)[:own, :own]


def _parameters(model: Model, effect: Effect) -> tuple[str, ...]:
    names = [p.name for p in effect.linear(model.machine)]
    return (*names, *(p.name for p in effect.nonlinear(model.machine)))


def unknowns(model: Model) -> NDArray[np.int64]:
    """The index of the effect that each unknown belongs to, (m,)."""
    layout = Problem(model, _empty(model)).layout
    return np.array([u.owner for u in layout.unknowns[: layout.model_size]], dtype=np.int64)
