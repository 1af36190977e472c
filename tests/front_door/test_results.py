"""What a result says and draws is what the command prints and what its page shows."""

from __future__ import annotations

import builtins
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import abbe
from tests.support.daemon.command_line import abbe as command
from tests.support.daemon.pages import figures_of

FOLDER = Path(__file__).parents[1] / "data" / "p01-mill"
MODEL, DAY1, DAY2 = (FOLDER / name for name in ("model.toml", "fit.csv", "check.csv"))

Result = abbe.FitResult | abbe.Comparison | abbe.Diagnosis


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[abbe.FitResult, str, str]:
    return _beside("fit", tmp_path_factory)


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[abbe.Comparison, str, str]:
    return _beside("compare", tmp_path_factory)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[abbe.Diagnosis, str, str]:
    return _beside("diagnose", tmp_path_factory)


def _beside(verb: str, folders: pytest.TempPathFactory) -> Any:
    """The result, what the command prints, and its page."""
    folder = folders.mktemp(verb)
    page, fitted = folder / "page.html", folder / "fitted.toml"
    model = abbe.load_model(MODEL)
    day1 = abbe.read_campaigns([DAY1], model.machine)
    found: Result
    if verb == "fit":
        words = [verb, MODEL, DAY1, "-o", fitted]
        found = abbe.fit(model, day1)
    elif verb == "compare":
        abbe.save_model(abbe.fit(model, day1).model, fitted)
        words = [verb, fitted, DAY2]
        kept = abbe.load_model(fitted)
        found = abbe.compare(kept, abbe.read_campaigns([DAY2], kept.machine))
    else:
        words = [verb, MODEL, DAY1]
        found = abbe.diagnose(model, day1)
    done = command(*words, "--report", page)
    assert done.status == 0, done.err
    printed = done.out
    return found, printed[: printed.rindex("written: ")].rstrip("\n"), page.read_text("utf-8")


def test_report_of_a_fit(fitted: tuple[abbe.FitResult, str, str]) -> None:
    found, printed, _ = fitted
    # the command has read the campaign by its path, Python too: the same words
    assert found.report() == printed


def test_report_of_a_comparison(compared: tuple[abbe.Comparison, str, str]) -> None:
    found, printed, _ = compared
    typed = re.sub(r"next: abbe diagnose \S+ \S+", "next: abbe.diagnose(model, campaign)", printed)
    before, report, after = typed.partition(found.report())
    assert report
    assert after == ""
    # the command fits the model to the campaign as well, and begins with what that says
    assert before == "" or before.startswith("THE MODEL DOES NOT HOLD on this campaign")


def test_report_of_a_diagnosis(diagnosed: tuple[abbe.Diagnosis, str, str]) -> None:
    found, printed, _ = diagnosed
    typed = re.sub(
        r"abbe add \S+ (.*?) --campaign \S+ -o \S+", r"abbe.add_effect(model, '\1')", printed
    )
    assert typed != printed
    assert found.report() == typed


@pytest.mark.parametrize("which", ["fitted", "compared", "diagnosed"])
def test_plot_draws_what_the_page_shows(which: str, request: pytest.FixtureRequest) -> None:
    found, _, page = request.getfixturevalue(which)
    shown = figures_of(page)
    mine = {n: as_on_a_page(make()) for n, make in found.figures().items()}
    assert len(mine) > 3
    assert [name for name, figure in mine.items() if figure not in shown] == []
    # and Plotly's object says the same
    name = found.pictures[-1]
    made = found.plot(name)
    assert type(made).__name__ == "Figure"
    assert len(made.data) == len(mine[name]["data"])
    for trace, data in zip(made.data, mine[name]["data"], strict=True):
        assert list(trace.y) == pytest.approx(data["y"], nan_ok=True)


def as_on_a_page(figure: Any) -> Any:
    return _finite(json.loads(json.dumps(figure, default=_lists)))


def _lists(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def _finite(value: Any) -> Any:
    """What is not finite is null on a page."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def test_the_first_picture_where_none_is_named(fitted: tuple[abbe.FitResult, str, str]) -> None:
    assert fitted[0].plot() == fitted[0].plot("error motions of X")


def test_no_such_picture(fitted: tuple[abbe.FitResult, str, str]) -> None:
    with pytest.raises(abbe.InputError, match="no such picture.*expected.*error map"):
        fitted[0].plot("error mop")


@pytest.mark.parametrize("which", ["fitted", "compared", "diagnosed"])
def test_short_in_a_console_and_a_table_in_a_notebook(
    which: str, request: pytest.FixtureRequest
) -> None:
    found, _, _ = request.getfixturevalue(which)
    assert re.fullmatch(r"<(FitResult|Comparison|Diagnosis): .{10,250}>", repr(found))
    html = found._repr_html_()
    assert html.startswith("<p><b>")
    assert html.count("<tr>") >= 2


def test_model_in_a_console_and_a_notebook(fitted: tuple[abbe.FitResult, str, str]) -> None:
    start, model = abbe.load_model(MODEL), fitted[0].model
    assert repr(start) == "<Model: held-out, w X' b Y Z t, 24 effects, not fitted>"
    assert repr(model) == "<Model: held-out, w X' b Y Z t, 24 effects with 150 parameters>"
    assert model._repr_html_().count("<tr>") == 25


def test_parameters_as_a_data_frame(fitted: tuple[abbe.FitResult, str, str]) -> None:
    table = fitted[0].to_pandas().set_index(["effect", "parameter"])
    assert len(table) == 150
    row = table.loc[("squareness axes=X,Y", "angle")]
    (term,) = (t for t in fitted[0].model.terms if t.effect.spec == "squareness axes=X,Y")
    assert row["value"] == pytest.approx(term.values["angle"].value * 1e6)
    assert row["unit"] == "µrad"


def test_residuals_beside_the_campaigns_rows(compared: tuple[abbe.Comparison, str, str]) -> None:
    table = compared[0].to_pandas()
    assert len(table) == compared[0].problem.n
    lengths = table[table["kind"] == "displacement"]
    assert np.sqrt((lengths["residual"] ** 2).mean()) == pytest.approx(compared[0].lengths.rms)
    assert {"X", "s_X", "T_x", "tool_z", "setup", "u_z", "value", "sd", "line"} <= {*table.columns}


def test_without_pandas(
    fitted: tuple[abbe.FitResult, str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    genuine: Callable[..., Any] = builtins.__import__

    def without(name: str, *more: Any) -> Any:
        if name == "pandas":
            raise ImportError(name)
        return genuine(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(abbe.AbbeError, match=r"to_pandas\(\) needs pandas: pip install pandas"):
        fitted[0].to_pandas()


def test_results_are_made_without_plotly_and_pandas() -> None:
    code = (
        "import sys, abbe\n"
        f"model = abbe.load_model({str(MODEL)!r})\n"
        f"abbe.fit(model, abbe.read_campaigns([{str(DAY2)!r}], model.machine)).report()\n"
        "print(sorted({'plotly', 'pandas', 'IPython'} & {*sys.modules}))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
