"""Bad DBC files: as a link reads them when a configuration is loaded."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

import abbe.drivers.simulated.can
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.file import MOST_BYTES
from abbe.drivers.can.dbc.link import DbcLink
from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, Content, faults, run

GOOD = Path(abbe.drivers.simulated.can.__file__).with_name("machine.dbc").read_bytes()
SECTION = {
    "interface": "udp_multicast",
    "channel": "239.74.163.2",
    "dbc": "bad.dbc",
    "channels": {
        "x": {"message": "POSITION", "signal": "position_x"},
        "T_left": {"message": "TEMPERATURES"},
        "correction_x": {"message": "CORRECTION", "writable": True},
        "supply": {"message": "DIAGNOSIS"},
    },
}


def link() -> None:
    """A link that is made and asked for its channels, not opened."""
    made = DbcLink("bench", DbcConfig.model_validate(SECTION))
    for name in made.channels:
        made.info(name)
        made.places(name)


def too_large(path: Path) -> None:
    """A file that is larger than any, and takes no room on the disk."""
    with path.open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)


def named() -> Iterator[Case]:
    """Faults by name."""
    for before, after, says in (
        (b"BO_ 513", b"BO_ " + b"9" * 5000, "bad.dbc"), (b"BO_ 513", b"BO_ -1", ""),
        (b"0|32@1-", b"0|0@1-", ""), (b"0|32@1-", b"0|3200@1-", ""),
        (b"0|32@1-", b"99999|32@1-", ""), (b"0|32@1-", b"0|999999999@1-", ""),
        (b"(0.001,0)", b"(0,0)", ""), (b"(0.001,0)", b"(1e308,0)", ""),
        (b"(0.001,0)", b"(nan,0)", ""), (b"(0.001,0)", b"(1e400,0)", ""),
        (b"[-2000000|2000000]", b"[2000000|-2000000]", ""),
        (b"[-2000000|2000000]", b"[1e400|-1e400]", ""),
        (b"POSITION: 8", b"POSITION: 0", ""), (b"POSITION: 8", b"POSITION: 999999999", ""),
        (b"BO_ 514 ", b"BO_ 513 ", "bad.dbc"), (b"position_y", b"position_x", ""),
        (b"T_left", b"T_right", "bad.dbc"), (b"TEMPERATURES", b"POSITION", "TEMPERATURES"),
        (b"BO_ 513 10;", b"BO_ 513 1e308;", ""), (b"BO_ 513 10;", b"BO_ 513 -5;", ""),
        (b"supply m0", b"supply m999999999999", ""),
        (b"page M", b"page m0", ""),
    ):  # fmt: skip
        assert before in GOOD, before
        bad = GOOD.replace(before, after, 1)
        title = f"{before[:12].decode()} is {after[:24].decode()!r}"
        yield Case(title, {"bad.dbc": bad}, link, (says,) if says else (), may_succeed=not says)
    whole: tuple[tuple[str, Content], ...] = (
        ("a folder", Path.mkdir),
        ("too large", too_large),
        ("nested brackets", b"BO_ " + b"(" * 100_000),
        ("a text without end", GOOD + b'CM_ "' + b"x" * 100_000),
        ("many messages", GOOD + b"BO_ 1 M: 8 Encoders\n" * 3000),
    )
    for title, content in whole:
        may = title == "many messages"
        yield Case(title, {"bad.dbc": content}, link, () if may else ("bad.dbc",), may)


def mutated() -> Iterator[Case]:
    """The good file damaged by a machine."""
    for name, content in (
        *mutate.whole(GOOD), *mutate.harmless(GOOD), *mutate.flipped(GOOD, 15, 1),
        *mutate.cut(GOOD, 6, 2), *mutate.lines_mixed(GOOD, 9, 3),
        *mutate.numbers_replaced(GOOD, 20, 4),
    ):  # fmt: skip
        yield Case(name, {"bad.dbc": content}, link, may_succeed=True)


@pytest.mark.one_in(6)
@pytest.mark.parametrize("case", [*named(), *mutated()], ids=str)
def test_a_bad_dbc_file_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)


def test_the_good_one_is_read(tmp_path: Path) -> None:
    outcome = run(Case("", {"bad.dbc": GOOD}, partial(link)), tmp_path)
    assert outcome.status == 0, outcome.err
