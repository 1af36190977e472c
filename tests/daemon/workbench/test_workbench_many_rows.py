"""More rows than are drawn: all are counted in cells, and a selection counts all of them."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.figures import residuals
from abbe.daemon.workbench.residuals.brush import Brush, BrushedBox, BrushedGroup, BrushedSpace
from abbe.daemon.workbench.session.workbench import Workbench

pytestmark = pytest.mark.timeout(300)

BRIDGE = Path(__file__).parents[2] / "data" / "p03-bridge"
FEW = 600


def compared() -> tuple[Workbench, dict[str, Any]]:
    bench = Workbench(BRIDGE / "model.toml", [BRIDGE / "fit.csv"])
    pause = threading.Event()
    while bench.state()["task"] is not None:
        pause.wait(0.02)
    page = bench.findings.compared
    assert page is not None
    found: dict[str, Any] = json.loads(page)
    return bench, found


@pytest.fixture(scope="module")
def whole() -> tuple[Workbench, dict[str, Any]]:
    """Every row drawn: the truth."""
    return compared()


@pytest.fixture(scope="module")
def many() -> tuple[Workbench, dict[str, Any]]:
    """The same campaign, as if it had more rows than are drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residuals, "MOST_POINTS", FEW)
        patch.setattr(residuals, "_LARGEST", 50)
        return compared()


def drawn(page: dict[str, Any], panel: dict[str, Any]) -> tuple[Any, Any, Any, Any]:
    """Places in the arrays, what lies across, residual, side of the rows that a picture has."""
    rows = page["rows"]
    value, part = np.array(page["values"]), np.array(rows["part"])
    own = part == panel["part"]
    if "measured" in panel:
        own &= np.array(rows["measured"]) == panel["measured"]
    side = np.zeros(len(own), dtype=int)
    if panel["by"] == "axis":
        axis = rows["axes"][panel["axis"]]
        at, side = np.array(axis["at"]), np.array(axis["side"])
    elif panel["by"] == "signal":
        at = np.array(rows["signals"][panel["signal"]]["at"])
    else:
        at = np.array(rows["time"] if panel["by"] == "time" else rows["setup"], dtype=float)
    index = np.flatnonzero(own)
    return index, at[index], value[index], side[index]


def test_every_row_is_counted_where_it_lies(whole: Any, many: Any) -> None:
    (_, all_rows), (_, some) = whole, many
    assert all_rows["cells"] is None
    assert some["rows"]["part"].count(0) == FEW < all_rows["rows"]["part"].count(0)
    assert len(some["cells"]) == len(some["panels"]) > 8
    size, part = np.abs(all_rows["values"]), np.array(all_rows["rows"]["part"])
    for panel, cells in zip(some["panels"], some["cells"], strict=True):
        _, at, value, side = drawn(all_rows, panel)
        reach = 1.05 * size[part == panel["part"]].max()
        assert cells["n"] == sum(cells["count"]) == len(at)
        low, high = cells["ends"]
        assert low < at.min() < at.max() < high
        cell = np.cumsum(cells["cell"])
        across, up = cells["across"], cells["up"]
        for k, way in enumerate((0, 1, -1)):
            mine = side == way
            edges = [np.linspace(low, high, across + 1), np.linspace(-reach, reach, up + 1)]
            true = np.histogram2d(at[mine], value[mine], bins=edges)[0].T[::-1]
            found = np.zeros(across * up)
            inside = cell // (across * up) == k
            found[cell[inside] % (across * up)] = np.array(cells["count"])[inside]
            # what lies on an edge, rounded as it was sent, may be counted beside it
            off = np.abs(found.reshape(up, across) - true).sum()
            assert off <= 0.04 * mine.sum() + 4, panel["title"]
            if mine.sum() >= 6 and cells["means"][k]:
                points = np.array(cells["means"][k])
                assert points[:, 1].min() >= value[mine].min()
                assert points[:, 1].max() <= value[mine].max()


def test_means_are_drawn_where_there_are_any(many: Any) -> None:
    """The bridge's lines go up and down more than chance does; set-ups have no order."""
    _, some = many
    drawn_ = {p["by"]: [] for p in some["panels"]}  # type: ignore[var-annotated]
    for panel, cells in zip(some["panels"], some["cells"], strict=True):
        drawn_[panel["by"]].append(any(cells["means"]))
    assert any(drawn_["axis"])
    assert not any(drawn_["setup"])


