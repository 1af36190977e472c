"""Claims of each command: what it has to hold (`abbe.daemon.ownership.lock`) first."""

from __future__ import annotations

from collections.abc import Mapping

from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import split
from abbe.daemon.pipeline.reading.poll import by_link
from abbe.drivers.link import Link
from abbe.drivers.resources import readers_may_share
from abbe.drivers.stores.base import Store


def held_by_run(configuration: Configuration, links: Mapping[str, Link]) -> list[str]:
    """What a live run holds: what it writes to, and what it cannot share with anybody."""
    return [*held_by_watch(links), *_written_to(configuration, links)]


def held_by_watch(links: Mapping[str, Link]) -> list[str]:
    """What somebody holds who writes nothing: what cannot be shared."""
    return [r for link in links.values() for r in link.owns if not readers_may_share(r)]


def held_by_upload(configuration: Configuration, store: Store, *, writes: bool) -> list[str]:
    """What an upload holds.

    When it writes, also what a live run of this configuration writes to: other tables while a
    correction is written would act on top of it.
    """
    if not writes:
        return [resource for resource in store.owns if not readers_may_share(resource)]
    return [*store.owns, *_written_to(configuration, configuration.make_links())]


def _written_to(configuration: Configuration, links: Mapping[str, Link]) -> list[str]:
    """What the configuration's output writes to."""
    output = configuration.file.output
    channels = [a.target for a in output.axes.values()] + [e.target for e in output.echo]
    channels += output.plus_minus.values()
    others = (output.status, output.heartbeat, output.outside)
    everything = [split(c) for c in (*channels, *others) if c is not None]
    return [r for name, names in by_link(everything).items() for r in links[name].owns_for(names)]
