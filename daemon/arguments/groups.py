"""Options that belong together, written once as a dataclass and taken as one argument."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command as Typer takes it: each argument that is a dataclass opened into its fields.

    Every field is an option with a default, and stands in the help where the argument stands.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, type[Any]] = {}
    parameters: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        kind = hints[name]
        if not (isinstance(kind, type) and is_dataclass(kind)):
            parameters.append(parameter.replace(annotation=kind, kind=Parameter.KEYWORD_ONLY))
            continue
        groups[name] = kind
        own = get_type_hints(kind, include_extras=True)
        parameters += [
            Parameter(
                f.name, Parameter.KEYWORD_ONLY, default=f.default, annotation=own[f.name]
            )
            for f in fields(kind)
        ]  # fmt: skip

    @wraps(command)
    def opened(**given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{f.name: given.pop(f.name) for f in fields(kind)})
        command(**given)

    opened.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    opened.__annotations__ = {p.name: p.annotation for p in parameters}
    return opened
