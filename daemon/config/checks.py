"""Cross checks of a configuration: every source exists, units agree, outputs can be written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.conditions import unit_of
from abbe.daemon.config.channels import WATCHED, Channels, Key, split
from abbe.daemon.config.configuration import Configuration
from abbe.daemon.config.instruments import check_instruments
from abbe.daemon.config.outputs import PER_MM, check_outputs
from abbe.daemon.config.paces import check_paces
from abbe.daemon.config.probing import check_probing
from abbe.daemon.config.sections.readings import SignalSection
from abbe.drivers.link import Link
from abbe.drivers.transducers import AnyTransducerConfig, make_transducer

_SPELLINGS = {"°C": "degC", "°": "deg", "Ω": "ohm", "Ohm": "ohm", "counts": "count"}
_ANY = "number"
"""Raw unit of a transducer that takes any number."""


def check(source: TomlSource, configuration: Configuration, links: Mapping[str, Link]) -> None:
    """Refuse what cannot work.

    Parameters
    ----------
    source
        The file, for the places of errors.
    configuration
        What was read from it.
    links
        Its links, made but not opened.

    Raises
    ------
    InputError
        The first thing that is wrong.
    """
    _Checks(source, configuration, links).all()


class _Checks:
    def __init__(
        self, source: TomlSource, configuration: Configuration, links: Mapping[str, Link]
    ) -> None:
        self.source = source
        self.file = configuration.file
        self.model = configuration.model
        self.links = links
        self.channels = Channels(source, configuration.file, links)
        self._channel = self.channels.find

    def all(self) -> None:
        self._axes()
        self._signals()
        self._reference()
        self._tool()
        self._controller()
        self._output_units()
        self._check_points()
        check_instruments(self.channels)
        check_probing(self.channels)
        check_outputs(self.channels, self.model.machine)
        check_paces(self.channels)

    def _axes(self) -> None:
        axes = self.model.machine.structure.axes
        for name, section in self.file.axes.items():
            key = ("axes", name)
            if name not in axes:
                raise self.source.error(
                    "the model's machine has no such axis",
                    key,
                    found=name,
                    expected="one of " + ", ".join(axes),
                )
            if section.datum and self.file.control is None:
                raise self.source.error(
                    "nobody could set its datum",
                    (*key, "datum"),
                    expected="a section [control] with its socket",
                )
            self._channel(section.source, (*key, "source"))
            self._units(section.source, section.transducer, unit_of(name), key)
            if section.direction is not None:
                self._channel(section.direction, (*key, "direction"))
        for name in axes:
            if name not in self.file.axes:
                raise self.source.error(
                    f"axis {name} of the model has no source",
                    ("axes", name),
                    expected=f"a section [axes.{name}] with its source",
                )

    def _signals(self) -> None:
        known = self.model.machine.signals
        for name, section in self.file.signals.items():
            key = ("signals", name)
            if name not in known:
                raise self.source.error(
                    "the model's machine has no such signal",
                    key,
                    found=name,
                    expected="one of " + (", ".join(known) or "none"),
                )
            if section.source is not None:
                self._channel(section.source, (*key, "source"))
                self._units(section.source, section.transducer, known[name].unit, key)
                self._minus(section, key)
            elif self.file.control is None:
                raise self.source.error(
                    "nobody could type it in",
                    (*key, "entered_for"),
                    expected="a section [control] with its socket",
                )
        for name in self.model.signals_needed():
            if name not in self.file.signals:
                users = [e.spec for e in self.model.effects if name in e.signals_needed()]
                raise self.source.error(
                    f"signal {name} has no source, and the model's effect '{users[0]}' needs it",
                    ("signals", name),
                    expected=f"a section [signals.{name}] with its source",
                )

    def _minus(self, section: SignalSection, key: Key) -> None:
        """A position is taken off only where both are of one question, in mm as they are read."""
        if section.minus is None:
            return
        axis = self.file.axes.get(section.minus)
        problem = expected = ""
        if axis is None:
            problem, expected = "no such axis", "one of " + ", ".join(self.file.axes)
        elif split(axis.source)[0] != split(section.source or "")[0]:
            problem, expected = (
                "on another link than the axis",
                "one link, which reads both at once",
            )
        elif axis.transducer is not None or axis.datum:
            problem, expected = "the axis is converted", "an axis that is read in mm as it is"
        if problem:
            raise self.source.error(problem, (*key, "minus"), found=section.minus,
                                    expected=expected)  # fmt: skip

    def _reference(self) -> None:
        for name, section in self.file.reference.items():
            key = ("reference", name)
            if name not in self.file.axes:
                raise self.source.error(
                    "no such axis", key, found=name, expected="one of " + ", ".join(self.file.axes)
                )
            self._channel(section.source, (*key, "source"))
            self._units(section.source, section.transducer, unit_of(name), key)

    def _tool(self) -> None:
        for i, channel in enumerate(self.file.tool.sources or ()):
            self._channel(channel, ("tool", "sources", i))
            self._units(channel, None, "mm", ("tool", "sources", i))

    def _controller(self) -> None:
        section = self.file.controller
        for name in WATCHED:
            channel = getattr(section, name)
            if channel is not None:
                self._channel(channel, ("controller", name))
        for name in ("require", "forbid"):
            if getattr(section, name) and section.status is None:
                raise self.source.error(
                    f"{name} needs to know where the status word is",
                    ("controller", name),
                    expected="a key 'status' in [controller]",
                )

    def _check_points(self) -> None:
        axes = self.model.machine.structure.axes
        for name, point in self.file.checks.points.items():
            key: Key = ("checks", "points", name)
            for i, channel in enumerate(point.found or ()):
                self._channel(channel, (*key, "found", i))
                self._units(channel, None, "mm", (*key, "found", i))
            if point.value is not None:
                self._channel(point.value, (*key, "value"))
                unit = self.channels.info(point.value).unit
                if unit not in PER_MM:
                    raise self.source.error(
                        f"channel {point.value} is "
                        + (f"in {unit}" if unit else "of no stated unit"),
                        (*key, "value"),
                        expected='unit = "um" or unit = "mm" of the channel',
                    )
            if point.reference is not None and (
                point.reference not in "XYZ" or point.reference not in self.file.reference
            ):
                known = [axis for axis in self.file.reference if axis in "XYZ"]
                raise self.source.error(
                    "nothing independent measures it",
                    (*key, "reference"),
                    found=point.reference,
                    expected="one of " + (", ".join(known) or f"[reference.{point.reference}]"),
                )
            if point.sd is None and not self.model.fit.get("rms"):
                raise self.source.error(
                    "how sure the reading is, is not given, and the model's fit does not say",
                    (*key, "sd"),
                    expected="sd = .. (µm, standard uncertainty)",
                )
            for axis in point.at:
                if axis not in axes:
                    raise self.source.error(
                        "the model's machine has no such axis",
                        (*key, "at", axis),
                        found=axis,
                        expected="one of " + ", ".join(axes),
                    )

    def _output_units(self) -> None:
        for name, section in self.file.output.axes.items():
            key: Key = ("output", "axes", name)
            if name not in self.file.axes:
                raise self.source.error(
                    "no such axis", key, found=name, expected="one of " + ", ".join(self.file.axes)
                )
            self._channel(section.target, (*key, "target"))
            self._units(section.target, section.transducer, unit_of(name), key)
        for channel, where in (*self.channels.written(), *self.channels.read()):
            self._channel(channel, where)

    def _units(
        self,
        channel: str,
        config: AnyTransducerConfig | None,
        wanted: str,
        key: Key,
    ) -> None:
        """The channel's unit is what the transducer takes, and what it gives is what is wanted."""
        link, name = split(channel)
        unit = self.links[link].info(name).unit
        fitting = ("rad", "deg") if wanted == "rad" else (_spelled(wanted),)
        if config is None:
            if _spelled(unit) not in fitting:
                raise self.source.error(
                    f"channel {channel} is "
                    + (f"in {unit}" if unit else "of no stated unit")
                    + f", and {' or '.join(fitting)} is needed",
                    key,
                    expected=f"a transducer, or unit = {fitting[-1]!r} of the channel",
                )
            return
        transducer = make_transducer(config)
        if _spelled(transducer.unit) not in fitting:
            raise self.source.error(
                f"the transducer is for {transducer.unit}, and {' or '.join(fitting)} is needed",
                (*key, "transducer"),
                found=config.type,
            )
        raw = transducer.raw_unit
        if unit and raw != _ANY and _spelled(unit) != _spelled(raw) and not _scales(config):
            raise self.source.error(
                f"the transducer takes {raw}, and channel {channel} is in {unit}",
                (*key, "transducer"),
                found=config.type,
                expected=f"a channel in {raw}",
            )


def _spelled(unit: str) -> str:
    return _SPELLINGS.get(unit, unit)


def _scales(config: Any) -> bool:
    """Whether the transducer brings the channel's unit to its own by a scale."""
    circuit = getattr(config, "circuit", config)
    return getattr(circuit, "scale", 1.0) != 1.0
