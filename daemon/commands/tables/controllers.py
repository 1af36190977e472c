"""``abbe controllers``: the dialects that Abbe writes, what each can hold, and how sure it is."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abbe.daemon.arguments.options import AsJson

if TYPE_CHECKING:
    from abbe.drivers.controllers import Controller


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("controllers")(controllers)


def controllers(
    name: Annotated[str | None, typer.Argument(help="One of them, in full.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the controllers whose tables Abbe writes and reads, or tell one in full."""
    from abbe.drivers.controllers import controller_class, controller_kinds

    kinds = controller_kinds() if name is None else {name: controller_class(name)}
    if as_json:
        found = {key: _as_json(cls) for key, cls in kinds.items()}
        typer.echo(json.dumps({"controllers": found}, ensure_ascii=False))
        return
    if name is not None:
        for line in _page(kinds[name]):
            typer.echo(line)
        return
    wide = max(len(key) for key in kinds)
    typer.echo(f"{'':<{wide}}  how sure    holds")
    for key, cls in kinds.items():
        types = ", ".join(_example(cls).capability.types)
        typer.echo(f"{key:<{wide}}  {cls.trust.least:<10}  {types:<28}  {cls.title}")
    typer.echo("\nhow sure: the least of syntax, sign and activation; see `abbe controllers NAME`")
    typer.echo("L-VOL+ and R-VOL+ need two rotary axes; without, they are L-VOL and R-VOL")
    typer.echo("\nNot possible, and why")
    for cls in kinds.values():
        for line in _cannot(cls):
            typer.echo(line)


def _example(cls: type[Controller]) -> Controller:
    """The dialect for a three-axis machine, with its own defaults."""
    from abbe.compcore.machine.machine import Axis, Machine
    from abbe.compcore.machine.structure import Structure

    structure = Structure.parse("w b X Y Z t")
    axes = {a: Axis(a, (0.0, 500.0)) for a in "XYZ"}
    return cls(Machine("", structure, axes))


def _cannot(cls: type[Controller]) -> list[str]:
    return [f"  {c.what}: {c.why}" for c in cls.cannot]


def _as_json(cls: type[Controller]) -> dict[str, Any]:
    capability = _example(cls).capability
    return {
        "title": cls.title,
        "types": list(capability.types),
        "looked_up_at": capability.lookup,
        "knows_tool": capability.knows_tool,
        "tables": [
            {
                "form": h.form,
                "types": list(h.types),
                "points": h.points,
                "spacing": h.spacing.rule,
                "directions": 2 if h.directional else 1,
                "resolution_um": h.resolution * 1e3,
                "incremental": h.increment is not None,
                "zero_at": h.zero_at,
            }
            for h in capability.holds
        ],
        "sign": cls.sign,
        "source": cls.source,
        "trust": cls.trust.as_dict(),
        "options": {
            key: {"default": _plain(field.get_default(call_default_factory=True))}
            for key, field in cls.Options.model_fields.items()
        },
        "activation": list(_example(cls).activation()),
        "cannot": [{"what": c.what, "why": c.why} for c in cls.cannot],
    }


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _page(cls: type[Controller]) -> list[str]:
    found = _as_json(cls)
    lines = [f"{cls.name}: {cls.title}", "", *_doc(cls), "", "It holds"]
    for row in found["tables"]:
        ways = "a value for each direction" if row["directions"] == 2 else "one value"
        entries = "increments" if row["incremental"] else "values"
        lines.append(
            f"  {row['form']} tables ({', '.join(row['types'])}): up to {row['points']} points, "
            f"{row['spacing']}, {ways}, {entries} in steps of {row['resolution_um']:g} µm"
        )
    lines.append(f"  looked up at the {found['looked_up_at']} position")
    lines += ["", f"Sign: {cls.sign}", f"Source: {cls.source}"]
    trust = found["trust"]
    lines.append(
        f"How sure: syntax {trust['syntax']}, sign {trust['sign']}, activation "
        f"{trust['activation']}" + (f" - {trust['note']}" if "note" in trust else "")
    )
    lines += ["", "Options (--set KEY=VALUE), with their defaults"]
    lines += [
        f"  {key} = {value['default'] or '(none)'}"
        if value["default"] not in (False, 0)
        else f"  {key} = {str(value['default']).lower()}"
        for key, value in found["options"].items()
    ]
    lines += ["", "At the controller", *(f"  - {step}" for step in found["activation"])]
    if cls.cannot:
        lines += ["", "Not possible, and why", *_cannot(cls)]
    return lines


def _doc(cls: type[Controller]) -> list[str]:
    return [line.strip() for line in (cls.__doc__ or "").strip().splitlines()]
