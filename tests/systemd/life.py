"""Proofs of a service's life: ready, watched, led over, started anew, ended by its ramp."""

from __future__ import annotations

import re

from tests.support.systemd.machine import PATIENCE
from tests.support.systemd.stage import RATE, Stage

ONE, OTHER = "mill-7", "mill-8"


def ready(stage: Stage) -> str:
    """enable --now comes back when the cycle runs; the state is said in words"""
    since = stage.mark(ONE)
    stage.page("sudo systemctl enable --now abbe@mill-7")
    shown = stage.page("systemctl status abbe@mill-7")
    assert "active (running)" in shown
    assert stage.show(ONE, "Type") == "notify"
    seen = stage.until_full(ONE, since)
    words = stage.machine.until(
        f"systemctl show abbe@{ONE} -p StatusText --value", lambda out: "corrected in full" in out
    )
    assert re.match(r"corrected in full; 3 axes; cycle [0-9.]+ ms", words), words
    return f"{words.strip()}; the controller has {seen.size:.1f} µm"


def asked(stage: Stage) -> str:
    """abbe status, as root and as a person in the group"""
    words = stage.page("sudo abbe status /etc/abbe/mill-7/config.toml")
    assert "corrected in full" in words, words
    command = "runuser -u quality -- abbe status"
    _, before = stage.machine.run(command)
    assert "corrected in full" not in before, before
    stage.page("sudo usermod --append --groups abbe quality")
    after = stage.machine.do(command)
    assert "corrected in full" in after, after
    return "corrected in full; a user outside the group sees nothing"


def confined(stage: Stage) -> str:
    """systemd-analyze security 2.0 or better; the process has no right and no W+X memory"""
    out = stage.page("systemd-analyze security abbe@mill-7")
    found = re.search(r"exposure level for \S+: ([0-9.]+)", out)
    assert found, out
    assert float(found[1]) <= 2.0, found[0]
    assert stage.show(ONE, "MemoryDenyWriteExecute") == "yes"
    pid = stage.show(ONE, "MainPID")
    said = stage.machine.do(f"cat /proc/{pid}/status")
    fields = dict(line.split(":\t", 1) for line in said.splitlines() if ":\t" in line)
    assert fields["CapEff"].strip("0 ") == "", fields["CapEff"]
    assert fields["NoNewPrivs"] == "1"
    assert fields["Seccomp"] == "2"
    user = stage.machine.do("id -u abbe")
    assert user != "0"
    assert fields["Uid"].split() == [user] * 4
    status, out = stage.machine.run(f"grep -c -E '^[^ ]+ .w.?x|^[^ ]+ .wx' /proc/{pid}/maps")
    assert (status, out.strip()) == (1, "0"), out
    stage.machine.do("systemd-analyze --man=no verify /usr/lib/systemd/system/abbe@.service")
    groups = stage.machine.do(f"grep ^Groups: /proc/{pid}/status")
    assert stage.machine.do("getent group dialout | cut -d: -f3") in groups.split()
    return f"exposure {found[1]}; no capability, no W+X page, user abbe, group dialout"


def reload(stage: Stage) -> str:
    """reload leads another model in; a bad file changes nothing; the process stays"""
    pid = stage.show(ONE, "MainPID")
    before = stage.until_full(ONE)
    model = stage.machine.do("cat /etc/abbe/mill-7/model.toml")
    found = re.search(r'kind = "squareness"[\s\S]*?value = ([-+.0-9e]+)', model)
    assert found
    other = model[: found.start(1)] + repr(float(found[1]) + 1e-4) + model[found.end(1) :]
    stage.machine.put("/root/fitted.toml", other + "\n")
    since = stage.mark(ONE)
    stage.page("sudo cp fitted.toml /etc/abbe/mill-7/model.toml")
    stage.page("sudo systemctl reload abbe@mill-7")

    def moved(look: object) -> bool:
        correction = getattr(look, "correction", None) or before.correction
        return max(abs(a - b) for a, b in zip(correction, before.correction, strict=True)) > 5.0  # type: ignore[arg-type]

    after = stage.controllers[ONE].until(moved, PATIENCE, since)
    assert all(look.status & 1 for look in stage.controllers[ONE].seen[since:])
    stage.machine.do("echo 'rubbish = ' >> /etc/abbe/mill-7/config.toml")
    stage.machine.run(f"systemctl reload abbe@{ONE}")
    stage.machine.until(
        f"journalctl -u abbe@{ONE} -b --no-pager -o cat", lambda out: "going on with what" in out
    )
    stage.until_full(ONE)
    stage.machine.do("sed -i '$d' /etc/abbe/mill-7/config.toml")
    stage.machine.put("/root/fitted.toml", model + "\n")
    stage.page("sudo cp fitted.toml /etc/abbe/mill-7/model.toml")
    stage.page("sudo systemctl reload abbe@mill-7")
    assert stage.show(ONE, "MainPID") == pid
    assert stage.show(ONE, "NRestarts") == "0"
    stage.until_full(ONE)
    return f"{before.size:.1f} → {after.size:.1f} µm and on; same process, RUNNING all the time"


