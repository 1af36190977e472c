"""The headline over a model's versions says what the last step did, by what is printed of it."""

from __future__ import annotations

import pytest

from abbe.daemon.report.model.history import error_title

ERROR = "The error "


@pytest.mark.parametrize(
    ("errors", "told"),
    [
        ((1.46,), "is 1.46 µm"),
        ((1.46, 0.4), "fell from 1.46 to 0.4 µm"),
        # less in a digit that nobody is shown is not less
        ((0.40013, 0.39998), "stays at 0.4 µm"),
        ((0.4, 0.409), "rose from 0.4 to 0.409 µm"),
        ((90.3, 9.58, 9.9), "fell from 90.3 to 9.9 µm; not by the last step"),
        ((90.3, 9.58, 9.5801), "fell from 90.3 to 9.58 µm; not by the last step"),
        ((90.3, 50.3, 20.1), "fell from 90.3 to 20.1 µm"),
    ],
)
def test_what_the_last_step_did(errors: tuple[float, ...], told: str) -> None:
    assert error_title([{"rms": e} for e in errors]) == ERROR + told


def test_held_out_counts_where_there_is_any() -> None:
    versions = [{"rms": 1.0, "holdout_rms": 1.2}, {"rms": 0.5, "holdout_rms": 1.3}]
    assert error_title(versions) == "The held-out error rose from 1.2 to 1.3 µm"
