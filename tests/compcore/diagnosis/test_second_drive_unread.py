"""A length recorded beside an axis may be its second drive's: said, as no campaign shows where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.diagnosis.campaign_notes import second_drives
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging.trial import as_campaign

GANTRY = """format = "abbe-model/1"
[machine]
structure = "w b X Y t"
[machine.axes.X]
travel = [0.0, 900.0]
[machine.axes.Y]
travel = [0.0, 700.0]
[machine.signals.ahead]
unit = "mm"
axis = "X"
"""
HEAD = '# format = "abbe-campaign/1"\n# [setups.l]\n# free = ["zero"]\n'
ROWS = "setup,kind,X,Y,ux,uy,uz,value,ahead\n" + "".join(
    f"l,displacement,{100 * i},350,1,0,0,{i},{0.01 * i}\n" for i in range(8)
)
DRIVES = {"axis": "X", "signal": "ahead", "across": "Y", "master": -100.0, "slave": 800.0}


@pytest.mark.parametrize(("read", "still"), [(False, False), (True, False), (False, True)])
def test_it_is_said_of_one_that_varies_and_is_not_read(read: bool, still: bool) -> None:
    model = parse_model(TomlSource(GANTRY))
    conditions = as_campaign(HEAD + ROWS, model).conditions
    if read:
        model, _ = with_effect(model, "two_drives", DRIVES)
    if still:
        conditions = replace(conditions, signals={"ahead": np.full(conditions.n, 0.01)})
    said = [str(s) for s in second_drives(model, conditions)]
    assert [s.startswith("ahead is a length beside X") for s in said] == [True] * (
        not (read or still)
    )
