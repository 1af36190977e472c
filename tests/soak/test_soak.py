"""Three minutes of soak: a supervised run, every fault of wire and computer, no promise broken."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from abbe.drivers.simulated.soak.__main__ import main
from abbe.drivers.simulated.soak.faults import COMPUTER_FAULTS
from abbe.drivers.simulated.soak.soak import Soak
from abbe.drivers.simulated.soak.supervisor import clock_library
from abbe.drivers.simulated.torment.judge.evidence import ShownPicture, Taken
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.machine import REFERENCED

DOC = (Path(__file__).parents[2] / "docs" / "soak.md").read_text(encoding="utf-8")


def test_a_relative_folder_is_where_it_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Abbe runs in that folder, so that its path has to be whole."""

    class AskedFor(Exception):  # noqa: N818 - no error
        pass

    def soak(*, folder: Path, **_: object) -> Soak:
        raise AskedFor(folder)

    monkeypatch.setattr("abbe.drivers.simulated.soak.__main__.Soak", soak)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AskedFor) as asked:
        main(["--folder", "out"])
    assert asked.value.args == (tmp_path / "out",)


@pytest.mark.thorough
@pytest.mark.integration
@pytest.mark.timeout(900)
def test_no_promise_is_broken_in_three_minutes(tmp_path: Path) -> None:
    assert clock_library() is not None, "Debian's libfaketime is missing"
    outcome = Soak(seed=1, seconds=180.0, folder=tmp_path).run()
    journal = (tmp_path / "abbe.log").read_text(encoding="utf-8", errors="replace")
    assert not outcome.violations, "\n".join([*outcome.lines, journal[-3000:]])
    assert "Traceback" not in journal
    tally = outcome.tally
    assert tally.messages - tally.not_judged > 1000, f"too little was judged: {tally}"
    assert tally.compensating > 100
    assert set(COMPUTER_FAULTS) <= set(outcome.faults)
    assert outcome.restarts.get("killed"), f"{outcome.restarts}"
    assert outcome.answers > 500
    assert not outcome.http.wrong
    assert set(outcome.http.answers) == {"health", "metrics", "api", "page", "cycles"}
    assert outcome.http.rubbish > 10
    life = outcome.memory.longest
    settled = next(megabytes for age, megabytes in life if age >= life[-1][0] / 2)
    assert life[-1][1] - settled < 6.0, f"{settled:.1f} MB became {life[-1][1]:.1f} MB"


def test_what_a_killed_life_wrote_last_is_no_step_of_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A message can lie in the socket when the death is seen, and be read after it."""
    soak = Soak(seed=1, seconds=10.0, folder=tmp_path)
    monkeypatch.setattr(soak._abbe, "start", lambda: None)
    monkeypatch.setattr(type(soak._abbe), "pid", os.getpid())
    checker = soak._checker
    for life, correction in enumerate((0.016, 0.001)):
        soak._start()
        now = 10.0 + 0.2 * life
        place = (300.0, 200.0, -100.0)
        checker.sent(ShownPicture(life, now, place, 1, REFERENCED, 21.0, sent=now))
        checker.taken(Taken(Moment(now, now), {"X": place[0] + correction}))
    soak._clients.close()
    soak._abbe.close()
    assert soak._checker.violations == []


@pytest.mark.parametrize(("waited", "broken"), [(3.6, False), (2.0, True), (0.1, True)])
def test_who_had_no_processor_did_not_hang(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waited: float, broken: bool
) -> None:
    """It is started again, as by systemd, and told; a promise is broken only by who had one."""
    soak = Soak(seed=1, seconds=10.0, folder=tmp_path)
    monkeypatch.setattr(soak._abbe, "look", lambda _: "watchdog")
    monkeypatch.setattr(soak._waits, "between", lambda *_: waited)
    soak._keep_alive(100.0)
    soak._clients.close()
    soak._abbe.close()
    assert bool(soak._checker.violations) == broken
    assert soak._abbe.restarts == {"watchdog" if broken else "no processor": 1}
    assert f"it waited {waited} s of the last 4 s for a processor" in soak._findings.lines[0]


def test_the_page_names_every_fault() -> None:
    for kind, fault in COMPUTER_FAULTS.items():
        assert f"| `{kind}` | {fault.text} |" in DOC
