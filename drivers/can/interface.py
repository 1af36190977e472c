"""The CAN interface of a link, and python-can's settings for it."""

from __future__ import annotations

import fcntl
import inspect
import logging
import os
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import Field

from abbe.drivers import resources
from abbe.drivers.can.slcan_status import Dialect
from abbe.drivers.link import LinkConfigError, LinkDownError
from abbe.drivers.quarantine import QuarantineConfig

if TYPE_CHECKING:
    import can

PROMPT = ("socketcan", "slcan", "udp_multicast", "virtual")
"""Interfaces that send without waiting for a device, or fail."""
STAMPED = ("socketcan", "udp_multicast")
"""Interfaces that are sockets: their frames carry the time at which the kernel took them in
(CLOCK_REALTIME), and python-can waits for them without using up the processor."""
LINUX_ERRORS = ("socketcan", "socketcand", "udp_multicast")
"""Interfaces whose error frames are Linux's; others flag a frame, each with numbers of its own."""
_OPTIONS_ARE_KNOWN = ("socketcan", "slcan", "udp_multicast", "virtual")
"""Interfaces whose options all stand in their signature; others take more than it says."""

# python-can logs what it raises as well; here an outage is logged once, by the link.
for _name in ("can", "canopen"):
    _logger = logging.getLogger(_name)
    if _logger.level == logging.NOTSET:
        _logger.setLevel(logging.CRITICAL)


class InterfaceConfig(QuarantineConfig):
    """A CAN interface. Times are in s."""

    interface: Annotated[str, Field(min_length=1)]
    """Any name that python-can knows: ``socketcan``, ``slcan``, ``pcan``, ``kvaser``, …"""
    channel: str | int
    """What the interface calls its buses: ``can0``, ``/dev/ttyACM0``, ``PCAN_USBBUS1``, 0, …"""
    bitrate: Annotated[int, Field(ge=1000)] | None = None
    """bit/s; for socketcan the operating system's business."""
    options: dict[str, Any] = Field(default_factory=dict)
    """More for python-can, by its names."""
    open_timeout: Annotated[float, Field(gt=0)] = 10.0
    """s for the interface to open."""
    adapter_status: Dialect | None = None
    """For ``slcan``: whose status flags the adapter has; none: it is not asked for them."""

    @property
    def where(self) -> str:
        """The bus, for people."""
        return f"{self.interface} {self.channel}"


def device_of(config: InterfaceConfig) -> str:
    """The bus as `abbe.drivers.link.WirePlace` names it, for all links on it."""
    named = resources.can(config.interface, config.channel)
    return named[0] if named else f"can {config.where}"


class Opened(NamedTuple):
    """An open interface.

    Attributes
    ----------
    bus
        python-can's.
    guard
        File descriptor that holds the lock of a serial adapter's port; −1 where there is none.
    """

    bus: can.BusABC
    guard: int


def check_interface(config: InterfaceConfig, *packages: str) -> None:
    """Refuse what can never work, before anything is opened.

    Parameters
    ----------
    config
        Which interface.
    packages
        What the link needs besides python-can.

    Raises
    ------
    LinkConfigError
        When a package is not installed, or python-can has no such interface, or that has no such
        option.
    """
    missing = [name for name in ("can", *packages) if not _is_installed(name)]
    if missing:
        shown = ", ".join({"can": "python-can"}.get(name, name) for name in missing)
        raise LinkConfigError(
            f"CAN links need packages that are not installed ({shown}): pip install 'abbe[can]'",
            ("driver",),
        )
    import can

    if config.interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise LinkConfigError(
            f"python-can has no interface {config.interface!r}; it has: {known}", ("interface",)
        )
    if config.adapter_status is not None and config.interface != "slcan":
        raise LinkConfigError(
            f"adapter_status is for slcan adapters, not for {config.interface}",
            ("adapter_status",),
        )
    if config.interface in _OPTIONS_ARE_KNOWN:
        _check_options(config, can.interface._get_class_for_interface(config.interface))


def _is_installed(package: str) -> bool:
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def open_interface(config: InterfaceConfig) -> Opened:
    """Open an interface, a serial adapter exclusively; may take seconds (call it in a thread).

    Raises
    ------
    LinkConfigError
        When it cannot be used on this computer, e.g. its maker's library is not installed.
    LinkDownError
        When it does not open.
    """
    import can

    settings: dict[str, Any] = {"channel": config.channel} | config.options
    if config.bitrate is not None:
        settings["bitrate"] = config.bitrate
    guard = _lock(config) if config.interface == "slcan" else -1
    try:
        # python-can would also take options from ~/can.conf and the environment.
        bus = can.Bus(interface=config.interface, ignore_config=True, **settings)
    except Exception as error:
        # each of python-can's interfaces raises its own
        if guard >= 0:
            os.close(guard)
        if isinstance(error, NotImplementedError | ImportError):
            raise LinkConfigError(
                f"interface {config.interface!r} cannot be used on this computer: {error}",
                ("interface",),
            ) from error
        raise LinkDownError(f"cannot open {config.where}: {error}") from error
    if guard >= 0:
        from abbe.drivers.can.slcan_port import BufferedPort

        adapter: Any = bus
        adapter.serialPortOrig = BufferedPort(adapter.serialPortOrig)
    return Opened(bus, guard)


def close_interface(opened: Opened) -> None:
    """Close an interface, whatever state it is in; may take a while (call it in a thread)."""
    bus = opened.bus
    try:
        bus.shutdown()
    except Exception:  # noqa: BLE001
        # slcan first tells its adapter, and leaves the port open when that is gone
        port = getattr(bus, "serialPortOrig", None)
        if port is not None:
            port.close()
    if opened.guard >= 0:
        os.close(opened.guard)


def _lock(config: InterfaceConfig) -> int:
    """Lock a serial adapter's port before python-can opens it and disturbs whoever has it.

    Raises
    ------
    LinkDownError
        When there is no such port, or somebody has it.
    """
    path = str(config.channel).split("@")[0]
    if "://" in path:
        return -1
    try:
        guard = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise LinkDownError(f"cannot open {config.where}: {error.strerror}") from error
    try:
        fcntl.flock(guard, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(guard)
        raise LinkDownError(
            f"cannot open {config.where}: locked: another program has it"
        ) from error
    return guard


def _check_options(config: InterfaceConfig, kind: type[can.BusABC]) -> None:
    """Refuse an option that the interface would silently ignore."""
    known = [
        name
        for name, parameter in inspect.signature(kind.__init__).parameters.items()
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
        and name not in ("self", "channel", "bitrate")
    ]
    strange = [name for name in config.options if name not in known]
    if strange:
        raise LinkConfigError(
            f"options of {config.interface}: there is no {strange[0]!r}; there are: "
            + ", ".join(known),
            ("options", strange[0]),
        )
