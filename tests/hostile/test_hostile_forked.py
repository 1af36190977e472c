"""What a case holds is judged apart from what the tests hold beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.hostile.forked import Case, faults, run


def _holds(megabytes: int) -> Case:
    def work() -> None:
        held = bytearray(megabytes * 1_000_000)
        held[::4096] = b"\1" * len(held[::4096])
        raise SystemExit(1)

    return Case("holds", {}, work, may_succeed=True)


@pytest.mark.parametrize("beside", [1, 600])
@pytest.mark.parametrize(("megabytes", "much"), [(50, False), (350, True)])
def test_too_much_memory_is_seen_beside_any_other(
    tmp_path: Path, megabytes: int, much: bool, beside: int
) -> None:
    others = bytearray(b"\1") * (beside * 1_000_000)
    case = _holds(megabytes)
    found = faults(case, run(case, tmp_path), tmp_path)
    assert len(others) == beside * 1_000_000
    assert any(word.endswith(" MB") for word in found) is much, found
