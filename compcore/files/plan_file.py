"""The plan file: set-ups that are to be measured, target by target; docs/plan.md is its page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StrictBool, ValidationError

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.formats import PLAN
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.envelope import KeepOut, WorkingSpace
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.plan import SurveyPlan
from abbe.compcore.planning.planned_setup import PlannedSetup

_Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
_Vector = tuple[_Number, _Number, _Number]
_Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[^\x00-\x1f\"\\,#]+$")]
_MOST_TARGETS = 5000


class _PlanSection(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class PlannedSetupSection(_PlanSection):
    """``[[setups]]``; mm, degrees, sd µm or µrad."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,40}$")]
    what: Annotated[str, Field(max_length=200)] = ""
    instrument: str
    kind: Literal["displacement", "rotation", "distance"]
    free: tuple[Literal["zero", "slope", "frame"], ...]
    axis: str = ""
    tool: _Name
    runs: Annotated[int, Field(ge=1, le=100)] = 1
    both_ways: bool = True
    minutes: _Number = 0.0
    expected: tuple[_Number, _Number] | None = None
    base: _Vector | None = None
    stands: dict[_Name, _Vector] = {}
    axes: Annotated[tuple[str, ...], Field(min_length=1)]
    targets: Annotated[
        tuple[tuple[_Number, ...], ...], Field(min_length=2, max_length=_MOST_TARGETS)
    ]
    read: Annotated[tuple[tuple[_Vector, ...], ...], Field(max_length=_MOST_TARGETS)] = ()
    sd: Annotated[
        tuple[Annotated[float, Field(gt=0.0, le=1e5)], ...],
        Field(min_length=1, max_length=_MOST_TARGETS),
    ]


class KeepOutSection(_PlanSection):
    """``[[keep_out]]``: a box, mm."""

    low: _Vector
    high: _Vector


class _PlanDocument(_PlanSection):
    format: Literal["abbe-plan/1"]
    model: str = ""
    machine: str = ""
    structure: str
    warm_up: Annotated[float, Field(ge=0.0, le=1e4)] = 60.0
    beyond: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    nudge: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    tool_radius: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    table_radius: Annotated[float, Field(ge=0.0, le=10000.0)] = 0.0
    in_one_go: StrictBool = False
    tools: dict[_Name, _Vector]
    keep_out: tuple[KeepOutSection, ...] = ()
    setups: Annotated[tuple[PlannedSetupSection, ...], Field(min_length=1, max_length=1000)]


@dataclass(frozen=True, eq=False)
class PlannedWork:
    """A plan as its file holds it: what the next commands need of it.

    Attributes
    ----------
    setups
        The set-ups in their order, each with its name.
    space
        Where the machine may go.
    tools
        Name → offset, mm.
    model
        The model's file, as the plan names it; may be empty.
    warm_up
        s that the machine warms up before the first reading.
    expected
        Set-up → standard uncertainty over the volume before and after it, mm, where the plan says.
    in_one_go
        Whether a set-up counts only from its first target to its last without another zero.
    """

    setups: tuple[PlannedSetup, ...]
    space: WorkingSpace
    tools: Mapping[str, tuple[float, float, float]]
    model: str
    warm_up: float
    expected: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    in_one_go: bool = False


