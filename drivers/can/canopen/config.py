"""The configuration section of a CANopen link: nodes, and objects of their dictionaries.

::

    [links.encoders]
    driver = "canopen"
    interface = "socketcan"
    channel = "can0"
    sync = "read"
    [links.encoders.nodes.x]
    id = 3
    heartbeat = 0.5                        # s
    [links.encoders.channels.x]
    node = "x"
    profile = "cia406"                     # the position value, object 6004h
    by = "pdo"
    unit = "counts"

``docs/can.md`` is the user's page on each key.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from abbe.drivers.can.canopen.objects import Type
from abbe.drivers.can.interface import InterfaceConfig
from abbe.drivers.scaled import ScaledNumber

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

POSITION = 0x6004
"""Position value of an encoder (CiA 406)."""
PROCESS_VALUE: dict[str, int] = {"float32": 0x6130, "int16": 0x7130, "int32": 0x9130}
"""Process value of an analogue input (CiA 404), by type."""


class NodeConfig(BaseModel):
    """One node. Times are in s."""

    model_config = _STRICT

    id: Annotated[int, Field(ge=1, le=127)]
    heartbeat: Annotated[float, Field(gt=0)] | None = None
    """Without a heartbeat for so long, the node counts as gone; none: not watched."""
    produce_heartbeat: Annotated[float, Field(ge=0.001, le=65.535)] | None = None
    """Have the node send one so often (its object 1017h); none: as the node is set."""
    start: bool = True
    """Bring it into the state operational (PDOs need it)."""
    emergency: Literal["bad", "report"] = "bad"
    """What an emergency of the node does: make its values bad, or only be reported."""


class CanopenChannelConfig(ScaledNumber):
    """One value: an object of a node."""

    model_config = _STRICT

    node: str
    profile: Literal["cia404", "cia406"] | None = None
    """``cia406``: the position value of an encoder. ``cia404``: the process value of an analogue
    input, with the decimals and unit that the device states."""
    input: Annotated[int, Field(ge=1, le=254)] | None = None
    """For ``cia404``: which, from 1."""
    index: Annotated[int, Field(ge=0x1000, le=0xFFFF)] | None = None
    """Without a profile: the object, e.g. 0x6004."""
    subindex: Annotated[int, Field(ge=0, le=255)] = 0
    type: Type | None = None
    """Required without a profile; with one, int32 if not given."""
    by: Literal["sdo", "pdo"] = "sdo"
    """Asked for one by one, or as the node sends it by itself or at each SYNC."""
    within: Annotated[float, Field(gt=0)] = 1.0
    """For ``pdo`` without ``sync = "read"``: s after which a value that did not come again counts
    as missing."""
    every: Annotated[float, Field(ge=0)] = 0.0
    """For ``sdo``: s between two; 0 asks at every call."""
    unit: str = ""
    """Unit of the value, for people."""
    writable: bool = False
    """Written by SDO."""
    verify: bool = False
    """Read back after each write and compare."""

    @property
    def number_type(self) -> Type:
        """The object's type."""
        return self.type or "int32"

    @property
    def object(self) -> tuple[int, int]:
        """Index and subindex."""
        if self.profile == "cia406":
            return POSITION, 0
        if self.profile == "cia404":
            return PROCESS_VALUE[self.number_type], self.input or 1
        return self.index or 0, self.subindex

    @model_validator(mode="after")
    def _consistent(self) -> CanopenChannelConfig:
        if (self.profile is None) == (self.index is None):
            raise ValueError("needs either profile or index")
        if self.profile is None and self.type is None:
            raise ValueError("type is missing: an object needs one, e.g. 'int32'")
        if (self.input is not None) != (self.profile == "cia404"):
            raise ValueError("input belongs to profile = 'cia404', which needs it")
        if self.profile == "cia404" and self.number_type not in PROCESS_VALUE:
            raise ValueError(f"type of a cia404 input is one of {', '.join(PROCESS_VALUE)}")
        if self.profile == "cia406" and self.number_type not in ("int32", "uint32"):
            raise ValueError("type of an encoder's position is int32 or uint32")
        if self.profile is not None and (self.writable or self.subindex):
            raise ValueError("writable and subindex: only with index")
        if self.verify and not self.writable:
            raise ValueError("verify is for channels with writable = true")
        if self.by == "pdo" and (self.writable or self.every):
            raise ValueError("writable and every: only for by = 'sdo'")
        if self.by == "sdo" and "within" in self.model_fields_set:
            raise ValueError("within: only for by = 'pdo'")
        return self


class CanopenConfig(InterfaceConfig):
    """A CAN bus with CANopen nodes. Times are in s."""

    model_config = _STRICT

    sync: Literal["read"] | Annotated[float, Field(gt=0)] | None = None
    """Send SYNC at each read and wait for the answers: all positions belong to one moment. Or a
    number: send it so often. None: somebody else does, or nobody."""
    late_reply_max: Annotated[float, Field(gt=0)] = 0.5
    """s after a SYNC beyond which its answer cannot come any more."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the bus; one more is turned away at once."""
    nodes: Annotated[dict[str, NodeConfig], Field(min_length=1)]
    channels: dict[str, CanopenChannelConfig] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _nodes_exist(self) -> CanopenConfig:
        taken: dict[int, str] = {}
        for name, node in self.nodes.items():
            if node.id in taken:
                raise ValueError(f"nodes {taken[node.id]!r} and {name!r} both have id {node.id}")
            taken[node.id] = name
        for name, channel in self.channels.items():
            if channel.node not in self.nodes:
                raise ValueError(
                    f"channel {name!r}: node {channel.node!r} is not defined; there are: "
                    + ", ".join(self.nodes)
                )
            if channel.by == "pdo" and not self.nodes[channel.node].start:
                raise ValueError(
                    f"channel {name!r}: by = 'pdo' needs node {channel.node!r} started"
                )
        return self
