"""The set-up of a CANopen node: what is read from it and written to it before use."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from abbe.drivers.can.canopen.config import CanopenChannelConfig, CanopenConfig, NodeConfig
from abbe.drivers.can.canopen.nodes.profiles import check_profile, scale_of
from abbe.drivers.can.canopen.process_data.pdo import Pdo, choose_pdo, read_pdos
from abbe.drivers.can.canopen.sdo.adapter import DEVICE_TYPE, Network
from abbe.drivers.can.canopen.sdo.errors import SdoAbortError
from abbe.drivers.link import LinkDownError, LinkError

_PRODUCER_HEARTBEAT = 0x1017


@dataclass
class NodeSetup:
    """What was found out about a node.

    Attributes
    ----------
    pdos
        Channel → the PDO that carries its object, and what reads the number in its last frame.
    scales
        Channel → by what a number of the device is to be multiplied.
    refused
        Channel (or, for the whole node, an empty name) → why it cannot be had from this node.
    """

    pdos: dict[str, tuple[Pdo, Callable[[], float]]] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


def set_up(
    network: Network,
    section: NodeConfig,
    channels: Mapping[str, CanopenChannelConfig],
    sync: CanopenConfig,
    known: Collection[Pdo] = (),
) -> NodeSetup:
    """Set a node up and find out what it has; from a thread, takes some dozen requests.

    Parameters
    ----------
    network
        The bus.
    section
        The node's.
    channels
        Those of the node.
    sync
        The link's section: whether its SYNC is answered.
    known
        PDOs of which frames are taken in already; those that are still the same are kept.

    Raises
    ------
    LinkTimeoutError, LinkDownError
        When it does not answer. What it refuses makes its channels bad, not the node.
    """
    number = section.id

    def upload(index: int, subindex: int) -> bytes:
        return network.upload(number, index, subindex)

    found = NodeSetup()
    device_type = _device_type(network, number)
    if section.produce_heartbeat is not None:
        period = struct.pack("<H", round(section.produce_heartbeat * 1e3))
        try:
            network.download(number, _PRODUCER_HEARTBEAT, 0, period)
        except SdoAbortError as error:
            found.refused[""] = f"its heartbeat cannot be set: {error}"
    by_pdo = any(channel.by == "pdo" for channel in channels.values())
    there = [
        next((pdo for pdo in known if pdo.is_same(mapped)), mapped)
        for mapped in (read_pdos(upload) if by_pdo else [])
    ]
    for name, channel in channels.items():
        try:
            check_profile(channel, device_type)
            found.scales[name] = scale_of(channel, upload)
            if channel.by == "pdo":
                pdo = choose_pdo(
                    there,
                    channel.object,
                    synchronous=sync.sync is not None,
                    required=sync.sync == "read",
                )
                found.pdos[name] = pdo, pdo.reader(channel.object, channel.number_type)
        except (LinkDownError, TimeoutError):
            raise
        except LinkError as error:
            found.refused[name] = f"channel {name}: {error}"
    return found


def _device_type(network: Network, number: int) -> int:
    """Object 1000h; 0 (no profile) from a node that refuses even that."""
    try:
        return int.from_bytes(network.upload(number, DEVICE_TYPE, 0), "little")
    except SdoAbortError:
        return 0