def frozen(stage: Stage) -> str:
    """a frozen process is ended by the watchdog and started anew"""
    stage.until_full(ONE)
    pid = stage.show(ONE, "MainPID")
    stage.machine.do(f"kill -STOP {pid}")
    beat = stage.controllers[ONE].seen[-1].heartbeat
    took = stage.until_restarted(ONE, pid)
    journal = stage.journal(ONE)
    assert "Watchdog timeout" in journal, journal[-2000:]
    since = stage.mark(ONE)
    stage.until_full(ONE, since)
    still = sum(look.heartbeat == beat for look in stage.controllers[ONE].seen)
    return f"watchdog; another process after {took} s; the heartbeat stood for {still} looks"


def killed(stage: Stage) -> str:
    """a killed process is started anew, and corrects again"""
    stage.until_full(ONE)
    pid = stage.show(ONE, "MainPID")
    restarts = int(stage.show(ONE, "NRestarts"))
    stage.machine.do(f"kill -KILL {pid}")
    took = stage.until_restarted(ONE, pid)
    since = stage.mark(ONE)
    stage.until_full(ONE, since)
    assert int(stage.show(ONE, "NRestarts")) == restarts + 1
    return f"another process after {took} s, corrected in full again"


def stopped(stage: Stage) -> str:
    """stop leads the correction to zero and tells the controller"""
    stage.until_full(ONE)
    since = stage.mark(ONE)
    stage.page("sudo systemctl stop abbe@mill-7")
    assert stage.show(ONE, "Result") == "success"
    seen = stage.controllers[ONE].ramp(since, RATE)
    stage.page("sudo systemctl start abbe@mill-7")
    stage.until_full(ONE)
    return seen


def two(stage: Stage) -> str:
    """two machines on one computer; a third service on a controller that is held is refused"""
    stage.page("sudo abbe service install mill-8/config.toml --name mill-8 --start")
    listed = stage.page("systemctl list-units 'abbe@*'")
    assert "abbe@mill-7.service" in listed
    assert "abbe@mill-8.service" in listed
    sizes = [stage.until_full(name).size for name in (ONE, OTHER)]
    stage.machine.do("abbe service install /root/mill-8/config.toml --name thief")
    since = stage.mark(OTHER)
    status, _ = stage.machine.run("systemctl start abbe@thief")
    assert status != 0
    words = stage.journal("thief")
    assert "mill-8" in words, words
    stage.machine.do("systemctl stop abbe@thief; abbe service remove thief; rm -r /etc/abbe/thief")
    assert all(look.status & 1 for look in stage.controllers[OTHER].seen[since:])
    held = next(line for line in words.splitlines() if "mill-8" in line)
    return f"{sizes[0]:.1f} and {sizes[1]:.1f} µm; {held[:110]}"


def rebooted(stage: Stage) -> str:
    """a reboot ends both by their ramps; both come back with the computer"""
    for name in (ONE, OTHER):
        stage.until_full(name)
    since = {name: stage.mark(name) for name in (ONE, OTHER)}
    stage.unplug_and_boot()
    ramps = [stage.controllers[name].ramp(since[name], RATE) for name in (ONE, OTHER)]
    for name in (ONE, OTHER):
        stage.until_full(name)
    return f"{ramps[0]} | {ramps[1]}; both in full again"


def told(stage: Stage) -> str:
    """the journal by level and as JSON; the clock"""
    stage.page("journalctl -u abbe@mill-7 -p warning --since today")
    out = stage.page("journalctl -u abbe@mill-7 -o json")
    assert '"PART":"abbe.' in out
    stage.page("journalctl --disk-usage")
    clock = stage.page("timedatectl")
    assert "synchronized" in clock
    count = sum('"PART":"abbe.' in line for line in out.splitlines())
    return f"{count} events of Abbe's with fields"
