"""The general form against equations written out by hand for one structure.

Zhang, Veale, Charlton, Borchardt, Hocken, CIRP Annals 34/1 (1985): moving bridge ``w b Y X Z t``.
Their scale errors δx(X), δy(Y), δz(Z) are reading minus actual and carry a minus here; α is the X-Y
squareness, β1 and β2 Z's to the X-Y plane; none of the three turns the probe.
"""

from __future__ import annotations

import numpy as np

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from tests.support.compcore.machines import LETTERS, machine, motions

N = 200


def draw(rng):
    """Positions, probe offsets, errors δ (mm) and ε (rad) of each axis, squarenesses (rad)."""
    q = {"X": rng.uniform(0, 700, N), "Y": rng.uniform(0, 900, N), "Z": rng.uniform(-360, 0, N)}
    probe = rng.uniform(-150, 150, (N, 3))
    delta = {a: rng.normal(0, 5e-3, (N, 3)) for a in "XYZ"}
    epsilon = {a: rng.normal(0, 30e-6, (N, 3)) for a in "XYZ"}
    return q, probe, delta, epsilon, rng.normal(0, 50e-6, 3)


def written_out(q, probe, delta, epsilon, squareness):
    """ΔX, ΔY, ΔZ = actual − indicated, mm."""
    (xp, yp, zp), (alpha, beta1, beta2) = probe.T, squareness
    x, z = q["X"], q["Z"]
    dx, dy, dz = (dict(zip("XYZ", (delta[a][:, k] for a in "XYZ"), strict=True)) for k in range(3))
    ex, ey, ez = (
        dict(zip("XYZ", (epsilon[a][:, k] for a in "XYZ"), strict=True)) for k in range(3)
    )
    sx, sy, sz = (e["X"] + e["Y"] + e["Z"] for e in (ex, ey, ez))
    return np.stack(
        [
            -dx["X"] + dx["Y"] + dx["Z"] - z * beta1 + z * (ey["X"] + ey["Y"]) - yp * sz + zp * sy,
            -dy["Y"]
            + dy["X"]
            + dy["Z"]
            - x * alpha
            - z * beta2
            + x * ez["Y"]
            - z * (ex["X"] + ex["Y"])
            + xp * sz
            - zp * sx,
            -dz["Z"] + dz["X"] + dz["Y"] - x * ey["Y"] - xp * sy + yp * sx,
        ],
        axis=1,
    )


def in_abbes_terms(q, delta, epsilon, squareness):
    """The same errors as error motions: actual − indicated, squareness as straightness gradient."""
    alpha, beta1, beta2 = squareness
    errors = {a: np.hstack([delta[a], epsilon[a]]) for a in "XYZ"}
    for k, a in enumerate("XYZ"):
        errors[a][:, k] *= -1.0
    errors["X"][:, 1] -= alpha * q["X"]
    errors["Z"][:, 0] -= beta1 * q["Z"]
    errors["Z"][:, 1] -= beta2 * q["Z"]
    return motions(errors)


def test_first_order_agrees_with_the_written_out_equations():
    q, probe, delta, epsilon, squareness = draw(np.random.default_rng(1985))
    chain = Chain(machine(), Conditions(q, tool=probe))
    got, rotation = first_order(chain, in_abbes_terms(q, delta, epsilon, squareness))
    expected = written_out(q, probe, delta, epsilon, squareness)
    assert np.abs(expected).max() > 0.02, "tens of micrometres"
    np.testing.assert_allclose(got, expected, atol=1e-14)
    np.testing.assert_allclose(rotation, sum(epsilon.values()), atol=1e-18)


def test_exact_composition_agrees_to_nanometres():
    q, probe, delta, epsilon, squareness = draw(np.random.default_rng(34))
    chain = Chain(machine(), Conditions(q, tool=probe))
    got, _ = exact(chain, in_abbes_terms(q, delta, epsilon, squareness))
    difference = np.abs(got - written_out(q, probe, delta, epsilon, squareness)).max()
    assert 1e-9 < difference < 3e-5


def test_each_single_error_appears_where_the_equations_say():
    """One error motion at a time: no sum can hide two wrong signs."""
    q, probe, delta, epsilon, _ = draw(np.random.default_rng(5))
    chain = Chain(machine(), Conditions(q, tool=probe))
    for a in "XYZ":
        for k in range(6):
            only_delta = {b: np.zeros((N, 3)) for b in "XYZ"}
            only_epsilon = {b: np.zeros((N, 3)) for b in "XYZ"}
            (only_delta if k < 3 else only_epsilon)[a][:, k % 3] = (
                delta[a][:, k] if k < 3 else epsilon[a][:, k - 3]
            )
            got, _ = first_order(chain, in_abbes_terms(q, only_delta, only_epsilon, (0, 0, 0)))
            expected = written_out(q, probe, only_delta, only_epsilon, (0, 0, 0))
            assert np.abs(expected).max() > 1e-3, f"E_{LETTERS[k]}{a} moves the probe"
            np.testing.assert_allclose(got, expected, atol=1e-14, err_msg=f"E_{LETTERS[k]}{a}")