def read_plan(path: str | Path, machine: Machine) -> PlannedWork:
    """Read a plan for a machine.

    Raises
    ------
    InputError
        Naming file, line and field: for what is no plan, for a plan of another machine, unknown
        instruments, axes and tools, targets outside the travels and ways through a keep-out box.
    """
    source = TomlSource.read(path)
    try:
        found = _PlanDocument.model_validate(source.data)
    except ValidationError as error:
        raise source.invalid(error) from None
    if found.structure.replace(" ", "") != str(machine.structure).replace(" ", ""):
        raise source.error(
            "a plan for another machine",
            ("structure",),
            found=found.structure,
            expected=str(machine.structure),
        )
    if found.machine and machine.name and found.machine != machine.name:
        raise source.error(
            "a plan for another machine",
            ("machine",),
            found=found.machine,
            expected=f"{machine.name}, as its model is called",
        )
    for i, b in enumerate(found.keep_out):
        if not all(low < high for low, high in zip(b.low, b.high, strict=True)):
            raise source.error(
                "not a box",
                ("keep_out", i, "low"),
                found=list(b.low),
                expected="every number below that of high",
            )
    boxes = tuple(KeepOut(b.low, b.high) for b in found.keep_out)
    space = WorkingSpace(boxes, found.tool_radius, found.beyond, found.nudge, found.table_radius)
    setups, names = [], set()
    for i, section in enumerate(found.setups):
        if section.name in names:
            raise source.error("a name twice", ("setups", i, "name"), found=section.name)
        names.add(section.name)
        setup = _setup(source, i, section, found.tools, machine)
        hindrance = space.hindrance(machine, setup)
        if hindrance is not None:
            raise source.error(
                hindrance,
                ("setups", i, "targets"),
                found=section.name,
                expected=f"targets within the travels, with {space.beyond:g} mm to come from both "
                "sides, and ways outside the keep-out boxes",
            )
        setups.append(setup)
    expected = {
        s.name: (s.expected[0] * 1e-3, s.expected[1] * 1e-3) for s in found.setups if s.expected
    }
    warm_up = 60.0 * found.warm_up
    return PlannedWork(
        tuple(setups), space, found.tools, found.model, warm_up, expected, found.in_one_go
    )


def model_of(path: str | Path) -> Path:
    """The model's file that a plan names; where it is not there, beside the plan.

    Raises
    ------
    InputError
        When it is no plan, or names none.
    """
    source = TomlSource.read(path)
    if source.data.get("format", PLAN) != PLAN:
        raise source.error(
            "not allowed", ("format",), found=source.data["format"], expected=f"'{PLAN}'"
        )
    name = source.data.get("model")
    if not isinstance(name, str) or not name:
        raise source.error("the plan names no model", ("model",), found=name, expected="--model")
    found = Path(name)
    return found if found.exists() or found.is_absolute() else Path(path).parent / found


def _setup(
    source: TomlSource,
    i: int,
    section: PlannedSetupSection,
    tools: Mapping[str, tuple[float, float, float]],
    machine: Machine,
) -> PlannedSetup:
    def wrong(problem: str, key: str, found: object, expected: str) -> InputError:
        return source.error(problem, ("setups", i, key), found=found, expected=expected)

    if section.instrument not in INSTRUMENTS:
        raise wrong("no such instrument", "instrument", section.instrument, ", ".join(INSTRUMENTS))
    if section.tool not in tools:
        raise wrong("no such tool", "tool", section.tool, "one of " + ", ".join(tools))
    if sorted(section.axes) != sorted(machine.structure.axes):
        wanted = ", ".join(machine.structure.axes)
        raise wrong("not the machine's axes", "axes", list(section.axes), wanted)
    if section.axis and section.axis not in section.axes:
        raise wrong("no such axis", "axis", section.axis, ", ".join(section.axes))
    count = len(section.targets)
    for row in section.targets:
        if len(row) != len(section.axes):
            raise wrong("not a number for each axis", "targets", list(row), str(len(section.axes)))
    if len(section.sd) not in (1, count):
        raise wrong("not one for each target", "sd", len(section.sd), f"1 or {count} numbers")
    distance = section.kind == "distance"
    if distance != (section.base is not None):
        raise wrong("where distances are measured from", "base", None, "base with kind distance")
    if not distance and len(section.read) not in (1, count):
        raise wrong("not one for each target", "read", len(section.read), f"1 or {count}")
    read = np.array(section.read) if len({len(r) for r in section.read}) == 1 else np.zeros((0, 0))
    if not distance and (read.ndim != 3 or np.abs(np.linalg.norm(read, axis=2) - 1.0).max() > 1e-3):
        raise wrong("not directions", "read", "…", "as many unit vectors at each target")
    u = np.zeros((count, 1, 3)) if distance else np.broadcast_to(read, (count, *read.shape[1:]))
    at = np.array(section.targets, dtype=np.float64)
    turned = {a: np.radians(at[:, k]) if is_rotary(a) else at[:, k]
              for k, a in enumerate(section.axes)}  # fmt: skip
    return PlannedSetup(
        INSTRUMENTS[section.instrument],
        section.what,
        section.axis,
        turned,
        u.copy(),
        Kind[section.kind.upper()],
        section.free,
        np.broadcast_to(np.array(section.sd) * 1e-3 ** (2 if section.kind == "rotation" else 1),
                        (count,)).copy(),
        section.tool,
        tools[section.tool],
        section.runs,
        section.both_ways,
        section.base,
        dict(section.stands),
        section.name,
    )  # fmt: skip


