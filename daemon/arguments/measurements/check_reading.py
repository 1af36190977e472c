"""A check that a person types: what it is called, where it stands, what was read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import POINT, Range
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.daemon.arguments.assignments import number, split_assignments
from abbe.daemon.arguments.moments import moment
from abbe.daemon.arguments.point_arguments import Given

Vec3 = tuple[float, float, float]

_OWN = ("found", "nominal", "value", "u", "kind", "sd", "when")
_ERROR = Range(-1e5, 1e5, "µm or µrad")
_SD = Range(1e-6, 1e5, "µm or µrad")
_USAGE = "NAME found=x,y,z (mm), or NAME value=.. u=X (µm)"


@dataclass(frozen=True)
class TypedReading:
    """One typed check.

    Attributes
    ----------
    name
        Of the artefact: its set-up.
    found, nominal
        Where a sphere or master point was found and where it is, axis positions, mm; `nominal` None
        where nobody knows.
    value, u
        Else an error (actual − indicated), µm or µrad, and its direction.
    rotation
        Whether it is one about u.
    sd
        Standard uncertainty, µm or µrad; None: what the model's fit left over.
    when
        s since 1970; None: now.
    given
        Positions, tool, signals.
    """

    name: str
    found: Vec3 | None
    nominal: Vec3 | None
    value: float
    u: Vec3
    rotation: bool
    sd: float | None
    when: float | None
    given: Given

    @classmethod
    def parse(cls, arguments: Sequence[str], machine: Machine) -> TypedReading:
        """Read ``NAME KEY=VALUE …``.

        Raises
        ------
        InputError
            For what is missing, unknown, or no number.
        """
        name, rest = arguments[0], arguments[1:]
        if "=" in name or "@" in name or name != name.strip() or not name or "," in name:
            raise InputError("the check has no name", found=name, expected=_USAGE)
        texts = split_assignments(rest)
        own = {k: texts.pop(k) for k in _OWN if k in texts}
        given = Given.parse([f"{k}={v}" for k, v in texts.items()], machine)
        if ("found" in own) == ("value" in own):
            raise InputError("either a place or an error is read", field=name, expected=_USAGE)
        found = _three("found", own["found"]) if "found" in own else None
        kind = own.get("kind", "displacement")
        if kind not in ("displacement", "rotation") or (found and "kind" in own):
            raise InputError(
                "what is read", field="kind", found=kind, expected="displacement, rotation"
            )
        for axis in "XYZ" if found else "":
            if axis in given.positions:
                raise InputError(
                    "where the sphere was found is where the axes stood",
                    field=axis,
                    found=f"{axis}={given.positions[axis]:g}",
                    expected="found=x,y,z alone",
                )
        unit = "µrad" if kind == "rotation" else "µm"
        for key, needs in (("nominal", "found"), ("u", "value"), ("value", "u")):
            if key in own and needs not in own:
                raise InputError(f"{key}= goes with {needs}=", field=key, expected=_USAGE)
        return cls(
            name,
            found,
            _three("nominal", own["nominal"]) if "nominal" in own else None,
            number("value", own["value"], unit, _ERROR) if "value" in own else 0.0,
            _direction(own["u"]) if "u" in own else (0.0, 0.0, 0.0),
            kind == "rotation",
            number("sd", own["sd"], unit, _SD) if "sd" in own else None,
            moment(own["when"], "when") if "when" in own else None,
            given,
        )

    @property
    def setups(self) -> list[str]:
        """Names of the set-ups of its rows."""
        return [self.name] if self.found is None else [f"{self.name}_{a}" for a in "XYZ"]

    def campaign(
        self, model: Model, now: float, before: Campaign | None, known: Mapping[str, float]
    ) -> Campaign:
        """The rows that it makes.

        Parameters
        ----------
        now
            s since 1970.
        before
            The checks so far: a sphere is where it was.
        known
            Signals that need not be typed.

        Raises
        ------
        InputError
            When an axis, a signal or an uncertainty is missing.
        """
        names = self.setups
        n = len(names)
        positions = self._positions(model.machine)
        values, free = [self.value], tuple[str, ...]()
        u = np.array([self.u])
        if self.found is not None:
            place = self.nominal or _place(names, positions, before) or self.found
            values = [(p - f) * 1e3 for p, f in zip(place, self.found, strict=True)]
            free = () if self.nominal else ("zero",)
            u = np.eye(3)
        per = 1e6 if self.rotation else 1e3
        signals = self._signals(model, before, known)
        spindle = self.given.spindle_angle
        conditions = Conditions(
            positions={a: np.full(n, q) for a, q in positions.items()},
            directions={a: np.full(n, s) for a, s in self.given.directions.items()},
            tool=np.tile(np.array(self.given.tool or (0.0, 0.0, 0.0)), (n, 1)),
            time=np.full(n, round(now if self.when is None else self.when, 3)),
            signals={s: np.full(n, v) for s, v in signals.items()},
            spindle_angle=None if spindle is None else np.full(n, spindle),
            setup=np.array(names),
            u=u,
        )
        kind = Kind.ROTATION if self.rotation else Kind.DISPLACEMENT
        return Campaign(
            self.name,
            conditions,
            np.full(n, kind, dtype=np.int8),
            np.round(np.array(values), 6) / per,
            np.full(n, self._sd(model) / per),
            np.full(n, ""),
            np.full(n, ""),
            np.arange(n),
            setups={s: Setup(s, free) for s in names},
            spindle=None if spindle is None else model.machine.structure.spindle,
        )

    def _positions(self, machine: Machine) -> dict[str, float]:
        positions = dict(self.given.positions)
        if self.found is not None:
            for axis, q in zip("XYZ", self.found, strict=True):
                if axis in machine.axes:
                    positions.setdefault(axis, q)
        missing = [a for a in machine.structure.axes if a not in positions]
        if missing:
            raise InputError(
                "no position given for " + ", ".join(missing),
                expected=" ".join(
                    f"{a}=.. ({'degrees' if is_rotary(a) else 'mm'})" for a in missing
                ),
            )
        return {a: positions[a] for a in machine.structure.axes}

    def _signals(
        self, model: Model, before: Campaign | None, known: Mapping[str, float]
    ) -> dict[str, float]:
        kept = [] if before is None else list(before.conditions.signals)
        wanted = dict.fromkeys([*model.signals_needed(), *kept, *self.given.signals])
        found = {**known, **self.given.signals}
        missing = [s for s in wanted if s not in found]
        if missing:
            units = model.machine.signals
            raise InputError(
                f"{', '.join(missing)} is not given, which the model reads or the checks before "
                "recorded",
                expected=" ".join(
                    f"{s}=.." + (f" ({units[s].unit})" if s in units else "") for s in missing
                ),
            )
        return {s: found[s] for s in wanted}

    def _sd(self, model: Model) -> float:
        """µm or µrad."""
        if self.sd is not None:
            return self.sd
        left = model.fit.get("rms_rotation_urad" if self.rotation else "rms")
        if not left:
            raise InputError(
                "how sure the reading is, is not given, and the model's fit does not say",
                field="sd",
                expected="sd=.. (µm, standard uncertainty; rotations µrad)",
            )
        return float(left)


def _place(
    names: Sequence[str], positions: Mapping[str, float], before: Campaign | None
) -> Vec3 | None:
    """Where an artefact is, by its first reading: position + error, mm."""
    if before is None or before.conditions.setup is None:
        return None
    place = []
    for name, axis in zip(names, "XYZ", strict=True):
        rows = np.flatnonzero(before.conditions.setup == name)
        if not rows.size or axis not in positions:
            return None
        first = rows[0]
        place.append(float(before.conditions.positions[axis][first]) + float(before.value[first]))
    return (place[0], place[1], place[2])


def _three(key: str, text: str) -> Vec3:
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError("not three numbers", field=key, found=text, expected="x,y,z in mm")
    x, y, z = (number(key, part, "mm", POINT) for part in parts)
    return x, y, z


def _direction(text: str) -> Vec3:
    sign, axis = (-1.0, text[1:]) if text[:1] in "-−" else (1.0, text)
    if axis in ("X", "Y", "Z"):
        return tuple(sign * float(axis == a) for a in "XYZ")  # type: ignore[return-value]
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError("not a direction", field="u", found=text, expected="X, -Y, or x,y,z")
    x, y, z = (number("u", part, "parts of 1") for part in parts)
    length = math.hypot(x, y, z)
    if not length > 0.0:
        raise InputError("not a direction", field="u", found=text, expected="X, -Y, or x,y,z")
    return x / length, y / length, z / length
