"""The configuration section of a store in a CANopen node; ``docs/upload.md`` is the user's page."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.stores.base import StoreConfig
from abbe.drivers.stores.canopen.objects import ObjectMap

NODE = "control"
"""What the node is called in its link's section."""


class CanopenStoreConfig(StoreConfig):
    """A CAN interface, a node on its bus, and its objects. Times are in s."""

    interface: str
    """As python-can calls it: ``socketcan``, ``slcan``, …"""
    channel: str | int
    """``can0``, ``/dev/ttyACM0``, …"""
    bitrate: Annotated[int, Field(ge=1000)] | None = None
    """bit/s; for socketcan the operating system's business."""
    options: dict[str, Any] = Field(default_factory=dict)
    """More for python-can, by its names."""
    node: Annotated[int, Field(ge=1, le=127)]
    """Node id."""
    timeout: Annotated[float, Field(gt=0, le=60)] = 1.0
    """For one SDO answer."""
    attempts: Annotated[int, Field(ge=1, le=20)] = 4
    """How often a read, or a transfer into the staging area, is tried."""
    reconnect_within: Annotated[float, Field(gt=0, le=600)] = 10.0
    """How long a node or an adapter that is gone is waited for."""
    command_timeout: Annotated[float, Field(gt=0, le=600)] = 20.0
    """For the controller to carry a command out."""
    objects: ObjectMap = ObjectMap()

    def link(self) -> CanopenConfig:
        """The same as a link's section."""
        section = {
            "interface": self.interface,
            "channel": self.channel,
            "options": self.options,
            "timeout": self.timeout,
            "reconnect_min": 0.1,
            "reconnect_max": 1.0,
            "quarantine_max": 1.0,
            "nodes": {NODE: {"id": self.node, "start": False, "emergency": "report"}},
        }
        if self.bitrate is not None:
            section["bitrate"] = self.bitrate
        return CanopenConfig.model_validate(section)
