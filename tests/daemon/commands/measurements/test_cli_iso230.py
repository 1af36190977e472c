"""``abbe iso230`` as a user runs it."""

import json
import sys

import pytest

from abbe.daemon.cli import main
from tests.support.daemon.pages import packed

HEAD = '# format = "abbe-campaign/1"\ntime,setup,kind,X,Y,X_dir,ux,uy,uz,value\n'
UP = [[0, 1, 2], [3, 4, 5], [6, 6, 6]]
DOWN = [[4, 4, 4], [5, 6, 7], [1, 3, 5]]


@pytest.fixture
def campaign(tmp_path):
    """Three runs each way at three targets; by hand A = 9, R = 8, E = 5, M = 2.5, B = 3 µm."""
    rows = [
        f"{60 * run + i},x_pos,displacement,{100 * i},5,{sense},1,0,0,{table[i][run]}"
        for run in range(3)
        for sense, table in ((1, UP), (-1, DOWN))
        for i in range(3)[::sense]
    ]
    path = tmp_path / "x.csv"
    path.write_text(HEAD + "\n".join(rows) + "\n")
    return path


@pytest.fixture
def abbe(monkeypatch, capsys):
    """Run a command; exit status, standard output, standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["abbe", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main()
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return run


def test_json(abbe, campaign):
    status, out, err = abbe("iso230", campaign, "--json")
    assert (status, err) == (0, "")
    answer = json.loads(out)
    (result,) = answer["positioning"]
    assert result["unit"] == "um"
    found = {name: result[name] for name in ("A", "R", "E", "M", "B")}
    assert found == pytest.approx({"A": 9, "R": 8, "E": 5, "M": 2.5, "B": 3})
    assert [t["position"] for t in result["targets"]] == [0, 100, 200]
    assert [t["repeatability"] for t in result["targets"]] == pytest.approx([5, 6, 8])
    assert answer["diagonals"] == []
    assert answer["squareness"] == []


def test_text(abbe, campaign):
    status, out, _ = abbe("iso230", campaign)
    assert status == 0
    (row,) = (line for line in out.splitlines() if line.startswith("X  x_pos"))
    assert " ".join(row.split()[2:]) == "9.0 7.0 9.0 8.0 4.0 8.0 5.0 5.0 3.0 2.5 3.0 -0.7 µm"
    assert "3 runs towards plus, the standard asks for 5" in out


def test_report(abbe, campaign, tmp_path):
    status, _, _ = abbe("iso230", campaign, "--report", tmp_path / "r.html")
    assert status == 0
    html = (tmp_path / "r.html").read_text()
    assert "Axis X: x_pos" in html
    assert "9.0 <small>µm" in html
    assert html.count("<figure") == 1
    assert '"name":"mean ↑"' in packed(html, "figures")


def test_diagonals(abbe, tmp_path):
    rows = []
    for name, y0, uy in (("a", 0, 0.6), ("b", 300, -0.6)):
        for i in range(6):
            y = y0 + 60 * i * (1 if uy > 0 else -1)
            rows.append(f"0,{name},displacement,{80 * i},{y},1,0.8,{uy},0,{-0.03 * 0.48 * i}")
    (tmp_path / "d.csv").write_text(HEAD + "\n".join(rows) + "\n")
    status, out, _ = abbe("iso230", tmp_path / "d.csv", "--report", tmp_path / "d.html")
    assert status == 0
    assert "+X-Y  b" in out
    assert "X to Y: 90° +0.0 µrad" in out  # both change alike: scale, not squareness
    assert "What the diagonals hint at" in (tmp_path / "d.html").read_text()
    _, out, _ = abbe("iso230", tmp_path / "d.csv", "--json")
    answer = json.loads(out)
    assert [d["direction"] for d in answer["diagonals"]] == ["+X+Y", "+X-Y"]
    assert answer["diagonals"][0]["slope_ppm"] == pytest.approx(-0.144)
    assert answer["E_body"] is None


def test_a_campaign_with_neither_is_named_as_such(abbe, campaign):
    campaign.write_text(campaign.read_text().replace(",1,0,0,", ",0,1,0,"))
    status, out, err = abbe("iso230", campaign)
    assert (status, out) == (1, "")
    assert err.startswith(f"abbe: {campaign}: no set-up measures")
    assert len(err.splitlines()) == 1


def test_wrong_usage(abbe):
    assert abbe("iso230")[0] == 2