def write_plan(
    plan: SurveyPlan, path: str | Path, model: str = "", *, in_one_go: bool = False
) -> None:
    """Write a plan, whole or not at all.

    Parameters
    ----------
    model
        The model's file, for the commands that read the plan.
    in_one_go
        As of `PlannedWork`.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    write_atomically(path, "\n".join(_lines(plan, model, in_one_go=in_one_go)) + "\n")


def _lines(plan: SurveyPlan, model: str, *, in_one_go: bool) -> Iterator[str]:
    task = plan.task
    yield f'format = "{PLAN}"'
    yield f"model = {_text(model)}"
    yield f"machine = {_text(task.machine.name)}"
    yield f"structure = {_text(str(task.machine.structure))}"
    yield f"warm_up = {plan.warm_up / 60.0:g}          # min, as in use, before the first reading"
    yield f"beyond = {task.space.beyond:g}            # mm that axes go beyond, to come back"
    if task.space.nudge:
        yield f"nudge = {task.space.nudge:g}          # mm aside of a line, which has to show"
    yield f"tool_radius = {task.space.radius:g}       # mm, the tool with its holder"
    if task.space.table:
        yield f"table_radius = {task.space.table:g}    # mm, what turns with a sphere, below it"
    if in_one_go:
        yield "in_one_go = true      # a line that was interrupted is measured anew"
    yield "\n[tools]"
    for name, offset in task.tools.items():
        yield f"{_text(name)} = {_numbers(offset)}"
    for box in task.space.keep_out:
        yield f"\n[[keep_out]]\nlow = {_numbers(box.low)}\nhigh = {_numbers(box.high)}"
    for step in plan.steps:
        yield from _setup_lines(step.setup, step.before, step.after)


def _setup_lines(setup: PlannedSetup, before: float, after: float) -> Iterator[str]:
    yield f"\n[[setups]]\nname = {_text(setup.name)}\nwhat = {_text(setup.what)}"
    yield f'instrument = "{setup.instrument.key}"\nkind = "{setup.kind.name.lower()}"'
    yield f"free = {json.dumps(list(setup.free))}\naxis = {_text(setup.axis)}"
    yield f"tool = {_text(setup.tool)}\nruns = {setup.runs}"
    yield f"both_ways = {'true' if setup.both_ways else 'false'}"
    yield f"minutes = {setup.seconds / 60.0:.1f}"
    yield f"expected = {_numbers((before * 1e3, after * 1e3))}  # µm over the volume, before, after"
    if setup.base is not None:
        yield f"base = {_numbers(setup.base)}"
    yield f"axes = {json.dumps(list(setup.targets))}"
    columns = [np.degrees(q) if is_rotary(a) else q for a, q in setup.targets.items()]
    yield "targets = ["
    for row in np.stack(columns, axis=1):
        yield f"  {_numbers(row.tolist())},"
    yield "]"
    if setup.kind != Kind.DISTANCE:
        same = bool((np.ptp(setup.u, axis=0) == 0.0).all())
        yield "read = ["
        for vectors in setup.u[:1] if same else setup.u:
            yield f"  [{', '.join(_numbers(v.tolist()) for v in vectors)}],"
        yield "]"
    factor = 1e6 if setup.kind == Kind.ROTATION else 1e3
    alike = float(np.ptp(setup.sd)) < 1e-12
    yield f"sd = {_numbers([x * factor for x in (setup.sd[:1] if alike else setup.sd).tolist()])}"
    stands = ", ".join(f"{_text(k)} = {_numbers(v)}" for k, v in setup.optics.items())
    yield f"stands = {{ {stands} }}"


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{float(v) + 0.0:.7g}" for v in values) + "]"


def _text(text: str) -> str:
    # the escapes of JSON are those of TOML
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
