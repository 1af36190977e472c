"""What a test campaign shares with the fitted one: the same rows, not the same coarse readings."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.overlap import SAME_TARGET, met_again, overlap
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


def test_another_run_at_the_same_times_is_no_copy_where_coarse_readings_agree(tmp_path, machine):
    fitted = homed(tmp_path, machine, "monday", range(0, 600, 4), 1)
    unseen = homed(tmp_path, machine, "tuesday", range(0, 600, 4), 2)
    one, two = without_signals(fitted), without_signals(unseen)
    assert np.sum(one.value == two.value) > 10
    assert overlap(one, two).rows == 0
    assert overlap(one, without_signals(homed(tmp_path, machine, "copy", range(0, 600, 4), 1))).same


def test_what_is_met_again_is_what_stands_nearer_than_asked(tmp_path, machine):
    """Beside every distance, one by one: places read once, and places read hundreds of times."""
    rng = np.random.default_rng(4)

    def campaign(name: str) -> Campaign:
        at = np.concatenate([rng.choice([10.0, 80.0], 150), rng.uniform(0.0, 40.0, 50)])
        lines = [f"{i},pin,displacement,{z:.2f},0,0,1,{i},20\n" for i, z in enumerate(at)]
        path = tmp_path / f"{name}.csv"
        path.write_text(HEAD + COLUMNS + "".join(lines), encoding="utf-8")
        return read_campaign(path, machine)

    fitted, unseen = campaign("fitted"), campaign("unseen")
    places, asked = (c.conditions.positions["Z"] for c in (fitted, unseen))
    for most in (1, 8):
        for row, found in enumerate(met_again(fitted, unseen, SAME_TARGET, most)):
            away = np.abs(places - asked[row])
            near = np.sort(away[away <= SAME_TARGET + 1e-9])[:most]
            assert np.sort(away[found]) == pytest.approx(near, abs=1e-12)
            assert len(set(found.tolist())) == len(found)
