"""The rule of steps against waves that are sampled and joined here by straight lines."""

import json
import math

import numpy as np
import pytest

from abbe.compcore.campaign.sampling import (
    alias,
    amplitude_held,
    resolves,
    samplings,
    step_for,
)
from tests.support.compcore.campaign_texts import read_text
from tests.support.daemon.command_line import abbe

WAVE = 10.0
FINE = 400


def joined(step, wave, phase):
    """A wave read every step and joined by straight lines, over a whole number of both."""
    count = math.lcm(round(step * 1000), round(wave * 1000)) // round(step * 1000)
    nodes = step * np.arange(count * 4 + 1)
    q = np.arange(0, nodes[-1], step / FINE)
    return q, np.interp(q, nodes, np.cos(2 * np.pi * nodes / wave + phase))


@pytest.mark.parametrize("step", [1.0, 2.0, 2.5, 4.0, 4.5])
def test_the_part_of_the_amplitude_that_straight_lines_hold(step):
    """The Fourier coefficient of the joined line at the wave itself, by summation here."""
    for phase in (0.0, 0.7, 2.0):
        q, line = joined(step, WAVE, phase)
        seen = 2 * np.mean(line * np.exp(-2j * np.pi * q / WAVE))
        assert amplitude_held(step, WAVE) == pytest.approx(abs(seen), abs=2e-4)
        assert np.angle(seen) == pytest.approx(phase, abs=1e-2)


@pytest.mark.parametrize(
    ("step", "expected"), [(9.0, 90.0), (11.0, 110.0), (6.0, 15.0), (8.0, 40.0), (4.0, 10.0)]
)
def test_an_alias_passes_through_the_same_readings(step, expected):
    """A 10 mm screw read every 9 mm shows a wave of 90 mm: the same numbers at every reading."""
    found = alias(step, WAVE)
    assert found == pytest.approx(expected)
    at = step * np.arange(200)
    one = np.cos(2 * np.pi * at / WAVE)
    np.testing.assert_allclose(np.cos(2 * np.pi * at / found), one, atol=1e-9)
    assert resolves(step, WAVE) == (found == pytest.approx(WAVE))


def test_steps_of_the_screw_s_turn_show_nothing():
    assert alias(10.0, WAVE) == alias(50.0, WAVE) == math.inf
    assert not resolves(5.0, WAVE), "at half the wave the amplitude depends on the phase"
    assert amplitude_held(5.0, WAVE) == 0.0
    assert amplitude_held(4.999, WAVE) == pytest.approx((2 / math.pi) ** 2, abs=1e-3)


@pytest.mark.parametrize("held", [0.5, 0.8, 0.9, 0.99])
def test_the_longest_step_that_holds_so_much(held):
    step = step_for(WAVE, held)
    assert amplitude_held(step, WAVE) == pytest.approx(held, abs=1e-9)
    assert amplitude_held(1.001 * step, WAVE) < held


HEAD = '# format = "abbe-campaign/1"\ntime,setup,kind,X,Y,Z,ux,uy,uz,value\n'


def campaign(tmp_path, lines):
    rows = [
        f"{i},{setup},displacement,{x},{y},0,1,0,0,0"
        for setup, places in lines.items()
        for i, (x, y) in enumerate(places)
    ]
    return read_text(tmp_path, HEAD + "\n".join(rows) + "\n")


def test_what_a_campaign_cannot_see(tmp_path):
    """X every 50 mm there and back, and every 20 on a part; Y by uneven steps of 30 on average."""
    uneven = (0.0, 22.0, 61.0, 88.0, 120.0)
    found = samplings(
        campaign(
            tmp_path,
            {
                "x": [(50 * i, 5) for i in [*range(9), *range(8, -1, -1)]],
                "fine": [(100 + 20 * i, 5) for i in range(6)],
                "y": [(100, y) for y in uneven],
                "diagonal": [(3 * i, 2 * i) for i in range(20)],
            },
        )
    )
    x, y = found
    assert (x.axis, x.step, x.even, x.setup) == ("X", 20.0, True, "fine")
    assert x.shortest == 40.0
    assert (y.axis, y.step, y.even) == ("Y", 30.0, False)
    assert "cannot see a wave shorter than 40 mm along it; one looks like a longer one" in str(x)
    assert "on average every 30 mm" in str(y)


def test_a_known_wave_that_the_steps_hide(tmp_path):
    """A screw of 10 mm read every 9 mm, and every 50 mm; one of 25 mm is seen every 9 mm."""
    (fine,) = samplings(campaign(tmp_path, {"x": [(9 * i, 5) for i in range(9)]}))
    assert fine.hidden(10.0) == "a wave of 10 mm along X looks like one of 90 mm in them"
    assert fine.hidden(25.0) is None
    (coarse,) = samplings(campaign(tmp_path, {"x": [(50 * i, 5) for i in range(9)]}))
    assert coarse.hidden(10.0) == "a wave of 10 mm along X looks like a constant in them"


def test_compare_says_it_of_the_model_s_own_screw(tmp_path):
    (tmp_path / "m.toml").write_text(
        'format = "abbe-model/1"\n[machine]\nname = "M"\nstructure = "w b X t"\n'
        '[machine.axes.X]\ntravel = [0.0, 900.0]\n[[effects]]\nkind = "cyclic"\naxis = "X"\n'
        'period = 10.0\n[effects.parameters.A1]\nvalue = 0.002\nunit = "mm"\n'
        '[effects.parameters.B1]\nvalue = 0.0\nunit = "mm"\n'
    )
    rows = [f"{i},x,displacement,{9 * i},1,0,0,{2 * math.cos(1.8 * math.pi * i):.6f}"
            for i in range(30)]  # fmt: skip
    head = '# format = "abbe-campaign/1"\ntime,setup,kind,X,ux,uy,uz,value\n'
    (tmp_path / "c.csv").write_text(head + "\n".join(rows) + "\n")
    done = abbe("compare", tmp_path / "m.toml", tmp_path / "c.csv")
    assert done.status == 0, done.err
    assert "X is read every 9 mm at best" in done.out
    assert "a wave of 10 mm along X looks like one of 90 mm in them" in done.out
    found = json.loads(abbe("compare", tmp_path / "m.toml", tmp_path / "c.csv", "--json").out)
    assert found["sampling"] == [
        {"axis": "X", "setup": "x", "even": True, "unit": "mm", "step": 9, "shortest_wave": 18}
    ]


def test_scattered_places_have_no_step(tmp_path):
    rng = np.random.default_rng(1)
    places = rng.uniform(0.0, 500.0, (50, 2)).tolist()
    assert samplings(campaign(tmp_path, {"all": places})) == ()
