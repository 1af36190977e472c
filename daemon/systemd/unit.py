"""Unit files: how systemd starts, watches, confines and ends ``abbe run`` for one machine.

The template ``abbe@.service`` is the same for all machines; a drop-in beside it opens what the one
machine's configuration names (addresses, serial devices, CAN) and nothing else. The set of
restrictions follows systemd.exec(5); ``systemd-analyze security`` judges it.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.daemon.config.folders import CONFIGURATIONS, STATE

TEMPLATE_NAME = "abbe@.service"
DROP_IN_NAME = "50-machine.conf"
PACKAGE_UNITS = Path("/usr/lib/systemd/system")
"""Where the Debian package has the template: one below ``/etc`` would hide it."""
PACKAGE_COMMAND = Path("/usr/lib/abbe/bin/abbe")
"""The command ``abbe`` of the Debian package's own environment."""
MADE = "# Made by Abbe"
"""How the units begin that Abbe may replace and take away."""
USER = "abbe"
"""System user that the service runs as."""
_MACHINE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.:-]{0,63}")
_SERIAL = ("ttyUSB", "ttyACM", "ttyS")
"""Classes of serial ports that the kernel numbers as they come."""
_WATCHDOG = 10.0
"""Least s after which a cycle that does not come round counts as hung."""
_PERIODS = 4.0
_STOP = 20.0
"""Least s that the ramp and the last word are given."""
_SPARE = 10.0

_TEMPLATE = """\
{made}; 'abbe service install' writes it anew. What is particular to one machine stands in
# abbe@MACHINE.service.d/, where you may add files of your own ('systemctl edit abbe@MACHINE').
[Unit]
Description=Abbe: live correction of %i
Documentation=man:systemd.service(5)
# up before it begins, and not taken down before it has ended: the ramp goes over it
After=network.target network-online.target time-sync.target
Wants=network-online.target
StartLimitIntervalSec=300
StartLimitBurst=10

[Service]
Type=notify
NotifyAccess=main
ExecStart={abbe} run {configurations}/%i/config.toml
ExecReload=/bin/kill -HUP $MAINPID
WatchdogSec=10s
WatchdogSignal=SIGABRT
TimeoutStartSec=60s
TimeoutStopSec=30s
# the correction's own process is told to end, and ends what it has begun
KillMode=mixed
Restart=on-failure
RestartSec=2s
# wrong usage is not mended by starting again
RestartPreventExitStatus=2
User={user}
Group={user}
SupplementaryGroups=dialout
StateDirectory=abbe/%i
RuntimeDirectory=abbe/%i
ConfigurationDirectory=abbe/%i
WorkingDirectory=/var/lib/abbe/%i
UMask=0027
Environment=PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1

# the cycle goes before what else runs on this computer
CPUWeight=1000
Nice=-5
IOSchedulingClass=best-effort
IOSchedulingPriority=2
OOMScoreAdjust=-500
LimitCORE=0

ProtectSystem=strict
ReadWritePaths=-/run/lock
ProtectHome=yes
PrivateTmp=yes
PrivateMounts=yes
PrivateDevices=no
DevicePolicy=closed
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
ProtectProc=invisible
ProcSubset=pid
NoNewPrivileges=yes
CapabilityBoundingSet=
AmbientCapabilities=
RestrictAddressFamilies=AF_UNIX
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
LockPersonality=yes
MemoryDenyWriteExecute=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged @resources
SystemCallErrorNumber=EPERM
RemoveIPC=yes
PrivateUsers=yes
IPAddressDeny=any

[Install]
WantedBy=multi-user.target
"""


