"""Checks of the section ``[probing]``: its link moves a machine, its signal is read."""

from __future__ import annotations

from abbe.daemon.config.channels import Channels
from abbe.drivers.touch_probe import touch_probe_of


def check_probing(channels: Channels) -> None:
    """Refuse what cannot be touched by.

    Raises
    ------
    InputError
        Naming the key, what was found and what was expected.
    """
    section = channels.file.probing
    if section is None:
        return
    link = channels.links.get(section.link)
    if link is None or touch_probe_of(link) is None:
        able = [n for n, one in channels.links.items() if touch_probe_of(one) is not None]
        raise channels.source.error(
            "no link of that name" if link is None else "its driver moves no machine",
            ("probing", "link"),
            found=section.link,
            expected="one of "
            + (", ".join(able) or 'none: a link with driver = "ipp" or "linuxcnc"'),
        )
    name, signals = section.plate_temperature, channels.file.signals
    if name is not None and (name not in signals or signals[name].source is None):
        raise channels.source.error(
            "no signal of that name is read",
            ("probing", "plate_temperature"),
            found=name,
            expected="one of " + ", ".join(n for n, s in signals.items() if s.source is not None),
        )
