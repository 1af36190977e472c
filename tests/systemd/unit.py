"""Proofs of the unit's own rules, with another program in place of Abbe."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tests.support.systemd.stage import Stage

_PROGRAM = "/usr/local/lib/probe.py"
_MAPS = """\
import mmap
try:
    mmap.mmap(-1, 4096, prot=7)
except OSError as error:
    print('refused:', error)
else:
    print('given')
"""
_WORKS = """\
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: print('child was told', flush=True))
print('child works', flush=True)
sys.stdin.read()
time.sleep(1.0)
print('child is done', flush=True)
"""
_BEGINS = f"""\
import signal, subprocess, sys
child = subprocess.Popen([sys.executable, '-c', {_WORKS!r}], stdin=subprocess.PIPE)
signal.signal(signal.SIGTERM, lambda *_: print('parent was told', flush=True))
signal.pause()
child.communicate()
"""


def denied_memory(stage: Stage) -> str:
    """under the unit's own rules writable and executable memory is refused"""
    with _probe(stage, "oneshot", _MAPS) as name:
        out = _said(stage, name)
    assert "refused: [Errno" in out, out
    return next(line for line in out.splitlines() if "refused" in line)


def ended_alone(stage: Stage) -> str:
    """stop tells the correction's own process only: what that has begun comes to its end"""
    seen = {}
    # as the unit has it, and as systemd does where a unit says nothing: the proof can fail
    for mode in ("mixed", "control-group"):
        with _probe(stage, "exec", _BEGINS, mode) as name:
            assert stage.machine.do(f"systemctl show {name} -p KillMode --value") == mode
            stage.machine.until(
                f"journalctl -u {name} -b -o cat --no-pager", lambda out: "child works" in out
            )
            stage.machine.do(f"systemctl stop {name}")
            seen[mode] = _said(stage, name)
    for out in seen.values():
        assert "parent was told" in out, out
        assert "child is done" in out, out
    assert "child was told" not in seen["mixed"], seen["mixed"]
    assert "child was told" in seen["control-group"], seen["control-group"]
    return "what it began worked on after the stop, untold; by systemd's default it is told"


def _said(stage: Stage, name: str) -> str:
    return stage.machine.do(f"journalctl -u {name} -b -o cat --no-pager")


@contextmanager
def _probe(stage: Stage, kind: str, program: str, mode: str = "mixed") -> Iterator[str]:
    """Started, as the unit has it but for its type: the name of a service of a Python program."""
    name = f"probe@{kind}-{mode}"
    stage.machine.put(_PROGRAM, program)
    stage.machine.do(
        f"sed -e 's|^ExecStart=.*|ExecStart=/usr/lib/abbe/bin/python3 {_PROGRAM}|' "
        f"-e 's|^Type=.*|Type={kind}|' -e 's|^Restart=.*|Restart=no|' "
        f"-e 's|^WatchdogSec=.*||' -e 's|^KillMode=mixed$|KillMode={mode}|' "
        "/usr/lib/systemd/system/abbe@.service > /run/systemd/system/probe@.service"
    )
    stage.machine.do(f"systemctl daemon-reload && systemctl start {name}")
    try:
        yield name
    finally:
        stage.machine.do(
            f"systemctl stop {name}; rm -rf /run/systemd/system/probe@.service "
            f"/etc/abbe/{kind}-{mode} /var/lib/abbe/{kind}-{mode}; systemctl daemon-reload"
        )