@dataclass(frozen=True)
class Needs:
    """What one machine's service must be able to reach.

    Attributes
    ----------
    addresses
        Of the network, each an IP address with or without a prefix length.
    names
        Hosts of which only the name is known; they open the network, as no rule takes a name.
    devices
        As ``DeviceAllow`` takes them: a path of ``/dev``, or a class of serial ports, since a port
        that was pulled out and put back may have another number.
    can
        Whether a CAN interface of the kernel is used.
    folders
        That are written to, beside the service's own.
    clients
        Networks that may ask over HTTP, with ``localhost`` for this computer; empty: the network is
        not listened to.
    beside
        Whether there are processes beside the correction (HTTP, MQTT, the plant's store), which
        step back behind it.
    """

    addresses: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()
    can: bool = False
    folders: tuple[Path, ...] = ()
    clients: tuple[str, ...] = ()
    beside: bool = False

    @classmethod
    def of_resources(cls, resources: Iterable[str], folders: Iterable[Path] = ()) -> Needs:
        """Needs by what links and stores own (spelled as `abbe.drivers.resources` does).

        >>> Needs.of_resources(["tcp 10.0.0.5:502", "serial /dev/ttyUSB0"]).devices
        ('char-ttyUSB',)
        """
        addresses: set[str] = set()
        names: set[str] = set()
        devices: set[str] = set()
        can = False
        for resource in resources:
            kind, _, place = resource.partition(" ")
            if kind == "tcp":
                host = place.partition(" ")[0].rpartition(":")[0].strip("[]")
                (addresses if _is_address(host) else names).add(host)
            elif kind == "serial" and place.startswith("/dev/"):
                devices.add(_device_rule(place))
            elif kind == "can":
                interface, _, channel = place.partition(" ")
                if interface == "udp_multicast":
                    addresses.add(channel.partition(":")[0] if "." in channel else channel)
                elif channel.startswith("/dev/"):
                    devices.add(_device_rule(channel.partition("@")[0]))
                else:
                    can = True
            elif kind == "linuxcnc":
                addresses.add("127.0.0.1")
        return cls(
            tuple(sorted(addresses)),
            tuple(sorted(names)),
            tuple(sorted(devices)),
            can,
            tuple(sorted(set(folders))),
        )


def check_machine(name: str) -> str:
    """A machine's name as part of a unit's and a folder's.

    Raises
    ------
    InputError
        For a name that systemd or a file system would read as something else.
    """
    if not _MACHINE.fullmatch(name):
        raise InputError(
            "cannot name a service",
            field="--name",
            found=repr(name),
            expected="letters, digits, _ . : -, at most 64, beginning with a letter or digit",
        )
    return name


def template(abbe: Path, user: str = USER) -> str:
    """``abbe@.service``: how every machine's service is started, watched and confined.

    Parameters
    ----------
    abbe
        The command, absolute.
    user
        That it runs as.
    """
    return _TEMPLATE.format(
        made=MADE, abbe=_quoted(str(abbe)), configurations=CONFIGURATIONS, user=user
    )


def sysusers(user: str = USER) -> str:
    """``sysusers.d/abbe.conf``: the system user that services run as."""
    return f'u {user} - "Abbe" {STATE}\n'


def drop_in(needs: Needs, period: float = 0.0, longest_end: float = 0.0) -> str:
    """``abbe@MACHINE.service.d/50-machine.conf``: what this machine needs beyond the template.

    Parameters
    ----------
    needs
        What it reaches.
    period, longest_end
        Of the cycle, and of the ramp at the end, s: the manager has to have that much patience.
    """
    watchdog = max(_WATCHDOG, _PERIODS * period)
    lines = [
        f"{MADE} from the machine's configuration; 'abbe service install' writes it anew.",
        "[Service]",
        f"WatchdogSec={watchdog:g}s",
        f"TimeoutStopSec={max(_STOP, longest_end + _SPARE) + _SPARE:g}s",
    ]
    families = ["AF_UNIX"]
    if needs.addresses or needs.names or needs.clients:
        families += ["AF_INET", "AF_INET6"]
    if needs.can:
        families += ["AF_CAN", "AF_NETLINK"]
    lines += ["RestrictAddressFamilies=", f"RestrictAddressFamilies={' '.join(families)}"]
    if needs.names:
        lines += [
            f"# {', '.join(needs.names)}: only its name is known, so the whole network is open;",
            "# write addresses into the configuration to have it closed but for them",
            "IPAddressDeny=",
            "IPAddressAllow=any",
        ]
    elif "any" in needs.clients:
        lines += [
            "# whoever can reach its address may ask over HTTP: see 'clients' in [http]",
            "IPAddressDeny=",
            "IPAddressAllow=any",
        ]
    elif needs.addresses or needs.clients:
        lines.append(f"IPAddressAllow={' '.join((*needs.addresses, *needs.clients))}")
    if needs.beside:
        lines += [
            "# processes beside the correction (HTTP, MQTT, a store) step back behind it (nice)",
            "SystemCallFilter=setpriority",
        ]
    lines += [f"DeviceAllow={_quoted(device)} rw" for device in needs.devices]
    lines += [f"ReadWritePaths={_quoted(str(folder))}" for folder in needs.folders]
    return "\n".join(lines) + "\n"


def _device_rule(path: str) -> str:
    for name in _SERIAL:
        if re.fullmatch(rf"/dev/{name}\d+", path):
            return f"char-{name}"
    return path


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _quoted(text: str) -> str:
    """As one word of a unit file; ``%`` begins a specifier there."""
    text = text.replace("%", "%%")
    if re.fullmatch(r"[A-Za-z0-9_./:@%+=,-]+", text):
        return text
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
