"""Linear fits: known errors come back, with honest uncertainties, whatever is not determined."""

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.effects import Angular, Positioning, Squareness
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model


def bridge() -> Machine:
    travels = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
    axes = {name: Axis(name, travel) for name, travel in travels.items()}
    return Machine("bridge", Structure.parse("w b Y X Z t"), axes)


def lines(
    places: dict[str, tuple[dict[str, np.ndarray], tuple[float, float, float]]],
    value: dict[str, np.ndarray],
    *,
    sd: float = 0.5e-3,
    free: tuple[str, ...] = ("zero",),
    kind: Kind = Kind.DISPLACEMENT,
) -> Campaign:
    setup = np.concatenate([np.full(len(value[name]), name) for name in places])
    n = len(setup)
    positions = {
        axis: np.concatenate(
            [np.broadcast_to(p[axis], value[k].shape) for k, (p, _) in places.items()]
        )
        for axis in "XYZ"
    }
    u = np.concatenate([np.tile(u, (len(value[k]), 1)) for k, (_, u) in places.items()])
    conditions = Conditions(positions, setup=setup, u=u, tool=np.zeros((n, 3)))
    empty = np.full(n, "")
    return Campaign(
        "test",
        conditions,
        np.full(n, kind, dtype=np.int8),
        np.concatenate(list(value.values())),
        np.full(n, sd),
        empty,
        empty,
        np.arange(n) + 2,
        {name: Setup(name, free) for name in places},
    )


def test_positioning_comes_back_and_its_constant_is_not_made_up() -> None:
    x = np.linspace(0.0, 700.0, 29)
    error = 8e-3 * np.sin(x / 150.0) + 0.1  # 0.1 mm: the interferometer's arbitrary zero
    campaign = lines({"a": ({"X": x, "Y": 450.0, "Z": -180.0}, (1.0, 0.0, 0.0))}, {"a": error})
    model = Model(bridge()).with_effects(Positioning(axis="X", shape="table", positions=tuple(x)))
    result = fit(model, campaign)
    got = np.array([v.value for v in result.model.terms[0].values.values()])
    assert got - got.mean() == pytest.approx(error - error.mean(), abs=1e-9)
    assert result.decomposition.rank == 28
    assert result.dof == 0
    zero = result.nuisances["a"]["zero"][0]
    assert zero + got == pytest.approx(error, abs=1e-9)
    # the frame of least errors: the machine's error averages to nothing over the travel
    assert abs(got.mean()) < 1e-3


def test_constant_angle_and_squareness_share_what_only_their_sum_shows() -> None:
    z = np.linspace(-360.0, 0.0, 13)
    places = {
        "z": ({"X": 350.0, "Y": 450.0, "Z": z}, (1.0, 0.0, 0.0)),
        "x": ({"X": 10.0 * z, "Y": 450.0, "Z": -180.0}, (0.0, 0.0, 1.0)),
    }
    campaign = lines(places, {"z": 40e-6 * z, "x": 0.0 * z})
    effects = (Squareness(axes=("X", "Z")), Angular(axis="X", about="Y", shape="constant"))
    result = fit(Model(bridge()).with_effects(*effects), campaign)
    angles = [next(iter(t.values.values())).value for t in result.model.terms]
    assert sum(angles) == pytest.approx(40e-6, rel=1e-9)
    assert result.decomposition.rank == 1
    # told as the squareness, the constant angle left at nothing
    assert angles[0] == pytest.approx(40e-6, rel=1e-3)
    (combination,) = result.undetermined
    assert combination.text.startswith(
        "squareness X–Z and E_BX are the same thing for this campaign"
    )
    assert combination.text.endswith("minimum-norm, in favour of squareness X–Z")
    assert combination.convention
