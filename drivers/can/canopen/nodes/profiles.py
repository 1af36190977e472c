"""Device profiles: encoders (CiA 406), measuring devices (CiA 404)."""

from __future__ import annotations

from abbe.drivers.can.canopen.config import CanopenChannelConfig
from abbe.drivers.can.canopen.process_data.pdo import Upload
from abbe.drivers.link import LinkProtocolError

_PROFILES = {
    "cia404": (404, "a measuring device (CiA 404)"),
    "cia406": (406, "an encoder (CiA 406)"),
}
_PHYSICAL_UNIT, _DECIMALS = 0x6131, 0x6132
_UNITS = {0x002D0000: "degC", 0x00280000: "ohm"}
"""Physical unit of a process value (CiA 303-2), those that matter here."""


def check_profile(channel: CanopenChannelConfig, device_type: int) -> None:
    """Refuse a node that is something else than the channel says.

    Raises
    ------
    LinkProtocolError
        Naming both.
    """
    if channel.profile is None:
        return
    number, what = _PROFILES[channel.profile]
    if device_type & 0xFFFF != number:
        raise LinkProtocolError(f"it is not {what}: its device type (1000h) is {device_type:08X}h")


def scale_of(channel: CanopenChannelConfig, upload: Upload) -> float:
    """By what a number of the device is to be multiplied: its decimals (CiA 404), else 1.

    Raises
    ------
    LinkProtocolError
        When the device states another unit than the channel.
    """
    if channel.profile != "cia404":
        return 1.0
    _, number = channel.object
    unit = int.from_bytes(upload(_PHYSICAL_UNIT, number), "little")
    stated = _UNITS.get(unit)
    if stated is not None and channel.unit not in ("", stated):
        raise LinkProtocolError(f"unit is {channel.unit!r}, the device measures in {stated}")
    if channel.number_type == "float32":
        return 1.0
    decimals: int = upload(_DECIMALS, number)[0]
    return 10.0**-decimals
