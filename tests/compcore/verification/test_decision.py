"""The decision rule of ISO 14253-1 by hand, and its zones."""

import pytest

from abbe.compcore.artefacts.decision_rule import Conformity, DecisionRule, decided, zone


@pytest.mark.parametrize(
    ("value", "outcome"),
    [
        (0.0, "passes"),
        (6.4, "passes"),
        (6.5, "passes"),  # 6.5 + 1.5 = 8: exactly the tolerance
        (6.6, "neither"),
        (8.0, "neither"),
        (9.5, "neither"),  # 9.5 − 1.5 = 8
        (9.6, "fails"),
    ],
)
def test_a_tolerance_of_8_with_u_of_1_5(value, outcome):
    assert decided(value, 8.0, 1.5) is Conformity(outcome)


def test_without_uncertainty_there_is_nothing_between():
    assert decided(8.0, 8.0, 0.0) is Conformity.PASSES
    assert decided(8.0000001, 8.0, 0.0) is Conformity.FAILS


def test_an_uncertainty_as_large_as_the_tolerance_proves_nothing_unless_it_is_far_off():
    assert decided(0.0, 2.0, 2.5) is Conformity.NEITHER
    assert decided(4.6, 2.0, 2.5) is Conformity.FAILS


def test_zones():
    assert zone(8.0, 1.5, DecisionRule.SIMPLE) == 8.0
    assert zone(8.0, 1.5, DecisionRule.ACCEPTANCE) == 6.5
    assert zone(8.0, 1.5, DecisionRule.REJECTION) == 9.5
