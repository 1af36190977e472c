"""What the live view shows of a run's status: numbers as people write them."""

from __future__ import annotations

import pytest

from abbe.daemon.status.run_status import AxisStatus
from abbe.daemon.workbench.live.shown import shown_axis


@pytest.mark.parametrize(
    ("indicated", "seen"), [(-0.00004, "0.0000 mm"), (-0.5, "−0.5000 mm"), (-10.05, "−10.0500 mm")]
)
def test_what_is_nothing_has_no_sign(indicated: float, seen: str) -> None:
    axis = AxisStatus(
        unit="mm", indicated=indicated, corrected=indicated, stale=False, age_s=0.0, fault="",
        correction=-0.00001, correction_unit="um", uncertainty=None, guard="active", written=True,
        reference=indicated,
    )  # fmt: skip
    shown = shown_axis("X", axis)
    assert shown["indicated"] == seen
    assert shown["measured"] == "0.0 µm before, 0.0 µm after"
    assert shown["correction"].startswith("0")
