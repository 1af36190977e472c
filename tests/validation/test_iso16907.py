"""ISO/TR 16907: two ways of measuring agree; compensated machines; validation; rigid bodies."""

import pytest

from benchmarks.sources import flexing, iso16907


@pytest.fixture(scope="module")
def study() -> iso16907.Study:
    return iso16907.run(1)


def test_direct_and_indirect_measurements_agree_within_uncertainty(study: iso16907.Study) -> None:
    for name in ("direct – truth", "indirect – truth", "direct – indirect"):
        assert study.agreement[name].within > 0.88, name
    assert study.agreement["direct – indirect"].rms < 0.4e-3


def test_the_fit_is_no_worse_than_the_standards_order_by_hand(study: iso16907.Study) -> None:
    by_hand, fitted = study.agreement["by hand – truth"].rms, study.agreement["direct – truth"].rms
    assert by_hand < 0.6e-3
    assert fitted < by_hand
    assert study.agreement["by hand – direct"].rms < 0.5e-3


def test_a_compensated_machine_is_compensated_again(study: iso16907.Study) -> None:
    rms = study.superposed
    assert rms["superposed"] < rms["old"] < rms["bare"]
    # lines that were not fitted: no more than the laser's own noise, 0.5 µm
    assert rms["superposed"] < 0.6e-3
    # its angles show in full, its displacements only in part: fitted as they are, they disagree
    assert rms["unaware"] > rms["superposed"]


def test_flexing_is_found_where_it_is() -> None:
    worst = flexing.run(1, flexing.FLEX)[0]
    found = {f"{worst.motion} on {worst.by}", *worst.alike}
    assert {"E_ZX on Y", "E_ZY on X"} <= found
    assert worst.adjusted < 1e-6
    assert worst.rms > 0.1e-3


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_levers_and_squareness_are_not_flexing(seed: int) -> None:
    tests = flexing.run(seed, 0.0)
    assert len(tests) > 30
    assert tests[0].adjusted > 0.01
