"""CAN frames as CANopen has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import can


def frame(can_id: int, data: bytes, *, remote: bool = False) -> can.Message:
    """A CAN frame with an 11-bit id."""
    import can

    return can.Message(
        arbitration_id=can_id, data=data, is_extended_id=False, is_remote_frame=remote
    )
