"""The page of ``abbe history --report``: the error falling, version by version."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from abbe.compcore.files.model_file import summary
from abbe.compcore.model.model import Model
from abbe.daemon.report.page import Page, number
from abbe.daemon.report.versions import change, error_of_versions, number_of


def versions_of(model: Model) -> list[dict[str, Any]]:
    """The records of all versions, oldest first, this one included once it was fitted."""
    versions = [dict(record) for record in model.history]
    return [*versions, dict(summary(model))] if model.fit else versions


def page_of(model: Model, file: str) -> Page:
    """The page of a model and all its versions; `file` is the model file's name."""
    return history_page(model, versions_of(model), file)


def history_page(model: Model, versions: Sequence[Mapping[str, Any]], file: str) -> Page:
    """The whole page.

    Parameters
    ----------
    model
        The newest version.
    versions
        The records of all versions, oldest first, the newest included.
    file
        The model file's name.
    """
    page = Page(f"{model.machine.name or 'Machine'}: versions of the model", file)
    if not versions:
        page.text("This model has not been fitted yet: abbe fit MODEL CAMPAIGN... -o OUT")
    else:
        _key_figures(page, versions)
        _warnings(page, versions)
        _picture(page, versions)
        _table(page, versions)
        _measurements(page, versions)
    page.section("Effects now")
    page.table(
        ["Effect", "Fitted"],
        [[term.effect.spec, "yes" if term.fitted else "no"] for term in model.terms],
    )
    return page


def _key_figures(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    figures = []
    for key, name in (("rms", "fitted campaigns"), ("holdout_rms", "held-out campaigns")):
        reported = [v for v in (number_of(r, key) for r in versions) if v is not None]
        if reported:
            fall = (
                number(reported[-1], 3) if len(reported) == 1 else _fall(reported[0], reported[-1])
            )
            figures.append((name, fall, "µm rms"))
    floor = next(
        (v for r in versions[::-1] if (v := number_of(r, "noise_floor")) is not None), None
    )
    figures.append(
        ("noise floor", "unknown", "(no repeats)")
        if floor is None
        else ("noise floor", number(floor, 3), "µm")
    )
    page.key_figures(figures)


def _fall(first: float, last: float) -> str:
    return f"{number(first, 3)} → {number(last, 3)}"


def _picture(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    drawn = error_of_versions(versions)
    page.section("The error, version by version")
    if drawn is None:
        page.text("No version tells the residuals of lengths.")
        return
    page.figure(
        drawn,
        "RMS of what each version leaves unexplained. Fitted campaigns: the measurements from "
        "which its parameters come. Held-out campaigns: measurements that it has never seen; only "
        "their fall shows that a version predicts the machine. Noise floor: how well the "
        "measurements repeat; no model gets lastingly below it. A fit may lie a little "
        "below, because its parameters follow some of the noise.",
    )


def _warnings(page: Page, versions: Sequence[Mapping[str, Any]]) -> None:
    notes = []
    fitted = [k for k, r in enumerate(versions, start=1) if number_of(r, "rms") is not None]
    if fitted and fitted[-1] < len(versions):
        notes.append(
            f"The newest version was not refitted; the errors are those of version {fitted[-1]}."
        )
    if any("rms" in r for r in versions) and not any("holdout_rms" in r for r in versions):
        notes.append(
            "No version was laid beside measurements that were not fitted: whether the model "
            "predicts the machine is not known. Give abbe add a --holdout campaign."
        )
    for key, name in (("campaigns", "fitted"), ("holdout", "held-out")):
        reported = [_digests(r, key) for r in versions if key in r]
        if len({frozenset(d) for d in reported}) > 1:
            notes.append(
                f"Not all versions have the same {name} campaigns; their errors compare only as "
                "far as the campaigns do."
            )
    page.notes(notes, warning=True)


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


def _files(record: Mapping[str, Any], key: str) -> str:
    return ", ".join(PurePath(str(c.get("file", "–"))).name for c in record.get(key, ())) or "–"
