"""Modbus exceptions: what a device, or a gateway in its place, answers when it cannot."""

from __future__ import annotations

from abbe.drivers.link import LinkError, LinkProtocolError, LinkTimeoutError

_MEANINGS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, not done yet",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not answer",
}
_GATEWAY_CODES = (10, 11)


class ModbusExceptionError(LinkProtocolError):
    """The device answered with a Modbus exception, e.g. illegal data address.

    Attributes
    ----------
    code
        The exception code (MODBUS Application Protocol V1.1b3, 7).
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class GatewayError(LinkTimeoutError):
    """A gateway answered in place of a unit that does not."""


def refusal(what: str, code: int) -> LinkError:
    """The error to raise for an exception code that was answered.

    >>> refusal("input 31 of unit 1", 2)
    ModbusExceptionError('input 31 of unit 1: exception 2, illegal data address')
    """
    text = f"{what}: exception {code}, {_MEANINGS.get(code, 'unknown')}"
    return GatewayError(text) if code in _GATEWAY_CODES else ModbusExceptionError(text, code)
