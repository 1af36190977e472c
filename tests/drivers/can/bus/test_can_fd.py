"""CAN FD frames between two sockets: long ones, of both byte orders, with short and long ids."""

from __future__ import annotations

import asyncio
import struct
from pathlib import Path

import can
import pytest

from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from tests.support.drivers.can.links import FD_DBC, all_good, dbc_section, free_port
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

GROUP = "239.74.163.85"


async def test_can_fd_frames_are_read_and_sent(tmp_path: Path) -> None:
    """64 bytes, Motorola and Intel, short and long ids, between two sockets."""
    (tmp_path / "fd.dbc").write_text(FD_DBC, encoding="utf-8")
    options = {"port": free_port(), "hop_limit": 0, "fd": True}
    section = dbc_section(
        {
            "first": {"message": "ARRAY"},
            "last": {"message": "ARRAY"},
            "sent": {"message": "LONG", "writable": True},
        }
    ) | {
        "interface": "udp_multicast",
        "channel": GROUP,
        "options": options,
        "dbc": str(tmp_path / "fd.dbc"),
    }
    link = DbcLink("bench", DbcConfig.model_validate(section))
    with can.Bus(interface="udp_multicast", channel=GROUP, ignore_config=True, **options) as other:
        data = struct.pack("<l", -12345) + bytes(56) + struct.pack(">l", 7)

        async def send() -> None:
            while True:
                other.send(
                    can.Message(arbitration_id=5, data=data, is_extended_id=False, is_fd=True)
                )
                await asyncio.sleep(0.02)

        sending = asyncio.create_task(send())
        await link.open()
        try:
            samples = await all_good(link, ("first", "last"))
            assert [s.value for s in samples.values()] == [pytest.approx(-12.345), 3.5]
            got: list[can.Message] = []

            async def sent() -> bool:
                await link.write({"sent": -2.0})
                while (frame := other.recv(0)) is not None:
                    if frame.arbitration_id == 6:
                        got.append(frame)
                return bool(got)

            await until(sent)
            assert (got[0].is_fd, got[0].bitrate_switch, got[0].is_extended_id) == (True,) * 3
            assert bytes(got[0].data) == bytes(8) + struct.pack("<l", -2)
        finally:
            sending.cancel()
            await link.close()
