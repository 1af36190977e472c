"""The page of ``abbe history --report``: the error falling, version by version."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from abbe.compcore.files.model_file import summary
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, said
from abbe.daemon.answers.typed import fitting
from abbe.daemon.report.campaign_courses import course_figure, courses_of
from abbe.daemon.report.head import file_on_page, head_of
from abbe.daemon.report.page import Page, number
from abbe.daemon.report.versions import change, error_of_versions, floor_of, number_of

HOLD_OUT = said("To hold one out, give abbe add a --holdout campaign.")
"""How a campaign is held out by a command."""


def versions_of(model: Model) -> list[dict[str, Any]]:
    """The records of all versions, oldest first, this one included once it was fitted."""
    versions = [dict(record) for record in model.history]
    return [*versions, dict(summary(model))] if model.fit else versions


def page_of(model: Model, file: Path) -> Page:
    """The page of a model, as its file has it, and of all its versions."""
    return history_page(model, versions_of(model), file)


def history_page(model: Model, versions: Sequence[Mapping[str, Any]], file: Path) -> Page:
    """The whole page.

    Parameters
    ----------
    model
        The newest version.
    versions
        The records of all versions, oldest first, the newest included.
    file
        The model's file.
    """
    name = model.machine.name or "Machine"
    page = Page(
        error_title(versions), f"{name}: versions of the model",
        head_of(model, [file_on_page("model", file)]),
    )  # fmt: skip
    if not versions:
        page.text(f"This model has not been fitted yet: {fitting(file)}")
    else:
        _key_figures(page, versions)
        page.notes(warnings_of(versions, HOLD_OUT), warning=True)
        _picture(page, versions)
        _table(page, versions)
        _measurements(page, versions)
    page.section("Effects now")
    page.table(
        ["Effect", "Fitted"],
        [[term.effect.spec, "yes" if term.fitted else "no"] for term in model.terms],
    )
    return page


def error_title(versions: Sequence[Mapping[str, Any]]) -> str:
    """How the error fell, where it counts: on held-out campaigns, if there were any."""
    for key, what in (("holdout_rms", said("The held-out error")), ("rms", said("The error"))):
        known = [v for v in (number_of(r, key) for r in versions) if v is not None]
        if len(known) > 1:
            return _course(what, known)
        if known:
            return said("{what} is {last} µm", what=what, last=number(known[-1], 3))
    return said("The versions of the model")


def _course(what: str, known: Sequence[float]) -> str:
    """Whether an error fell, and by the last step as well; by what is printed of it."""
    first, before, last = (number(v, 3) for v in (known[0], known[-2], known[-1]))
    ends = {"what": what, "first": first, "last": last}
    if last == first:
        return said("{what} stays at {last} µm", what=what, last=last)
    if known[-1] > known[0]:
        return said("{what} rose from {first} to {last} µm", **ends)
    if last == before or known[-1] > known[-2]:
        return said("{what} fell from {first} to {last} µm; not by the last step", **ends)
    return said("{what} fell from {first} to {last} µm", **ends)


def _key_figures(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    figures = []
    for key, floor, name in (
        ("rms", "noise_floor", "fitted campaigns"),
        ("holdout_rms", "holdout_noise_floor", "held-out campaigns"),
    ):
        reported = [v for v in (number_of(r, key) for r in versions) if v is not None]
        if reported:
            fall = (
                number(reported[-1], 3) if len(reported) == 1 else _fall(reported[0], reported[-1])
            )
            figures.append((name, fall, "µm rms"))
            level = next((v for r in versions[::-1] if (v := floor_of(r, floor)) is not None), None)
            words = ("unknown", "(no repeats)") if level is None else (number(level, 3), "µm")
            figures.append(("their noise floor", *words))
    page.key_figures(figures)


def _fall(first: float, last: float) -> str:
    return f"{number(first, 3)} → {number(last, 3)}"


def _picture(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    page.section("The error, version by version")
    courses = courses_of(versions)
    if courses:
        page.text(
            "One picture for each campaign, all in the same scale: rms of what each version leaves "
            "unexplained of it, beside how well it repeats itself. Blue: the version was fitted to "
            "it. Yellow: it was held out, the version has never seen it; only that fall shows that "
            "a version predicts the machine. Dashed: how well it repeats itself."
        )
        page.figures([(course_figure(c, courses), c.caption) for c in courses])
        return
    drawn = error_of_versions(versions)
    if drawn is None:
        page.text("No version tells the residuals of lengths.")
        return
    page.figure(
        drawn,
        "RMS of what each version leaves unexplained. Fitted campaigns: the measurements from "
        "which its parameters come. Held-out campaigns: measurements that it has never seen; only "
        "their fall shows that a version predicts the machine. Dashed: how well the measurements "
        "repeat; no model gets lastingly below it. A fit may lie a little below, because its "
        "parameters follow some of the noise.",
    )


def warnings_of(versions: Sequence[Mapping[str, Any]], hold_out: Sentence) -> list[str]:
    """What the errors of the versions do not say.

    Parameters
    ----------
    hold_out
        How a person holds a campaign out here: a command, or what to click.
    """
    notes: list[str] = []
    fitted = [k for k, r in enumerate(versions, start=1) if number_of(r, "rms") is not None]
    if fitted and fitted[-1] < len(versions):
        notes.append(
            said(
                "The newest version was not refitted; the errors are those of version {n}.",
                n=fitted[-1],
            )
        )
    if any("rms" in r for r in versions) and not any("holdout_rms" in r for r in versions):
        notes.append(
            said(
                "No version was laid beside measurements that were not fitted: whether the model "
                "predicts the machine is not known."
            )
        )
        notes.append(hold_out)
    for key, name in (("campaigns", "fitted"), ("holdout", "held-out")):
        reported = [_digests(r, key) for r in versions if key in r]
        if len({frozenset(d) for d in reported}) > 1:
            notes.append(
                f"Not all versions have the same {name} campaigns; their errors compare only as "
                "far as the campaigns do."
            )
    return notes


def _digests(record: Mapping[str, Any], key: str) -> list[str]:
    return [str(c.get("sha256", c.get("file"))) for c in record[key]]


def _table(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    rows: list[list[str | float | int | None]] = []
    for k, record in enumerate(versions, start=1):
        effects = record.get("effects")
        rows.append(
            [
                k,
                change(record),
                effects if isinstance(effects, int) else None,
                number_of(record, "rms"),
                number_of(record, "holdout_rms"),
                number_of(record, "noise_floor"),
                number_of(record, "chi2_per_dof"),
                str(record.get("date", "–"))[:16].replace("T", " "),
            ]
        )
    columns = [
        "Version",
        "Change",
        "Effects",
        "Fitted",
        "Held out",
        "Noise floor",
        "χ²/dof",
        "Date",
    ]
    page.table(columns, rows, caption="Errors in µm rms")
    page.text(
        "χ²/dof (per degree of freedom) sets the residuals against each row's stated uncertainty; "
        "1 means that nothing but noise is left. A dash: the version was not fitted, or its record "
        "does not tell."
    )


def _measurements(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    rows: list[list[str | int]] = [
        [k, _files(record, "campaigns"), _files(record, "holdout")]
        for k, record in enumerate(versions, start=1)
    ]
    page.subsection("Measurements")
    page.table(["Version", "fitted to", "held out"], rows)
    _campaigns(page, versions)


def _campaigns(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    """Every campaign's own figures, version by version."""
    rows: list[list[str | float | int | None]] = []
    for course in courses_of(versions):
        rows += [
            [course.name, v.version, "held out" if v.held_out else "fitted", v.rms, v.floor]
            for v in course.values
        ]
    if rows:
        page.table(
            ["Campaign", "Version", "", "rms", "Its noise floor"],
            rows,
            caption="Campaign by campaign, lengths in µm",
            digits=3,
        )


def _files(record: Mapping[str, Any], key: str) -> str:
    return ", ".join(PurePath(str(c.get("file", "–"))).name for c in record.get(key, ())) or "–"
