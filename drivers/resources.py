"""Names of resources that only one process may own: one spelling for links and stores.

``tcp HOST:PORT``, ``tcp HOST:PORT unit N`` (of a Modbus gateway), ``serial REALPATH``,
``can INTERFACE CHANNEL``, ``linuxcnc hal`` (the LinuxCNC that runs on this computer),
``linuxcnc INI``. A link or store hands them out as its `owns`; who holds them is
`abbe.daemon.ownership.lock`'s business. Nothing is opened here, and no name is looked up in the
network.
"""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path

_THIS_COMPUTER = ("localhost", "ip6-localhost", "::1")
_LOOPBACK = "127.0.0.1"
_SERVER_PORTS = ("socket", "rfc2217")
"""Schemes of pyserial's that are a connection to a terminal server."""
_NO_UNIT = (0, 255)
_NOWHERE = ("loop", "virtual")
"""Ports and interfaces that exist within one process only."""


def tcp(host: str, port: int) -> str:
    """A TCP server.

    >>> tcp("LocalHost", 502)
    'tcp 127.0.0.1:502'
    >>> tcp("FE80::0001", 502)
    'tcp [fe80::1]:502'
    """
    name = host.strip("[]").rstrip(".").lower()
    if name in _THIS_COMPUTER:
        name = _LOOPBACK
    try:
        name = str(ipaddress.ip_address(name))
    except ValueError:
        return f"tcp {name}:{port}"
    return f"tcp [{name}]:{port}" if ":" in name else f"tcp {name}:{port}"


def modbus(host: str, port: int, unit: int) -> str:
    """One unit behind a Modbus server.

    Units 0 and 255 are whoever has no unit of his own (MODBUS Messaging on TCP/IP, V1.0b, 4.4.2),
    and who has none mostly answers to 1 too: these three are one.

    >>> modbus("10.0.0.5", 502, 255)
    'tcp 10.0.0.5:502 unit 1'
    """
    return f"{tcp(host, port)} unit {1 if unit in _NO_UNIT else unit}"


def serial(port: str) -> tuple[str, ...]:
    """A serial port: a path, or a URL of pyserial's; none where no other process can have it.

    >>> serial("socket://192.168.0.7:4001")
    ('tcp 192.168.0.7:4001',)
    >>> serial("serial:///dev/null")
    ('serial /dev/null',)
    """
    scheme, colon, rest = port.partition("://")
    if not colon or scheme == "serial":
        return (f"serial {_device(rest if colon else port)}",)
    if scheme in _NOWHERE:
        return ()
    if scheme in _SERVER_PORTS:
        host, _, number = rest.split("/")[0].split("?")[0].rpartition(":")
        if host and number.isdigit():
            return (tcp(host, int(number)),)
    return (f"serial {port}",)


def _device(path: str) -> str:
    """The device behind a path; of a link to a pseudo-terminal, the link.

    Numbers of pseudo-terminals (``/dev/pts/3``) are given to others as soon as they are free: who
    lost one and waits for its link to come back has nothing to do with the number any more.
    """
    real = os.path.realpath(path)
    if not real.startswith("/dev/pts/") or path.startswith("/dev/pts/"):
        return real
    link = Path(path).absolute()
    return str(link.parent.resolve() / link.name)


def can(interface: str, channel: str | int) -> tuple[str, ...]:
    """A CAN interface, as python-can calls it; a serial adapter is its serial port.

    >>> can("socketcan", "can0")
    ('can socketcan can0',)
    >>> can("slcan", "/dev/null@115200")
    ('serial /dev/null',)
    """
    if interface == "slcan":
        return serial(str(channel).partition("@")[0])
    return () if interface in _NOWHERE else (f"can {interface} {channel}",)


def linuxcnc(ini: str = "") -> str:
    """The LinuxCNC that runs on this computer (there is at most one), or one by its INI file.

    >>> linuxcnc()
    'linuxcnc hal'
    """
    return f"linuxcnc {os.path.realpath(ini)}" if ini else "linuxcnc hal"


def readers_may_share(resource: str) -> bool:
    """Whether a process that only reads need not own it: it disturbs neither owner nor readers.

    A server on TCP keeps its connections apart, LinuxCNC's pins may be read by anybody. On a serial
    line every question is in the way of another one's; a CAN interface may have to ask as well.
    """
    return resource.startswith(("tcp ", "linuxcnc "))


def on_this_computer(host: str) -> bool:
    """Whether a host, by name or address, is this computer, so that nobody is on the way to it."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
