"""A campaign that grows: whole rows on the disk, torn ones cut, nobody else's added to."""

import os
import resource
import subprocess
import sys

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.growing_campaign import GrowingCampaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure

MACHINE = Machine("m", Structure.parse("w b X t"), {"X": Axis("X", (0.0, 500.0))})
COLUMNS = ("time", "setup", "kind", "X", "X_dir", "ux", "uy", "uz", "value", "sd")
BEGUN = {"plan_sha256": "a", "configuration_sha256": "b"}
HEAD = {
    "format": "abbe-campaign/1",
    "machine": "Fräse, rechts",
    "measured": BEGUN,
    "setups": {"s": {"free": ["zero"]}},
}


def row(x, value=1.25, setup="s"):
    return {"time": x, "setup": setup, "kind": "displacement", "X": x, "X_dir": 1.0,
            "ux": 1.0, "uy": 0.0, "uz": 0.0, "value": value, "sd": 0.3}  # fmt: skip


def begin(path):
    return GrowingCampaign.begin(path, HEAD, COLUMNS)


def resume(path, begun=BEGUN):
    return GrowingCampaign.resume(path, begun, COLUMNS, MACHINE)


def test_what_was_added_is_a_campaign(tmp_path):
    path = tmp_path / "c.csv"
    file = begin(path)
    file.append([row(0.0), row(50.0, -0.5)])
    found = read_campaign(path, MACHINE)
    assert found.value.tolist() == pytest.approx([1.25e-3, -0.5e-3])
    assert found.setups["s"].free == ("zero",)
    assert found.metadata[0]["machine"] == "Fräse, rechts"
    file.declare("s.2", ["zero", "slope"])
    file.append([row(100.0, 0.0, "s.2")])
    found = read_campaign(path, MACHINE)
    assert found.n == 3
    assert found.setups["s.2"].free == ("zero", "slope")


def test_a_disk_without_room_is_said_without_the_file_s_name_twice(tmp_path, monkeypatch):
    file = begin(tmp_path / "c.csv")

    def full(path, text):
        raise InputError("cannot be written: No space left on device", file=path)

    monkeypatch.setattr("abbe.compcore.files.growing_campaign.write_atomically", full)
    with pytest.raises(OSError, match="No space") as raised:
        file.declare("s.2", ["zero"])
    assert raised.value.strerror == "No space left on device"


def test_another_zero_that_was_noticed_afterwards(tmp_path):
    path = tmp_path / "c.csv"
    file = begin(path)
    file.append([row(0.0), row(50.0), row(100.0), row(150.0)])
    file.declare("s.2", ["zero"], {"s": [50.0, 150.0]})
    file.append([row(200.0, 0.0, "s.2"), row(250.0, 0.0, "s.2")])
    file.declare("s.3", ["zero"], {"s.2": [250.0], "s": [100.0]})
    file.append([row(300.0, 0.0, "s.3")])
    file.close()
    found = read_campaign(path, MACHINE)
    assert found.conditions.setup.tolist() == [
        "s", "s.1-2", "s.1-3", "s.1-4", "s.2", "s.2-2", "s.3",
    ]  # fmt: skip
    assert all(setup.free == ("zero",) for setup in found.setups.values())
    # written again and gone on with, nothing of it is lost
    write_campaign(found, tmp_path / "again.csv")
    again = read_campaign(tmp_path / "again.csv", MACHINE)
    assert again.conditions.setup.tolist() == found.conditions.setup.tolist()
    assert len(resume(path).rows) == 7


def test_it_goes_on_after_the_last_whole_row(tmp_path):
    path = tmp_path / "c.csv"
    file = begin(path)
    file.append([row(0.0)])
    file.append([row(50.0)])
    file.close()
    whole = path.read_bytes()
    path.write_bytes(whole + b"100,s,displ")  # the power failed here
    file = resume(path)
    assert [r["X"] for r in file.rows] == ["0", "50"]
    assert path.read_bytes() == whole
    file.append([row(100.0)])
    assert read_campaign(path, MACHINE).conditions.positions["X"].tolist() == [0.0, 50.0, 100.0]


def test_rows_of_a_target_that_was_not_whole_are_cut(tmp_path):
    path = tmp_path / "c.csv"
    file = begin(path)
    file.append([row(0.0), row(50.0)])
    file.close()
    file = resume(path)
    file.cut(1)
    file.append([row(75.0)])
    assert read_campaign(path, MACHINE).conditions.positions["X"].tolist() == [0.0, 75.0]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t.replace('plan_sha256 = "a"', 'plan_sha256 = "z"'), "another plan"),
        (lambda t: t.replace('configuration_sha256 = "b"', 'configuration_sha256 = "z"'),
         "another configuration"),
        (lambda t: t.replace("# [measured]", "# [other]"), "did not begin it"),
        (lambda t: t.replace("X_dir", "X_way", 1), "columns"),
        (lambda t: t.replace("1.25", "1,25"), "too many fields"),
        (lambda t: t.replace("1.25", "nan"), "value"),
        (lambda t: "X,Y\n1,2\n", "did not begin it"),
    ],
)  # fmt: skip
def test_a_file_that_was_not_begun_so_is_left_alone(tmp_path, change, says):
    path = tmp_path / "c.csv"
    file = begin(path)
    file.append([row(0.0)])
    file.close()
    path.write_text(change(path.read_text("utf-8")), encoding="utf-8")
    before = path.read_bytes()
    with pytest.raises(InputError) as refused:
        resume(path)
    assert says in str(refused.value)
    assert path.read_bytes() == before


def test_nothing_is_begun_over_something(tmp_path):
    path = tmp_path / "c.csv"
    path.write_text("mine")
    with pytest.raises(InputError, match="there already"):
        begin(path)
    assert path.read_text() == "mine"


FULL = """
import resource, sys
from pathlib import Path
from tests.compcore.files.test_growing_campaign import begin, row
path = Path(sys.argv[1])
file = begin(path)
file.append([row(0.0)])
size = path.stat().st_size
resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, resource.RLIM_INFINITY))
try:
    file.append([row(50.0)])
except OSError as error:
    print(path.stat().st_size - size)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
file.append([row(50.0)])
"""


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no limit of size")
def test_a_disk_that_is_full_in_the_middle_of_a_row_leaves_no_part_of_it(tmp_path):
    path = tmp_path / "c.csv"
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)],
        capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": "."},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "0"
    assert read_campaign(path, MACHINE).conditions.positions["X"].tolist() == [0.0, 50.0]
