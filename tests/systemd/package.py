"""Proofs of the package's life: installed without a network, upgraded, rolled back, removed."""

from __future__ import annotations

from tests.support.systemd.package import LATER
from tests.support.systemd.page import NOT_HERE, commands
from tests.support.systemd.stage import RATE, Stage
from tests.systemd.life import ONE, OTHER

_KEPT = "find /etc/abbe /var/lib/abbe -type f -name '*.toml' | sort | xargs sha256sum"


def installed(stage: Stage) -> str:
    """apt installs the package without a network"""
    route = stage.machine.do("ip route")
    assert "default" not in route, route
    stage.page("sudo apt install ./abbe_0.1.0_amd64.deb")
    version = stage.page("abbe --version")
    user = stage.machine.do("getent passwd abbe")
    assert user.endswith("/nologin"), user
    # the machine's Debian leaves manuals away
    verified = "dpkg --audit; dpkg --verify abbe | grep -v /usr/share/man || true"
    leftover = stage.machine.do(verified)
    assert leftover == "", leftover
    return f"{version}; {user}"


def configured(stage: Stage) -> str:
    """abbe service install puts a machine's files in place, readable for the service only"""
    out = stage.page("sudo abbe service install mill-7/config.toml --name mill-7")
    assert "written: /etc/abbe/mill-7/config.toml" in out, out
    modes = stage.machine.do("stat -c '%U:%G %a %n' /etc/abbe/mill-7 /etc/abbe/mill-7/*")
    assert all(line.startswith("root:abbe ") for line in modes.splitlines()), modes
    assert all(line.split()[1].endswith("0") for line in modes.splitlines()), modes
    assert "dialout" in stage.machine.do("systemctl cat abbe@mill-7 | grep SupplementaryGroups")
    patience = stage.show(ONE, "TimeoutStartUSec")
    assert patience == "15min", "a drop-in of the user's own counts"
    return ", ".join(line.rsplit("/", 1)[-1] + " " + line.split()[1] for line in modes.splitlines())


def upgraded(stage: Stage) -> str:
    """an upgrade while both run: they go on, are led out and in, and run the new version"""
    return _changed(stage, "sudo apt install ./abbe_0.2.0_amd64.deb", LATER)


def rolled_back(stage: Stage) -> str:
    """back to the version before, the same way"""
    before = stage.machine.do("dpkg-deb -f /root/abbe_0.1.0_amd64.deb Version")
    return _changed(stage, "sudo apt install --allow-downgrades ./abbe_0.1.0_amd64.deb", before)


def _changed(stage: Stage, command: str, version: str) -> str:
    kept = stage.machine.do(_KEPT)
    pids = [stage.show(name, "MainPID") for name in (ONE, OTHER)]
    for name in (ONE, OTHER):
        stage.until_full(name)
    since = {name: stage.mark(name) for name in (ONE, OTHER)}
    out = stage.page(command)
    assert f"restarting abbe@{ONE}.service" in out, out
    ramps = [stage.controllers[name].ramp(since[name], RATE) for name in (ONE, OTHER)]
    assert stage.page("abbe --version") == f"abbe {version}"
    assert stage.machine.do(_KEPT) == kept
    for name, pid in zip((ONE, OTHER), pids, strict=True):
        assert stage.show(name, "MainPID") != pid
        stage.until_full(name)
        assert stage.status(name)["abbe"] == version
    return f"{ramps[0]} | {ramps[1]}; both run {version}; configurations as they were"


