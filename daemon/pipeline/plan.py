"""The pipeline's plan: sources and targets, worked out once from the configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from abbe.compcore.machine.conditions import unit_of
from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import split, transducer_of
from abbe.daemon.pipeline.reading.controller_watch import Watch
from abbe.daemon.pipeline.reading.convert import ChannelSource
from abbe.daemon.pipeline.reading.datum import Datum
from abbe.daemon.pipeline.reading.expected import Expected, expected_of, written_axes
from abbe.daemon.pipeline.reading.poll import Channel, by_link
from abbe.daemon.pipeline.writing.write_back import AxisTarget
from abbe.drivers.link import Link
from abbe.drivers.transducers import AnyTransducerConfig, make_transducer


@dataclass(frozen=True)
class PipelinePlan:
    """Sources and targets with their transducers; fresh ones for every plan.

    Attributes
    ----------
    positions, directions, reference
        By axis, in the compensator's order; None where the configuration has none.
    signals
        In the configuration's order.
    tool
        Channels of the tool's offset; empty where it is fixed.
    watch
        The controller's heartbeat and status word.
    targets, echo, status, heartbeat
        What is written.
    datums
        Axis → the datum of its encoder, where that is not absolute.
    fast
        Link → channels that are read in every cycle.
    slow
        Link → channels of links that carry no positions, read at their own pace.
    expected
        What is believed of all that is read, and what the channels can hold.
    """

    positions: tuple[ChannelSource, ...]
    directions: tuple[Channel | None, ...]
    reference: tuple[ChannelSource | None, ...]
    signals: tuple[ChannelSource, ...]
    tool: tuple[Channel, ...]
    watch: Watch
    targets: tuple[AxisTarget, ...]
    echo: tuple[tuple[Channel, Channel], ...]
    status: Channel | None
    heartbeat: Channel | None
    datums: dict[str, Datum]
    fast: dict[str, tuple[str, ...]]
    slow: dict[str, tuple[str, ...]]
    expected: Expected


def make_plan(
    configuration: Configuration,
    axes: Sequence[str],
    links: Mapping[str, Link],
    *,
    with_directions: bool = True,
) -> PipelinePlan:
    """The plan of a configuration.

    Parameters
    ----------
    configuration
        Already checked.
    axes
        The compensator's order.
    links
        All links, made; need not be open.
    with_directions
        Whether the model asks in which direction an axis moved.
    """
    file = configuration.file

    def axis_source(axis: str, channel: str, config: AnyTransducerConfig | None) -> ChannelSource:
        where = split(channel)
        unit = links[where[0]].info(where[1]).unit if where[0] in links else ""
        return ChannelSource(axis, where, transducer_of(axis, unit, config))

    positions = tuple(axis_source(a, file.axes[a].source, file.axes[a].transducer) for a in axes)
    datums = {
        s.name: Datum(s.transducer, unit_of(s.name)) for s in positions if file.axes[s.name].datum
    }
    positions = tuple(replace(s, transducer=datums.get(s.name, s.transducer)) for s in positions)
    directions = tuple(_channel(file.axes[a].direction) if with_directions else None for a in axes)
    reference = tuple(
        axis_source(a, file.reference[a].source, file.reference[a].transducer)
        if a in file.reference
        else None
        for a in axes
    )
    signals = tuple(
        replace(
            _source(name, section.source, section.transducer),
            minus=None if section.minus is None else split(file.axes[section.minus].source),
        )
        for name, section in file.signals.items()
        if section.source is not None
    )
    tool = tuple(split(name) for name in file.tool.sources or ())
    controller = file.controller
    watch = Watch(
        stale_after=file.guard.stale_after,
        heartbeat=_channel(controller.heartbeat),
        within=controller.heartbeat_within,
        status=_channel(controller.status),
        require=controller.require,
        forbid=controller.forbid,
        sample=_channel(controller.sample),
        clock=_channel(controller.clock),
        tick=controller.clock_tick,
    )
    targets = tuple(
        AxisTarget(a, made.channel, made.transducer)
        for a in written_axes(configuration, axes)
        for section in (file.output.axes[a],)
        for made in (axis_source(a, section.target, section.transducer),)
    )
    echo = tuple((split(e.source), split(e.target)) for e in file.output.echo)
    with_positions = [s.channel for s in positions]
    with_positions += [c for c in (*directions, *watch.channels) if c is not None]
    with_positions += [s.channel for s in reference if s is not None]
    with_positions += [source for source, _ in echo]
    with_signals = [*(s.channel for s in signals), *tool]
    fast_links = {link for link, _ in with_positions}
    return PipelinePlan(
        positions,
        directions,
        reference,
        signals,
        tool,
        watch,
        targets,
        echo,
        _channel(file.output.status),
        _channel(file.output.heartbeat),
        datums,
        by_link([*with_positions, *(c for c in with_signals if c[0] in fast_links)]),
        by_link(c for c in with_signals if c[0] not in fast_links),
        expected_of(configuration, axes, links),
    )


def _source(name: str, channel: str, config: AnyTransducerConfig | None) -> ChannelSource:
    return ChannelSource(name, split(channel), None if config is None else make_transducer(config))


def _channel(name: str | None) -> Channel | None:
    return None if name is None else split(name)


def keep_together(plan: PipelinePlan, links: Mapping[str, Link]) -> None:
    """Have each link read the axes that it carries, and what is echoed with them, in one go.

    Raises
    ------
    LinkConfigError
        When positions and the number that says of which sample they are cannot be read together.
    """
    for link, members in by_link(s.channel for s in plan.positions).items():
        echoed = tuple(name for (where, name), _ in plan.echo if where == link)
        if link in links and len(members) + len(echoed) > 1:
            links[link].keep_together((*members, *echoed), one_sample=bool(echoed))
