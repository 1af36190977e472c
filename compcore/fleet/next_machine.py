"""What the machines of a type say of the next one: a model with values and their covariance.

`abbe diagnose` takes it as what was known before the campaign, as it takes any fitted model: what
the new machine has that no other has is then a change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.effects.base import Effect
from abbe.compcore.fleet.pooled import PooledType
from abbe.compcore.model.model import Model, Term, Value


def next_machine(pooled: PooledType, like: Model) -> Model:
    """The model of a machine of the type that nobody has measured yet.

    Parameters
    ----------
    pooled
        What machines of the type have in common.
    like
        A model of one of them, for the machine itself; its own values are not taken.

    Returns
    -------
    Model
        The effects that all machines have, with the type's mean and, as covariance, how machines
        scatter about it.
    """
    effects: dict[str, tuple[Effect, list[int]]] = {}
    for j, parameter in enumerate(pooled.parameters):
        effects.setdefault(parameter.effect.spec, (parameter.effect, []))[1].append(j)
    terms, order = [], []
    for effect, rows in effects.values():
        linear = effect.linear(like.machine)
        if effect.nonlinear(like.machine) or len(linear) != len(rows):
            continue
        values = {
            pooled.parameters[j].parameter.name: Value(
                float(pooled.mean[j]), float(np.sqrt(pooled.covariance[j, j]))
            )
            for j in rows
        }
        terms.append(Term(effect, values))
        order += rows
    machine = replace(like.machine, name="")
    return Model(
        machine, tuple(terms), composition=like.composition,
        covariance=pooled.covariance[np.ix_(order, order)],
    )  # fmt: skip
