"""The overview of a configuration: every channel, where it sits and what it becomes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from abbe.compcore.machine.conditions import unit_of
from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import WATCHED, split
from abbe.daemon.config.notes import notes
from abbe.drivers.link import Link
from abbe.drivers.transducers import AnyTransducerConfig

UM = 1e3
"""µm per mm."""


def overview(configuration: Configuration) -> dict[str, Any]:
    """The links, inputs, outputs, guard and model of a configuration, ready for JSON.

    Each input and output says `what` it is, its `channel`, `where` that sits, its `unit` on the
    wire, the `transducer`, and what unit it `becomes` (inputs) or is made `from` (outputs). `notes`
    are what somebody should have decided.
    """
    links = configuration.make_links(instruments=True)
    file, guard = configuration.file, configuration.file.guard
    model = configuration.model
    carrying = model.machine.structure.carrying
    most = dict(zip("XYZ", guard.vector, strict=True))
    return {
        "config": str(configuration.path),
        "model": {
            "file": str(configuration.model_path),
            "name": model.machine.name,
            "structure": str(model.machine.structure),
            "effects": len(model.terms),
            "fitted": sum(term.fitted for term in model.terms),
            "signals_needed": list(model.signals_needed()),
        },
        "links": {
            name: {"driver": setup.driver, "channels": len(links[name].channels)}
            for name, setup in configuration.links.items()
        },
        "inputs": list(_inputs(configuration, links)),
        "outputs": list(_outputs(configuration, links)),
        "cycle": {"period_s": file.cycle.period, "signals_every_s": file.cycle.signals_every},
        "guard": {
            "max_correction_um": {a: v * UM for a, v in most.items() if a in carrying},
            "max_norm_um": round(guard.norm * UM, 3),
            "max_rate_um_per_s": guard.max_rate * UM,
            **_turns(configuration),
            "stale_after_s": guard.stale_after,
            "signals_stale_after_s": guard.signals_stale_after,
            "hold_s": guard.hold,
            "ramp_s": guard.ramp,
        },
        **_published(configuration),
        "notes": notes(configuration),
    }


def _published(configuration: Configuration) -> dict[str, Any]:
    """Where the run is published; nothing where it is not."""
    found: dict[str, Any] = {}
    if (mqtt := configuration.mqtt) is not None:
        section = mqtt.section
        found["published"] = {"to": section.url, "below": mqtt.below, "every_s": section.every}
    if (fleet := configuration.fleet) is not None:
        found["uploaded"] = {
            "to": fleet.section.url,
            "site": fleet.section.site,
            "machine": fleet.machine,
            "every_s": fleet.section.every,
        }
    return found


def _turns(configuration: Configuration) -> dict[str, Any]:
    """What rotary axes may be turned by, degrees and degrees/s; nothing where none is."""
    guard, turning = configuration.file.guard, configuration.limits.turning
    if not turning:
        return {}
    return {
        "max_turn_deg": {axis: guard.turn(axis) for axis in turning},
        "max_turn_rate_deg_per_s": guard.max_turn_rate,
    }


def _inputs(configuration: Configuration, links: dict[str, Link]) -> Iterator[dict[str, Any]]:
    file, signals = configuration.file, configuration.model.machine.signals
    for name, axis in file.axes.items():
        yield _row(links, f"axis {name}", axis.source, axis.transducer) | {"becomes": unit_of(name)}
        if axis.direction is not None:
            yield _row(links, f"direction of {name}", axis.direction) | {"becomes": "1, −1, 0"}
    for name, signal in file.signals.items():
        if signal.source is None:
            yield _typed(name, signals[name].unit, signal.entered_for or 0.0)
            continue
        yield _row(links, f"signal {name}", signal.source, signal.transducer) | {
            "becomes": signals[name].unit
        }
    for name, channel in zip("xyz", file.tool.sources or (), strict=False):
        yield _row(links, f"tool offset {name}", channel) | {"becomes": "mm"}
    for name in WATCHED:
        if (channel := getattr(file.controller, name)) is not None:
            yield _row(links, f"controller's {name}", channel) | {"becomes": "watched"}
    for echo in file.output.echo:
        yield _row(links, "echoed", echo.source) | {"becomes": "written back"}
    for name, reference in file.reference.items():
        yield _row(links, f"reference {name}", reference.source, reference.transducer) | {
            "becomes": unit_of(name)
        }
    for name, point in file.checks.points.items():
        yield _row(links, f"check {name}, complete", point.trigger) | {"becomes": "watched"}
        for letter, channel in zip("XYZ", point.found or (), strict=False):
            yield _row(links, f"check {name}, found {letter}", channel) | {"becomes": "mm"}
        if point.value is not None:
            yield _row(links, f"check {name}", point.value) | {"becomes": "µm"}
    for name, instrument in file.instrument.items():
        for channel in instrument.sources:
            yield _row(links, f"instrument {name}", channel) | {"becomes": instrument.reads}
        if instrument.beam is not None:
            yield _row(links, f"beam of {name}", instrument.beam) | {"becomes": "watched"}


def _outputs(configuration: Configuration, links: dict[str, Link]) -> Iterator[dict[str, Any]]:
    output = configuration.file.output
    for name, axis in output.axes.items():
        yield _row(links, f"corrected {name}", axis.target, axis.transducer) | {
            "from": unit_of(name)
        }
    for echo in output.echo:
        yield _row(links, f"echo of {echo.source}", echo.target) | {"from": "as read"}
    for name in ("status", "heartbeat"):
        if (channel := getattr(output, name)) is not None:
            yield _row(links, f"Abbe's {name}", channel) | {"from": "Abbe"}
    for name, channel in output.plus_minus.items():
        unit = links[split(channel)[0]].info(split(channel)[1]).unit
        yield _row(links, f"± of {name}", channel) | {"from": unit}
    if output.outside is not None:
        yield _row(links, "never measured", output.outside) | {"from": "Abbe"}


def _typed(name: str, unit: str, seconds: float) -> dict[str, Any]:
    """A signal that a person types in."""
    return {
        "what": f"signal {name}",
        "channel": "typed in",
        "where": f"abbe enter, good for {seconds:g} s",
        "unit": unit,
        "transducer": None,
        "becomes": unit,
    }


def _row(
    links: dict[str, Link], what: str, channel: str, config: AnyTransducerConfig | None = None
) -> dict[str, Any]:
    link, name = split(channel)
    return {
        "what": what,
        "channel": channel,
        "where": links[link].channels[name],
        "unit": links[link].info(name).unit,
        "transducer": None if config is None else describe(config),
    }


def describe(config: AnyTransducerConfig) -> str:
    """A transducer in a line.

    >>> from abbe.drivers.transducers import EncoderConfig
    >>> describe(EncoderConfig(counts_per_mm=1000.0, direction=-1))
    'encoder counts_per_mm=1000 direction=-1'
    """
    words: list[str] = [config.type]
    for key, value in config.model_dump(exclude_defaults=True, exclude={"type"}).items():
        if isinstance(value, tuple | list):
            text = "…".join(f"{v:g}" if isinstance(v, float) else str(v) for v in value[:4])
        else:
            text = f"{value:g}" if isinstance(value, float) else str(value)
        words.append(f"{key}={text}")
    return " ".join(words)