def backed_up(stage: Stage) -> str:
    """backup, loss, restore: the machine is corrected as before, its records are there"""
    stage.page("sudo systemctl stop abbe@mill-7")
    stage.page("sudo tar -C / -czf mill-7.tar.gz etc/abbe/mill-7 var/lib/abbe/mill-7")
    stage.page("sudo systemctl start abbe@mill-7")
    full = stage.until_full(ONE)
    stage.page(
        "sudo tar -C / -czf mill-7-running.tar.gz --exclude='*.sqlite*' "
        "etc/abbe/mill-7 var/lib/abbe/mill-7"
    )
    stage.machine.do("abbe service remove mill-7")
    stage.machine.do("rm -r /etc/abbe/mill-7 /var/lib/abbe/mill-7")
    stage.page("sudo tar -C / -xzf mill-7.tar.gz")
    since = stage.mark(ONE)
    stage.page("sudo abbe service install /etc/abbe/mill-7/config.toml --name mill-7 --start")
    again = stage.until_full(ONE, since)
    assert abs(again.size - full.size) < 1.0, (full, again)
    owner = stage.machine.do("stat -c %U:%G /var/lib/abbe/mill-7/records.sqlite")
    assert owner == "abbe:abbe", owner
    damaged = stage.machine.do("ls /var/lib/abbe/mill-7 | grep -c damaged || true")
    assert damaged == "0"
    return f"{full.size:.1f} µm before, {again.size:.1f} µm after; records taken on"


def one_removed(stage: Stage) -> str:
    """abbe service remove ends one machine by its ramp, the other one goes on"""
    for name in (ONE, OTHER):
        stage.until_full(name)
    since = {name: stage.mark(name) for name in (ONE, OTHER)}
    out = stage.page("sudo abbe service remove mill-8")
    assert "kept: /etc/abbe/mill-8" in out
    stage.machine.do("test -e /etc/abbe/mill-8/config.toml")
    assert all(look.status & 1 for look in stage.controllers[ONE].seen[since[ONE] :])
    return stage.controllers[OTHER].ramp(since[OTHER], RATE)


def removed(stage: Stage) -> str:
    """apt remove ends what runs by its ramp and keeps configurations and data"""
    kept = stage.machine.do(_KEPT)
    stage.until_full(ONE)
    since = stage.mark(ONE)
    out = stage.page("sudo apt remove abbe")
    assert "Ending abbe@mill-7.service" in out, out
    seen = stage.controllers[ONE].ramp(since, RATE)
    assert stage.machine.do(_KEPT) == kept
    assert stage.machine.run("test -e /usr/bin/abbe -o -e /usr/lib/abbe")[0] == 1
    assert stage.machine.do("pgrep -u abbe -c || true") == "0"
    return seen


def installed_again(stage: Stage) -> str:
    """installed again after its removal, the service is there again"""
    stage.page("sudo apt install ./abbe_0.1.0_amd64.deb")
    assert stage.machine.do("systemctl is-enabled abbe@mill-7") == "enabled"
    since = stage.mark(ONE)
    stage.page("sudo systemctl start abbe@mill-7")
    return f"enabled, and after its start {stage.until_full(ONE, since).size:.1f} µm"


def purged(stage: Stage) -> str:
    """purge ends what runs, names what it removes, and leaves nothing"""
    stage.until_full(ONE)
    since = stage.mark(ONE)
    out = stage.page("sudo apt purge abbe")
    stage.controllers[ONE].ramp(since, RATE)
    for folder in ("/etc/abbe/mill-7", "/etc/abbe/mill-8", "/var/lib/abbe/mill-7"):
        assert f"Removing {folder} (" in out, out
    left = stage.machine.do(
        "find / -xdev -path /root -prune -o -path /var/log -prune -o -name '*abbe*' -print "
        "| grep -v -e 90-patience -e 'abbe@mill-[78].service.d$' -e /var/lib/apt || true"
    )
    assert left == "", left
    named = [line for line in out.splitlines() if line.startswith("Removing /")]
    return f"{len(named)} places named, e.g. {named[0]}"


def page_carried_out(stage: Stage) -> str:
    """every command of docs/install.md that the machine can carry out was carried out"""
    missing = [c for c in commands() if c not in stage.typed and c not in NOT_HERE]
    assert missing == []
    unknown = sorted(set(NOT_HERE) - set(commands()))
    assert unknown == [], "named as not to be carried out, and not on the page"
    return f"{len(stage.typed)} carried out; not here: {len(NOT_HERE)}"
