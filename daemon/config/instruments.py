"""Checks of the instruments that ``abbe measure`` reads: channels, units, what they stand for."""

from __future__ import annotations

from collections.abc import Mapping

from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.daemon.config.channels import Channels, Key, split
from abbe.daemon.config.sections.config_file import ConfigFile

LENGTHS: Mapping[str, float] = {"m": 1e3, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "nm": 1e-6}
"""Unit of a channel → mm."""
_ARCSEC = 4.84813681109536e-06
ANGLES: Mapping[str, float] = {
    "rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "µrad": 1e-6, "mm/m": 1e-3, "um/m": 1e-6, "µm/m": 1e-6,
    "deg": 3600.0 * _ARCSEC, "°": 3600.0 * _ARCSEC, "arcsec": _ARCSEC,
}  # fmt: skip
"""Unit of a channel → rad."""


def check_instruments(channels: Channels) -> None:
    """Refuse instruments that cannot be read, or that stand for none or for the same.

    Raises
    ------
    InputError
        Naming the key, what was found and what was expected.
    """
    taken: dict[str, str] = {}
    for name, section in channels.file.instrument.items():
        key: Key = ("instrument", name)
        for measured in section.measures or (name,):
            if measured not in INSTRUMENTS:
                raise channels.source.error(
                    "a plan has no such instrument",
                    (*key, "measures") if section.measures else key,
                    found=measured,
                    expected="measures = [..] of " + ", ".join(INSTRUMENTS),
                )
            if measured in taken:
                raise channels.source.error(
                    f"instrument {taken[measured]} stands for it already",
                    (*key, "measures") if section.measures else key,
                    found=measured,
                )
            taken[measured] = name
        units = set()
        for source in section.sources:
            channels.find(source, (*key, "source"))
            units.add(channels.info(source).unit)
        if section.beam is not None:
            channels.find(section.beam, (*key, "beam"))
        allowed = (*LENGTHS, *ANGLES) if section.reads == "error" else tuple(LENGTHS)
        for unit in units:
            if unit not in allowed:
                raise channels.source.error(
                    "its channel is " + (f"in {unit}" if unit else "of no stated unit"),
                    (*key, "source"),
                    found=", ".join(section.sources),
                    expected="a unit of the channel out of " + ", ".join(allowed),
                )
        if len(units) > 1:
            raise channels.source.error(
                "its channels are in several units",
                (*key, "source"),
                found=", ".join(sorted(units)),
                expected="one unit for all",
            )


def only_for_instruments(file: ConfigFile) -> frozenset[str]:
    """Links that carry nothing but instruments: only `abbe measure` opens them."""
    instruments = {
        split(channel)[0]
        for section in file.instrument.values()
        for channel in (*section.sources, *([section.beam] if section.beam else []))
    }
    channels = Channels(TomlSource(""), file, {})
    used = {split(channel)[0] for channel, _ in (*channels.read(), *channels.written())}
    return frozenset(instruments - used)
