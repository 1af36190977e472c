"""Proofs of what the disk of the history may do, while the correction goes on."""

from __future__ import annotations

import itertools
import re
import time
from collections.abc import Sequence

from tests.support.systemd.stage import Stage
from tests.support.systemd.witness import Seen
from tests.systemd.life import ONE

_DATA = "/var/lib/abbe/mill-7"
_RECORDS = f"{_DATA}/records.sqlite"
_SLOW = 2000
"""Bytes a second that the slow disk takes: a tenth of what is recorded."""
_PROBE = 16384
"""Bytes."""
_LASTS = 40.0
"""s that each fault lasts at least: the writer tries again every 5 s."""
_FULL = 2
_MOST_STILL = 5.0
"""s that the heartbeat may stand still: the slow machine's cycle, and who looks."""


def slow_disk(stage: Stage) -> str:
    """the records' disk takes 2 kB/s: not one cycle waits for it, and what it took can be read"""
    machine = stage.machine
    stage.until_full(ONE)
    machine.do(f"systemctl stop abbe@{ONE}")
    # the configuration's journal is a file beside the records; systemd's own is elsewhere
    machine.do(f"sed -i '/^.journal.$/,/^file/d' /etc/abbe/{ONE}/config.toml")
    machine.do(
        f"mkdir -p /mnt/new && mount {machine.disk} /mnt/new && cp -a {_DATA}/. /mnt/new/ && "
        f"chown --reference={_DATA} /mnt/new && umount /mnt/new && mount {machine.disk} {_DATA}"
    )
    since = stage.mark(ONE)
    machine.do(f"systemctl start abbe@{ONE}")
    stage.until_full(ONE, since)
    before = _cycles(stage)
    machine.throttle(_SLOW)
    since, began = stage.mark(ONE), _now(stage)
    took = _probed(stage)
    time.sleep(_LASTS)
    seen = stage.controllers[ONE].seen[since:]
    machine.throttle(0)
    went = _went_on(seen)
    after = _cycles(stage)
    _until_rows_since(stage, _now(stage))
    rows = _rows(stage, began)
    assert rows > 0, "nothing of the time with a slow disk"
    missed = after["missed"] - before["missed"]
    slow = f"{_PROBE / 1e3:.0f} kB took {took:.0f} s"
    return f"{went}; {slow}; {missed:.0f} cycles missed; {rows} rows of that time; {_waits(stage)}"


def _probed(stage: Stage) -> float:
    """How long the disk takes for a little, past the memory, s: it is slow indeed."""
    began = time.monotonic()
    stage.machine.do(
        f"dd if=/dev/zero of={_DATA}/probe bs=4096 count={_PROBE // 4096} oflag=direct; "
        f"rm {_DATA}/probe"
    )
    took = time.monotonic() - began
    assert took > 0.5 * _PROBE / _SLOW, f"{_PROBE} bytes in {took:.1f} s"
    return took


def full_and_read_only(stage: Stage) -> str:
    """the disk is full, then read-only: said once; written on when it can be written again"""
    machine = stage.machine
    stage.until_full(ONE)
    _until_rows_since(stage, _now(stage))
    marked = _now(stage)
    since = stage.mark(ONE)
    machine.run(f"dd if=/dev/zero of={_DATA}/filled bs=64k; dd if=/dev/zero of={_DATA}/rest bs=1k")
    _until_said(stage, marked, "records cannot be written")
    time.sleep(_LASTS)
    machine.do(f"mount -o remount,ro {_DATA}")
    status, _ = machine.run(f"touch {_DATA}/probe")
    assert status != 0, "it can be written"
    time.sleep(_LASTS)
    said = _said(stage, marked, "records cannot be written")
    assert len(said) == 1, said
    machine.do(f"mount -o remount,rw {_DATA} && rm {_DATA}/filled {_DATA}/rest")
    again = _until_said(stage, marked, "records are written again")
    _until_rows_since(stage, _now(stage))
    went = _went_on(stage.controllers[ONE].seen[since:])
    return f"{went}; {said[0]}; {again}"


def damaged(stage: Stage) -> str:
    """a history that was damaged when Abbe was killed is put aside, a new one begun"""
    machine = stage.machine
    stage.until_full(ONE)
    _until_rows_since(stage, _now(stage))
    marked, since = _now(stage), stage.mark(ONE)
    machine.do(
        f"systemctl kill --signal=KILL abbe@{ONE}; "
        f"dd if=/dev/urandom of={_RECORDS} bs=4096 seek=1 count=20 conv=notrunc"
    )
    said = _until_said(stage, marked, "put aside as")
    stage.until_full(ONE, since)
    _until_rows_since(stage, _now(stage))
    aside = machine.do(f"ls {_DATA} | grep damaged")
    machine.do(f"systemctl stop abbe@{ONE} && umount {_DATA} && systemctl start abbe@{ONE}")
    stage.until_full(ONE)
    return f"{said}; {', '.join(aside.split())}; corrected in full and recorded again"


def _went_on(looks: Sequence[Seen]) -> str:
    """Corrected in full at every look, by a heart that beats; in words."""
    assert len(looks) > 20, len(looks)
    bad = [look for look in looks if not look.status & _FULL or look.size < 5.0]
    assert bad == [], bad[:3]
    at = [group[0].at for group in _beats(looks)]
    still = max((b - a for a, b in itertools.pairwise(at)), default=float("inf"))
    assert still < _MOST_STILL, f"the heartbeat stood still for {still:.1f} s"
    lasted = looks[-1].at - looks[0].at
    return f"in full for {lasted:.0f} s; heartbeat never still for more than {still:.2f} s"


def _beats(looks: Sequence[Seen]) -> list[list[Seen]]:
    return [list(group) for _, group in itertools.groupby(looks, lambda look: look.heartbeat)]


def _cycles(stage: Stage) -> dict[str, float]:
    found: dict[str, float] = stage.status(ONE)["cycle"]
    return found


def _waits(stage: Stage) -> str:
    """What the journal says of the disk, if anything."""
    said = [line for line in stage.journal(ONE).splitlines() if "records" in line]
    return said[-1] if said else "nothing in the journal"


def _now(stage: Stage) -> str:
    """The machine's time of day, s since 1970."""
    return stage.machine.do("date +%s.%N")


def _said(stage: Stage, since: str, what: str) -> list[str]:
    out = stage.machine.do(f"journalctl -u abbe@{ONE} --since @{since} --no-pager -o cat")
    return [line for line in out.splitlines() if what in line]


def _until_said(stage: Stage, since: str, what: str) -> str:
    command = f"journalctl -u abbe@{ONE} --since @{since} --no-pager -o cat"
    out = stage.machine.until(command, lambda text: what in text)
    return next(line for line in out.splitlines() if what in line)


def _rows(stage: Stage, since: str) -> int:
    """How many values the records have from a moment on."""
    query = f"SELECT count(*) FROM full WHERE time > {since}"
    program = (
        "import sqlite3; "
        f"c = sqlite3.connect('file:{_RECORDS}?mode=ro', uri=True); "
        f"print('rows', c.execute('{query}').fetchone()[0])"
    )
    _, out = stage.machine.run(f'/usr/lib/abbe/bin/python3 -c "{program}"')
    found = re.search(r"rows (\d+)", out)
    return int(found[1]) if found else 0


def _until_rows_since(stage: Stage, since: str) -> None:
    deadline = time.monotonic() + 120.0
    while not _rows(stage, since):
        assert time.monotonic() < deadline, "nothing is recorded"
        time.sleep(0.5)
