"""A controller's own table that another command was given: the one that reads it is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.compcore.files.recognised import recognised
from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[2] / "data" / "controllers"
FILES = {
    "heidenhain-tnc/y.com": "heidenhain-tnc",
    "siemens-840d/nc_cec.ini": "siemens-840d",
    "siemens-840d/ax_eec.ini": "siemens-840d",
    "pmac/comp.pmc": "pmac",
    "fanuc/pitch.txt": "fanuc",
    "aerotech-2d/calibration.cal": "aerotech-2d",
}


@pytest.mark.parametrize(("file", "name"), FILES.items())
def test_the_dialect_is_named(file, name):
    kind = recognised(DATA / file)
    assert kind is not None
    assert kind.dialect == name


def test_the_answer_is_a_command_that_reads_it(tmp_path):
    file = DATA / "heidenhain-tnc" / "y.com"
    told = abbe("iso230", file).err
    assert f"abbe import-grid {file} --controller heidenhain-tnc --structure 'w b Y X Z t'" in told
    done = abbe("import-grid", file, "--controller", "heidenhain-tnc", "--structure",
                "w b Y X Z t", "--travel", "X=0,100", "--travel", "Z=-200,0", "-o",
                tmp_path / "m.toml")  # fmt: skip
    assert done.status == 0, done.err
