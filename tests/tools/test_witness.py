"""The witness of the proofs on a real systemd tells a ramp from what is none."""

from __future__ import annotations

import pytest

from tests.support.systemd.witness import Seen, ramp

RATE = 0.5
FULL = 28675


def looks(sizes: list[float], last_status: int = 0, every: int = 100) -> list[Seen]:
    """What a controller sees, a look every `every` ms; the last one has another status."""
    found = [
        Seen(i * every / 1e3, FULL, i, i * every, (size, -size / 2, 0.0))
        for i, size in enumerate(sizes)
    ]
    return [*found, Seen(9.0, last_status, 0, len(sizes) * every, (0.0, 0.0, 0.0))]


def test_a_ramp_is_said_in_words() -> None:
    said = ramp(looks([20, 20, 16, 12, 8, 4, 0, 0]), RATE)
    assert said == "20.0 µm to 0.0 in 5 steps, 0.5 s; status 0"


@pytest.mark.parametrize(
    ("seen", "complaint"),
    [
        (looks([20, 16, 12, 8, 4, 0], FULL), "status word 0 was never written"),
        (looks([20, 20, 20, 20, 0]), "no ramp"),
        (looks([0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0]), "no correction before"),
        (looks([20, 19, 18, 17, 16, 15, 14]), "did not come to zero"),
        (looks([20, 19, 18, 17, 16, 15, 0], every=10), "15.00 µm in 10 ms"),
    ],
)
def test_what_is_no_ramp_is_refused(seen: list[Seen], complaint: str) -> None:
    with pytest.raises(AssertionError, match=complaint):
        ramp(seen, RATE)
