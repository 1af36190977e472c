"""``abbe fit`` and ``abbe compare`` as they are typed."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from abbe.compcore.files.model_file import load_model
from abbe.daemon.application import app
from tests.support.daemon.pages import packed

DATA = Path(__file__).parents[3] / "data"


def run(*arguments: object):
    return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fit") / "model.toml"
    data = DATA / "p02-bridge"
    result = run("fit", data / "model.toml", data / "fit.csv", "-o", out, "--json")
    assert result.exit_code == 0, result.output
    (out.parent / "fit.json").write_text(result.stdout)
    return out


def test_fit_writes_the_model_with_its_provenance(fitted: Path) -> None:
    model = load_model(fitted)
    assert all(term.fitted for term in model.terms)
    alpha = next(t for t in model.terms if t.effect.spec == "scale_expansion axis=X signals=T_x")
    assert alpha.values["alpha"].sd == pytest.approx(2e-7, rel=0.3)
    assert model.covariance is not None
    record = model.fit
    (campaign,) = record["campaigns"]
    assert campaign["file"].endswith("fit.csv")
    assert len(campaign["sha256"]) == 64
    assert record["n"] == 2117
    assert record["rms"] == pytest.approx(0.495, abs=0.01)
    assert record["noise_floor"] == pytest.approx(0.5, abs=0.06)
    assert {"date", "abbe", "chi2_per_dof"} <= record.keys()
    answer = json.loads((fitted.parent / "fit.json").read_text())
    assert answer["chi2_per_dof"] == pytest.approx(1.0, abs=0.06)
    assert answer["determined"] == 126
    assert all(u["convention"] for u in answer["undetermined"])
    assert len(answer["undetermined"]) == 4
    assert answer["effects"][0]["parameters"]["c1"]["unit"] == "mm"


def test_fitting_again_keeps_the_ancestor_in_the_history(fitted: Path, tmp_path: Path) -> None:
    data = DATA / "p02-bridge"
    result = run("fit", fitted, data / "check.csv", "-o", tmp_path / "again.toml")
    assert result.exit_code == 0
    assert "χ² per degree of freedom" in result.output
    (record,) = load_model(tmp_path / "again.toml").history
    assert record["n"] == 2117
    assert record["rms"] == pytest.approx(0.495, abs=0.01)


@pytest.mark.parametrize(("folder", "least"), [("p01-mill", 1.1), ("p03-bridge", 2.0)])
def test_a_hidden_effect_shows_in_chi_square(folder: str, least: float, tmp_path: Path) -> None:
    data = DATA / folder
    out = tmp_path / "model.toml"
    answer = json.loads(
        run("fit", data / "model.toml", data / "fit.csv", "-o", out, "--json").stdout
    )
    assert answer["chi2_per_dof"] > least


def test_compare_tells_what_formats_promise(fitted: Path) -> None:
    result = run("compare", fitted, DATA / "p02-bridge" / "check.csv", "--json")
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    assert answer["unit"] == "um"
    assert answer["rms"] == pytest.approx(0.54, abs=0.03)
    assert answer["rms"] < answer["p95"] < answer["max"]
    assert answer["noise_floor"] == pytest.approx(0.59, abs=0.1)
    assert 0.95 < answer["chi2_per_dof"] < 1.25
    assert answer["n"] == sum(s["n"] for s in answer["setups"])
    assert {"setup", "n", "rms", "max"} <= answer["setups"][0].keys()
    worst = [abs(w["residual"]) for w in answer["worst"]]
    assert worst == sorted(worst, reverse=True)
    assert worst[0] == pytest.approx(answer["max"])
    assert {r["axis"] for r in answer["regions"]} == {"X", "Y", "Z"}
    assert answer["rotation"]["n"] == 0
    assert answer["rotation"]["rms"] is None


def test_rotations_stand_apart_in_microradians(fitted: Path) -> None:
    answer = json.loads(run("compare", fitted, DATA / "p02-bridge" / "fit.csv", "--json").stdout)
    assert answer["n"] + answer["rotation"]["n"] == 2117
    assert answer["rotation"]["unit"] == "urad"
    assert answer["rotation"]["rms"] == pytest.approx(0.51, abs=0.03)
    assert answer["chi2_per_dof"] == pytest.approx(1.0, abs=0.06)


def test_reports_are_one_file_that_fetches_nothing(fitted: Path, tmp_path: Path) -> None:
    data = DATA / "p02-bridge"
    page = tmp_path / "compare.html"
    assert run("compare", fitted, data / "check.csv", "--report", page).exit_code == 0
    text = page.read_text(encoding="utf-8")
    assert text.count("data-plot") >= 10
    assert "scatter3d" in packed(text, "figures")
    assert '<script src="' not in text
    fit_page = tmp_path / "fit.html"
    out = tmp_path / "m.toml"
    arguments = ("fit", data / "model.toml", data / "fit.csv", "-o", out, "--report", fit_page)
    assert run(*arguments).exit_code == 0
    assert "are the same thing for this campaign" in fit_page.read_text(encoding="utf-8")


def test_a_signal_that_is_not_recorded_is_named(fitted: Path, tmp_path: Path) -> None:
    lines = (DATA / "p02-bridge" / "check.csv").read_text().replace(",T_x,", ",T_other,")
    (tmp_path / "c.csv").write_text(lines)
    from abbe.compcore.errors import InputError

    with pytest.raises(InputError, match="T_x"):
        run("compare", fitted, tmp_path / "c.csv")


def test_a_wrong_frame_writes_nothing(tmp_path: Path) -> None:
    from abbe.compcore.errors import InputError

    data = DATA / "p02-bridge"
    out = tmp_path / "m.toml"
    with pytest.raises(InputError, match="reference frame"):
        run("fit", data / "model.toml", data / "fit.csv", "-o", out, "--frame", "Q")
    assert not out.exists()
