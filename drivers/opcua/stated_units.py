"""What unit an OPC UA server states for a variable, held against the one that is configured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from asyncua import ua

from abbe.drivers.link import LinkConfigError, LinkProtocolError
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.session import OpcuaSession
from abbe.drivers.opcua.units import contradicts, stated


async def check_units(
    link: str, config: OpcuaConfig, session: OpcuaSession, nodes: Mapping[str, ua.NodeId]
) -> None:
    """See that no variable of a link has another unit than is configured.

    Raises
    ------
    LinkConfigError
        When one has.
    """
    plain = {
        name: channel.unit
        for name, channel in config.channels.items()
        # scaled, the unit is that of what it becomes
        if channel.unit and (channel.scale, channel.offset) == (1.0, 0.0)
    }
    found = await _stated_by(session, [nodes[name] for name in plain])
    for (name, unit), said in zip(plain.items(), found, strict=True):
        if said is None:
            continue
        namespace = said.NamespaceUri or ""
        if contradicts(unit, said.UnitId, namespace):
            its = stated(said.UnitId, namespace, said.DisplayName.Text or "?")
            raise LinkConfigError(
                f"link {link}: channel {name}: unit {unit!r}, but the server states "
                f"{its!r} for {config.channels[name].node}",
                ("channels", name, "unit"),
            )


async def _stated_by(
    session: OpcuaSession, nodes: Sequence[ua.NodeId]
) -> list[ua.EUInformation | None]:
    """The engineering units that a server states for variables (Part 8); None: it does not."""
    request = ua.TranslateBrowsePathsToNodeIdsRequest()
    request.Parameters.BrowsePaths = [_to_units(node) for node in nodes]
    try:
        response: ua.TranslateBrowsePathsToNodeIdsResponse = await session.ask(
            request, ua.TranslateBrowsePathsToNodeIdsResponse
        )
    except LinkProtocolError:
        return [None] * len(nodes)
    paths = [
        result.Targets[0].TargetId if result.StatusCode.is_good() and result.Targets else None
        for result in response.Results or []
    ]
    asked = [path for path in paths if path is not None]
    found = iter((await session.read(asked)).values if asked else ())
    units = [None if path is None else _unit(next(found)) for path in paths]
    return units if len(units) == len(nodes) else [None] * len(nodes)


def _to_units(node: ua.NodeId) -> ua.BrowsePath:
    step = ua.RelativePathElement()
    step.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HasProperty)
    step.IsInverse = False
    step.IncludeSubtypes = True
    step.TargetName = ua.QualifiedName("EngineeringUnits", 0)
    path = ua.BrowsePath()
    path.StartingNode = node
    path.RelativePath.Elements = [step]
    return path


def _unit(found: ua.DataValue) -> ua.EUInformation | None:
    value = found.Value.Value if found.Value is not None else None
    return value if isinstance(value, ua.EUInformation) else None
