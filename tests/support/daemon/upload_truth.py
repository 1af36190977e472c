"""What has to hold after every upload, whatever went wrong: asked of the control itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.upload.outcome import UploadOutcome
from tests.support.daemon.upload_cases import Place, sums, texts

Sums = dict[str, str]

STEPS: dict[str, dict[str, Any]] = {
    "identity": {"at": "identity"},
    "state": {"at": "state"},
    "backup": {"at": "read_active"},
    "begin": {"at": "begin"},
    "block": {"at": "block", "skip": 3},
    "compare": {"at": "read_staged"},
    "ready": {"at": "state", "after": "read_staged"},
    "activate": {"at": "commit"},
    "verify": {"at": "read_active", "after": "commit"},
    "effect": {"at": "show"},
}
"""Step → where a fault is armed."""
_READ = ("lost_answer", "late_answer", "twice", "bad_answer", "refuses", "lies", "restart_after",
         "hang")  # fmt: skip
_WRITE = ("lost_request", "bad_request", "restart", "hang_after")


def cases() -> list[tuple[str, str]]:
    """Every step with every fault that means something there.

    What is only read has nothing to be done: a request lost and an answer lost are the same.
    """
    found = []
    for step, where in STEPS.items():
        kinds = _READ
        if where["at"] in ("begin", "block", "commit"):
            kinds += _WRITE
        if where["at"] == "commit":
            kinds += ("restart_amid",)
        found += [(step, kind) for kind in kinds]
    return found


def try_fault(
    place: Place, made: Path, step: str, kind: str, quick: dict[str, Any], patient: dict[str, Any]
) -> str:
    """One upload with one fault; everything that has to hold is checked.

    With quick time-outs a busy machine may end an upload before the fault comes about: everything
    has to hold then, too, and it is tried again, with patience, at last with the control's own.
    """
    old, new = sums(made / "old"), sums(made / "new")
    for keys in (quick, quick, patient, place.slow):
        place.control.order("reset")
        place.control.order("load", files=texts(made / "old"))
        place.configure(patience=0.01, **keys)
        place.control.order("fault", kind=kind, seconds=0.25, **STEPS[step])
        done = attempt(lambda: place.upload(made / "new"))
        happened = place.truth()["happened"]
        place.control.order("wake")
        came = check_all(place, done, old, new)
        if happened:
            assert happened == [[kind, STEPS[step]["at"]]]
            return came
    raise AssertionError("the fault did not come about")


def attempt(do: Callable[[], Any]) -> tuple[Any, str]:
    """What an upload hands back, or the message with which it was refused."""
    try:
        return do(), ""
    except AbbeError as error:
        return None, str(error)


def active_now(place: Place, old: Sums, new: Sums) -> str:
    """Which set the control itself says it has; anything but these two is a failure."""
    active = place.truth()["active"]
    assert active in (old, new), f"a mixture is active: {sorted(active)}"
    return "old" if active == old else "new"


def check_reported(place: Place, outcome: UploadOutcome, old: Sums, new: Sums) -> None:
    """What Abbe says agrees with what the control has."""
    truth, active = place.truth(), active_now(place, old, new)
    words = "\n".join(outcome.lines())
    entries = place.entries()
    if outcome.active == "unknown":
        assert "NOT known" in words
    else:
        assert outcome.active == active, words
        assert f"the {active} table ({getattr(outcome, active).sha256[:12]}) is active" in words
    if outcome.active == "old":
        assert truth["staged"] == 0
    assert not outcome.done or active == "new"
    ended = entries[-1]["step"] == "end"
    assert ended == (not outcome.open)
    if ended:
        assert entries[-1]["active"] == active


def check_all(place: Place, done: tuple[Any, str], old: Sums, new: Sums) -> str:
    """Either table whole and told truly; what is left open is recovered. Tells what came of it."""
    result, refused = done
    if result is None:
        assert active_now(place, old, new) == "old", refused
        assert place.truth()["staged"] == 0
        return "refused"
    outcome = result.outcome
    assert outcome is not None
    assert result.ok == outcome.done
    check_reported(place, outcome, old, new)
    if not outcome.open:
        return "new" if outcome.done else "old"
    place.control.order("clear")
    place.control.order("wake")
    place.configure(60.0, **place.slow)
    recovered = place.recover()
    assert recovered is not None
    assert not recovered.open, recovered.lines()
    check_reported(place, recovered, old, new)
    assert place.recover() is None
    return f"open, then {recovered.active}"