def test_a_box_chooses_among_all_rows(whole: Any, many: Any) -> None:
    (_, all_rows), (bench, some) = whole, many
    panel = some["panels"][0]
    index, at, value, _ = drawn(all_rows, panel)
    x = [float(np.quantile(at, 0.2)) + 0.01, float(np.quantile(at, 0.7)) + 0.01]
    # rounded as they were sent: nothing lies so near an end
    y = [0.00005, float(value.max()) + 1.0]
    box = BrushedBox(panel=0, x=x[::-1], y=y)
    found = bench.findings.brushed(Brush(box=box, panels=list(range(len(some["panels"])))))
    inside = index[(at >= x[0]) & (at <= x[1]) & (value >= y[0]) & (value <= y[1])]
    chosen = np.array(all_rows["values"])[inside]
    assert found["n"] == len(inside) > 30
    assert found["parts"][1] is None
    assert found["parts"][0] == pytest.approx(
        {"n": len(inside), "rms": np.sqrt(np.mean(chosen**2)), "mean": chosen.mean()}, abs=1e-3
    )
    rows, setups = all_rows["rows"], all_rows["rows"]["setups"]
    names = {setups[rows["setup"][i]] for i in inside}
    assert set(found["setups"]["most"]) <= names
    assert len(found["setups"]["most"]) + found["setups"]["more"] == len(names)
    # those among the rows that are drawn one by one
    wanted = {rows["row"][i] for i in inside}
    assert {some["rows"]["row"][k] for k in found["rows"]} == wanted & set(some["rows"]["row"])
    for k, other in enumerate(some["panels"]):
        counted = found["panels"][k]
        shared = np.intersect1d(drawn(all_rows, other)[0], inside)
        assert counted["n"] == sum(counted["count"]) == len(shared), other["title"]


def test_a_row_of_a_table_chooses_as_many_as_it_says(many: Any) -> None:
    bench, some = many
    told = 0
    for table, each in enumerate(some["tables"]):
        for row, cells in enumerate(each["cells"]):
            group = BrushedGroup(table=table, row=row)
            found = bench.findings.brushed(Brush(group=group))
            if "row" in each["select"][row]:
                assert found["n"] == 1
            elif "tool" not in each["select"][row]:
                assert found["n"] == int(cells[1]), each["title"]
                told += 1
    assert told > 20


def test_a_box_in_the_volume(whole: Any, many: Any) -> None:
    (_, all_rows), (bench, _) = whole, many
    place = np.array(all_rows["rows"]["place"]).reshape(-1, 3)
    along = np.array(all_rows["rows"]["along"]).reshape(-1, 3)
    lengths = np.array(all_rows["rows"]["part"]) == 0
    middle = np.median(place[:, 0]) + 0.123
    space = {"part": 0, "right": [1, 0, 0, 5], "up": [0, 0, 2, 0], "y": [-1e6, 1e6]}
    feet = BrushedSpace.model_validate({**space, "long": 0, "x": [-1e6, middle + 5]})
    found = bench.findings.brushed(Brush(space=feet))
    assert found["n"] == int((lengths & (place[:, 0] <= middle)).sum()) > 50
    heads = BrushedSpace.model_validate({**space, "long": 1000, "x": [middle + 5, 1e6]})
    head = place[:, 0] + along[:, 0] * 1000.0 * np.array(all_rows["values"])
    true = int((lengths & ((place[:, 0] >= middle) | (head >= middle))).sum())
    assert bench.findings.brushed(Brush(space=heads))["n"] == pytest.approx(true, abs=2)


def test_what_is_not_there_is_refused(whole: Any, many: Any) -> None:
    bench, some = many
    box = BrushedBox(panel=len(some["panels"]), x=[0, 1], y=[0, 1])
    for asked, said in (
        (Brush(box=box), "no such picture"),
        (Brush(group=BrushedGroup(table=0, row=0), panels=[-1]), "no such picture"),
        (Brush(group=BrushedGroup(table=99, row=0)), "no such row"),
        (Brush(group=BrushedGroup(table=0, row=-1)), "no such row"),
        (Brush(), "nothing is chosen"),
    ):
        with pytest.raises(InputError, match=said):
            bench.findings.brushed(asked)
    with pytest.raises(InputError, match="those that are drawn"):
        whole[0].findings.brushed(Brush(box=box))
