"""What the page *Watch* shows: every version's error, each campaign against its own noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from abbe.compcore.sentences import said, sentences_in
from abbe.compcore.units import in_digits
from abbe.daemon.report.campaign_courses import course_figure, courses_of
from abbe.daemon.report.model.history import error_title, versions_of, warnings_of
from abbe.daemon.report.page import in_words, plain
from abbe.daemon.report.versions import change, number_of
from abbe.daemon.workbench.versions.folder import ModelVersion
from abbe.daemon.workbench.versions.journal import Entry

_HOLD_OUT = said(
    "To hold one out: under “1 Compare” open “Campaigns”, choose “held out” for it, then click "
    "“Compare with these”."
)


def watched(
    versions: Sequence[ModelVersion],
    current: ModelVersion,
    added: Sequence[str],
    journal: Sequence[Entry] = (),
) -> dict[str, Any]:
    """One object for the page.

    Parameters
    ----------
    versions
        All files, the model that was opened first.
    current
        The one that is looked at.
    added
        What the last addition said of itself.
    journal
        What was done and noted, the newest first.
    """
    listed = list(_listed(versions))
    records = [record for _, record in listed]
    present = next((k for k, (v, _) in enumerate(listed) if v is current), None)
    courses = courses_of(records)
    rows: list[list[str | float | int | None]] = [
        [
            k,
            _change(version, record),
            number_of(record, "rms"),
            number_of(record, "holdout_rms"),
            number_of(record, "noise_floor"),
            str(record.get("date", "–"))[:16].replace("T", " "),
            "–" if version is None else PurePath(version.path).name,
        ]
        for k, (version, record) in enumerate(listed, start=1)
    ]
    found = {
        "title": _title(records, present),
        "said": list(added),
        "warnings": warnings_of(records, _HOLD_OUT) if any(records) else [],
        "columns": ["Version", "Change", "Fitted, µm", "Held out, µm", "Noise floor, µm", "Date",
                    "File"],
        "cells": in_words(rows, 3),
        "go_back": [None if v is None else versions.index(v) for v, _ in listed],
        "versions": [
            {"number": k, "name": v.path.name, "current": v is current}
            for k, v in enumerate(versions)
        ],
        "journal": list(journal),
        "current": present,
        "courses": [
            {"figure": course_figure(course, courses), "caption": course.caption}
            for course in courses
        ],
    }  # fmt: skip
    answer: dict[str, Any] = plain({**found, "sentences": sentences_in(found)})
    return answer


def _title(records: Sequence[Mapping[str, Any]], present: int | None) -> str:
    """What the versions brought; of an earlier one that was gone back to, that it is looked at."""
    if present is None or present == len(records) - 1:
        return error_title(records)
    left, number, several = number_of(records[present], "rms"), present + 1, len(records)
    if left is None:
        return said("Version {number} of {several} is looked at", number=number, several=several)
    return said(
        "Version {number} of {several} is looked at: {left} µm are left",
        number=number,
        several=several,
        left=in_digits(left),
    )


def _change(version: ModelVersion | None, record: Mapping[str, Any]) -> str:
    if version is not None and version.record is None:
        return "as opened, not fitted" + (" (errors: once fitted)" if record else "")
    return change(record)


def _listed(
    versions: Sequence[ModelVersion],
) -> list[tuple[ModelVersion | None, Mapping[str, Any]]]:
    """Every version with its record, oldest first; None for those that have no file here."""
    first, *others = versions
    own = first.record
    listed: list[tuple[ModelVersion | None, Mapping[str, Any]]] = [
        (None, record) for record in first.model.history
    ]
    if own is None:
        # it was fitted for the first time together with what was made of it
        own = next((v.model.history[-1] for v in others if len(v.model.history) == 1), None)
    listed.append((first, own or {}))
    listed += [(v, versions_of(v.model)[-1]) for v in others if v.model.fit]
    return [(v, _with_held_out(record, others)) for v, record in listed]


def _with_held_out(record: Mapping[str, Any], others: Sequence[ModelVersion]) -> Mapping[str, Any]:
    """A version's record; where none was held out from it, as what was made of it tells of it.

    What is added holds the version before beside its campaigns, too, and keeps that.
    """
    if "holdout" in record or "date" not in record:
        return record
    told = (r for v in others for r in v.model.history if r.get("date") == record["date"])
    return next((r for r in told if "holdout" in r), record)
