"""What each parameter of a fit does to the error at a few places, made anew only where needed."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.fitting.design.unknowns import UnknownLayout
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import sensitivities

F64 = NDArray[np.float64]


class ParameterFields:
    """Derivatives of the first-order error by a model's parameters, wherever a fit asks for them.

    Where errors add up they are the same for all values: only a non-linear parameter, or an effect
    that acts through others, has them made again for another θ.

    Parameters
    ----------
    model, campaign, layout
        What is fitted to what.
    """

    def __init__(self, model: Model, campaign: Campaign, layout: UnknownLayout) -> None:
        self.model, self.campaign, self.layout = model, campaign, layout
        self._moving = bool(layout.searched) or any(e.reads_model for e in model.effects)
        self._places: dict[Hashable, Conditions] = {}
        self._found: dict[Hashable, tuple[bytes, tuple[F64, F64]]] = {}

    def place(self, name: Hashable, made: Callable[[], Conditions]) -> Conditions:
        """The places of a name; `made` the first time that a fit to the campaign asks for them."""
        if name not in self._places:
            machine = self.model.machine
            # what is kept holds the machine, so that its id stays its own
            key = ("places", name, id(machine))
            kept = self.campaign.conditions.kept(key, lambda: (machine, made()))
            self._places[name] = kept[1]
        return self._places[name]

    def at(self, theta: F64, name: Hashable) -> tuple[F64, F64]:
        """Derivatives at the named places for a model at θ, as of `sensitivities`; not a copy."""
        values = theta[: self.layout.model_size]
        key = values.tobytes() if self._moving else b""
        if name not in self._found or self._found[name][0] != key:
            model = self.model.with_values(self.layout.values(theta, np.zeros(self.layout.size)))
            self._found[name] = (key, sensitivities(model, self._places[name]))
        return self._found[name][1]
