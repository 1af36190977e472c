"""What a test campaign shares with the fitted one: the same rows, not the same coarse readings."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.overlap import overlap
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure

HEAD = '# format = "abbe-campaign/1"\n# [setups.pin]\n# free = ["zero"]\n'
COLUMNS = "time,setup,kind,Z,ux,uy,uz,value,T\n"


@pytest.fixture
def machine():
    return Machine(
        "printer",
        Structure.parse("w b Z t"),
        axes={"Z": Axis("Z", (0.0, 300.0))},
        signals={"T": Signal("T", "degC", "structure")},
    )


def homed(tmp_path, machine, name, times, seed):
    """One place, homed again and again: read in steps of 5 µm, temperatures in 0.01 mK."""
    rng = np.random.default_rng(seed)
    errors, warmth = rng.normal(0.0, 2.0, 200), rng.uniform(20.0, 30.0, 200)
    lines = [
        f"{t:.0f},pin,displacement,0,0,0,1,{5 * round(e)},{w:.5f}\n"
        for t, e, w in zip(times, errors, warmth, strict=False)
    ]
    path = tmp_path / f"{name}.csv"
    path.write_text(HEAD + COLUMNS + "".join(lines), encoding="utf-8")
    return read_campaign(path, machine)


def without_signals(campaign: Campaign) -> Campaign:
    return replace(campaign, conditions=replace(campaign.conditions, signals={}))


def test_coarse_readings_of_one_place_are_no_shared_rows(tmp_path, machine):
    fitted = homed(tmp_path, machine, "morning", range(0, 600, 4), 1)
    unseen = homed(tmp_path, machine, "afternoon", range(9000, 9600, 4), 2)
    assert overlap(fitted, unseen).rows == 0
    assert overlap(without_signals(fitted), without_signals(unseen)).rows == 0


def test_rows_that_are_in_both_are_counted(tmp_path, machine):
    fitted = homed(tmp_path, machine, "day", range(0, 600, 4), 1)
    again = homed(tmp_path, machine, "copy", range(0, 400, 4), 1)
    for one, two in ((fitted, again), (without_signals(fitted), without_signals(again))):
        found = overlap(one, two)
        assert (found.rows, found.of) == (100, 100)
        assert found.same


def test_copied_rows_are_found_though_their_clock_began_anew(tmp_path, machine):
    fitted = homed(tmp_path, machine, "day", range(0, 600, 4), 1)
    later = homed(tmp_path, machine, "copy", range(7000, 7600, 4), 1)
    assert overlap(fitted, later).same
