"""Axes that are read on one lattice of even steps, on several, on none."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.even_steps import even_steps
from abbe.compcore.machine.conditions import Conditions


def lines(*xs: np.ndarray) -> Conditions:
    """Lines along X, each in a set-up of its own; Y and Z stand."""
    at = np.concatenate(xs)
    setup = np.repeat([f"s{i}" for i in range(len(xs))], [len(x) for x in xs])
    still = np.full(len(at), 100.0)
    return Conditions(positions={"X": at, "Y": still, "Z": still}, setup=setup)


def test_one_lattice_there_and_back_and_again():
    x = np.linspace(10.0, 390.0, 20)
    seen = np.concatenate([x, x[::-1] + 2e-4])
    assert even_steps(lines(seen, x[::2])) == {"X": pytest.approx(20.0, rel=1e-3)}


def test_uneven_steps_and_two_lattices_tell_more():
    x = np.linspace(10.0, 390.0, 20)
    assert even_steps(lines(x + np.random.default_rng(1).uniform(-5.0, 5.0, 20))) == {}
    assert even_steps(lines(x, x + 7.0)) == {}
    assert even_steps(lines(x[:4])) == {}


def test_where_it_stands_for_another_axis_says_nothing():
    x = np.linspace(10.0, 390.0, 20)
    assert even_steps(lines(x, np.full(9, 123.4)))["X"] == pytest.approx(20.0)
