"""What the page *Tables* shows of a set: what the controller will hold, what remains and where."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.table_set import RECORD_NAME, TableSet, read_text, sha256
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, said, sentences_in
from abbe.compcore.tables.field import ErrorField, table_state
from abbe.compcore.tables.remainder import Remainder, TrialPoints
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers.tables.make import NONE
from abbe.daemon.answers.tables.words import names_of_remaining, trust_lines
from abbe.daemon.config import Configuration
from abbe.daemon.report.page import Figure, in_words, number, plain
from abbe.daemon.report.table import HELD_COLUMNS, held_rows, table_curves, where_left
from abbe.daemon.workbench.tables.held_record import record_of
from abbe.drivers.controllers import Confidence, Controller, make_controller


def held(configuration: Configuration, folder: Path) -> dict[str, Any]:
    """One object for the page.

    Raises
    ------
    InputError
        For a folder that holds no tables, files that were changed, a record that is not whole.
    """
    made = TableSet.load(folder)
    machine = configuration.model.machine
    controller = make_controller(made.controller, machine, made.options)
    tables = controller.read(made.files)
    record = record_of(made, folder)
    names = names_of_remaining(controller, machine, record["remaining"])
    left = {names.get(key, key): rest for key, rest in record["remaining"].items()}
    figures, where_note = _where(configuration, record, controller, tables)
    own, none = record["remaining"][controller.name], record["remaining"][NONE]
    title = headline(machine.structure.carrying, own["max"], none["max"])
    answer: dict[str, Any] = plain(
        {
            "title": title,
            "sentences": sentences_in([title, *trust_lines(controller)]),
            "controller": controller.title,
            "key": _key(left, record.get("uncertainty")),
            "trust": list(trust_lines(controller)),
            "unverified": controller.trust.least is Confidence.UNVERIFIED,
            "sign": controller.sign,
            "notes": list(record.get("notes", ())),
            "remaining": {"columns": _REMAINING, "cells": _remaining(left)},
            "where": figures,
            "where_note": where_note,
            "held": {"columns": HELD_COLUMNS, "cells": in_words(held_rows(record))},
            "curves": list(table_curves(tables)),
            "activation": list(controller.activation()),
            "facts": [
                ["Made", str(record["made"])],
                ["By", str(record["by"])],
                ["Folder", str(folder)],
                ["At", _conditions(record["conditions"])],
            ],
            "files": [
                [f"model, version {record['model'].get('versions_before', 0) + 1}",
                 PurePath(record["model"]["file"]).name, record["model"]["sha256"]],
                ["all tables", RECORD_NAME, made.checksum],
                *(["table", name, digest] for name, digest in made.checksums.items()),
            ],
        }
    )  # fmt: skip
    return answer


_REMAINING = ["", "Largest, µm", "95 %, µm", "rms, µm", "Largest at"]


def headline(carrying: Sequence[str], left: float, none: float) -> Sentence:
    """What is left of the error, µm; of a machine without one of X, Y, Z, along which it counts.

    Parameters
    ----------
    carrying
        The directions that an axis can take an error back in.
    left, none
        The largest error with the tables, and without.
    """
    sizes = {"left": number(left, 2), "none": number(none, 2)}
    if len(carrying) == 3:
        return said("With these tables {left} µm are left of {none} µm, at most", **sizes)
    return said(
        "Along {axes} alone, with these tables {left} µm are left of {none} µm, at most",
        axes=", ".join(sorted(carrying)),
        **sizes,
    )


def _remaining(left: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    return [
        [name, *(number(rest[key], 3) for key in ("max", "p95", "rms")), _place(rest["worst"])]
        for name, rest in left.items()
    ]


def _place(worst: Mapping[str, float]) -> str:
    return ", ".join(f"{axis} {number(q, 4)}" for axis, q in worst.items())


def _key(
    left: Mapping[str, Mapping[str, Any]], sure: Mapping[str, Any] | None
) -> list[tuple[str, str, str]]:
    """The largest of each in large type."""
    key = [(name, number(rest["max"], 3), "µm largest") for name, rest in left.items()]
    if sure is not None:
        wide = f"µm largest (k = {sure['k']:g})"
        key.append(("how sure the model is", f"± {number(sure['largest'], 3)}", wide))
    return key


def _conditions(conditions: Mapping[str, Any]) -> str:
    parts = [
        f"{name} {s['value']:g} {'°C' if s['unit'] == 'degC' else s['unit']}".strip()
        for name, s in conditions["signals"].items()
    ]
    tool = ", ".join(number(v) for v in conditions["tool_mm"])
    return "; ".join([*parts, f"tool {tool} mm"])


def _where(
    configuration: Configuration,
    record: Mapping[str, Any],
    controller: Controller,
    tables: tuple[Table, ...] | list[Table],
) -> tuple[list[Figure], str]:
    """Pictures of what remains along each axis, from the files themselves; why there are none."""
    if record.get("active_while_measured"):
        return [], (
            "Tables were active while the machine was measured, and these were added: where "
            "error remains is on the page of abbe table --report."
        )
    model = _model_of(configuration, record["model"])
    if model is None:
        return [], (
            f"The model from which they were made ({record['model']['sha256'][:12]}) is not at "
            "hand any more: where error remains cannot be worked out."
        )
    conditions = record["conditions"]
    signals = {name: float(s["value"]) for name, s in conditions["signals"].items()}
    x, y, z = conditions["tool_mm"]
    state = table_state(
        model, signals, tool=(float(x), float(y), float(z)), time=float(conditions["time_s"])
    )
    ranges = {
        axis: _radians(axis, float(v["from"]), float(v["to"]))
        for axis, v in conditions["volume"].items()
    }
    field = ErrorField(model, state, conditions["looked_up_at"])
    trial = TrialPoints.over(field, Volume.of(model.machine, ranges))
    left: dict[str, Remainder] = {
        NONE: trial.remainder(),
        controller.name: trial.remainder(tables),
    }
    axes = model.machine.structure.axes
    return list(where_left(axes, left, controller.name)), ""


def _radians(axis: str, low: float, high: float) -> tuple[float, float]:
    return (math.radians(low), math.radians(high)) if is_rotary(axis) else (low, high)


def _model_of(configuration: Configuration, reported: Mapping[str, Any]) -> Model | None:
    """The very model that tables were made from; None where no file has its SHA-256."""
    named = Path(str(reported["file"]))
    for path in itertools.chain([configuration.model_path], [named] if named.is_file() else []):
        try:
            if sha256(read_text(path)) == reported["sha256"]:
                return load_model(path).switched()
        except AbbeError:
            continue
    return None
