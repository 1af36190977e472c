"""Emergency messages of CANopen nodes in words (CiA 301, 7.2.7.1)."""

from __future__ import annotations

_ABOUT = {
    0x10: "generic error",
    0x20: "current",
    0x21: "current, device input side",
    0x22: "current inside the device",
    0x23: "current, device output side",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "voltage inside the device",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "device temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x70: "additional modules",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific",
}
"""High byte of the error code → what it is about."""


def emergency_text(code: int, register: int, meaning: str) -> str:
    """An emergency for people; empty when it says that the error is over.

    Parameters
    ----------
    code
        The error code; 00xxh: error reset, or no error.
    register
        The error register (1001h).
    meaning
        What to say of a code that is not in the specification.

    >>> emergency_text(0x5530, 0x81, "")
    'emergency 5530h, device hardware; error register 81h'
    """
    if code >> 8 == 0:
        return ""
    about = _ABOUT.get(code >> 8) or _ABOUT.get(code >> 8 & 0xF0) or meaning
    return f"emergency {code:04X}h, {about}; error register {register:02X}h"
