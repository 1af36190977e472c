"""Which artefact the machine touches in some set-ups, and what its rows have besides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.errors import InputError
from abbe.compcore.files.gauge_file import read_gauge
from abbe.compcore.files.plate_file import read_plate
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.standing_sphere import StandardSphere, turning_axes
from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import split
from abbe.daemon.measure.rows import digest
from abbe.drivers.link import Link
from abbe.drivers.touch_probe import touch_probe_of

_KEYS = {
    "ball-plate": "plate",
    "gauge-block": "gauge",
    "step-gauge": "gauge",
    "sphere": "sphere",
}
"""Plan's instrument → the key of ``[probing]`` that names the artefact."""


@dataclass(frozen=True)
class ChosenArtefact:
    """What is touched.

    Attributes
    ----------
    touched
        The artefact.
    columns
        What its rows have besides: form deviation in µm, the gauge, its calibration.
    origin
        What the campaign's head keeps of it.
    turns
        Rotary axis → channel of the link by which it is turned.
    beside
        How far (mm) from a target the tip may be that touches there, besides `placing`.
    """

    touched: CalibratedPlate | CalibratedGauge | StandardSphere
    columns: tuple[str, ...]
    origin: Mapping[str, str] = field(default_factory=dict)
    turns: Mapping[str, str] = field(default_factory=dict)
    beside: float = 0.0


def artefact_of(
    configuration: Configuration, setups: Sequence[PlannedSetup], links: Mapping[str, Link]
) -> ChosenArtefact | None:
    """What the machine touches in all of these set-ups; None: it touches nothing in any of them.

    Raises
    ------
    InputError
        When it touches in some of them only, or different artefacts, or turns what nothing turns.
    """
    section = configuration.file.probing
    if section is None:
        return None
    # who reads errors of an artefact from the controller says so, and nothing is moved
    read = {k for n, s in configuration.file.instrument.items() for k in s.measures or (n,)}
    keys = {
        key for key, name in _KEYS.items() if key not in read and getattr(section, name) is not None
    }
    mine = [s for s in setups if s.instrument.key in keys and not _turned_plate(s)]
    if not mine:
        return None
    kind = mine[0].instrument.key
    alike = [s for s in mine if s.instrument.key == kind]
    if len(alike) < len(setups):
        raise InputError(
            f"the machine touches the {kind} by itself, and what else there is is measured "
            "otherwise: not in one go",
            file=configuration.path,
            field="probing",
            found=", ".join(s.name for s in setups),
            expected="--setup " + " --setup ".join(s.name for s in alike) + ", a file of its own",
        )
    if kind == "sphere":
        assert section.sphere is not None  # noqa: S101 - looked at above
        turns = _turns(configuration, alike, links)
        return ChosenArtefact(StandardSphere(section.sphere), ("form",), turns=turns)
    if kind in ("gauge-block", "step-gauge"):
        assert section.gauge is not None  # noqa: S101 - looked at above
        gauge = read_gauge(configuration.path.parent / section.gauge)
        known = digest([gauge.faces, gauge.places.tolist(), gauge.width, gauge.height])
        # targets are the faces, and the tip's middle stands beside them
        return ChosenArtefact(
            gauge,
            ("gauge", "gauge_sd") if gauge.sd else (),
            {"gauge_sha256": known},
            beside=0.5 * section.tip + section.off,
        )
    assert section.plate is not None  # noqa: S101 - looked at above
    plate = read_plate(configuration.path.parent / section.plate)
    known = digest([plate.points, plate.calibrated.tolist(), plate.diameter])
    columns = ("form", "gauge", "gauge_sd") if plate.sd else ("form",)
    return ChosenArtefact(plate, columns, {"plate_sha256": known})


def _turned_plate(setup: PlannedSetup) -> bool:
    """Whether rotary axes turn a ball plate: that is followed, not touched."""
    turning = [a for a, q in setup.targets.items() if is_rotary(a) and np.ptp(q) > 0.0]
    return setup.instrument.key == "ball-plate" and bool(turning)


def _turns(
    configuration: Configuration, setups: Sequence[PlannedSetup], links: Mapping[str, Link]
) -> dict[str, str]:
    """Rotary axis → channel, for all that the link turns.

    Raises
    ------
    InputError
        For an axis of some set-up that it does not.
    """
    section = configuration.file.probing
    assert section is not None  # noqa: S101 - looked at above
    probe = touch_probe_of(links[section.link])
    found = {}
    for axis, own in configuration.file.axes.items():
        link, channel = split(own.source)
        same = link == section.link and own.transducer is None
        if is_rotary(axis) and same and probe is not None and probe.turns(channel):
            found[axis] = channel
    for setup in setups:
        for axis in turning_axes(setup):
            if axis not in found:
                raise InputError(
                    f"set-up {setup.name} turns {axis}, and link {section.link} does not",
                    file=configuration.path,
                    field=f"axes.{axis}.source",
                    found=configuration.file.axes[axis].source,
                    expected=f"a channel of link {section.link} that shows a rotary table, in rad, "
                    "without a transducer",
                )
    return found
