"""Columns of what a measurement saw beside the signals: where it did not, they are blank."""

from dataclasses import replace

import pytest

from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, require_signals
from abbe.compcore.files.growing_campaign import GrowingCampaign
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term

MACHINE = Machine("m", Structure.parse("w b X t"), {"X": Axis("X", (0.0, 500.0))})
DECLARED = replace(MACHINE, signals={"feed": Signal("feed", "mm/min", "speed")})
FIRST = ("time", "setup", "kind", "X", "X_dir", "ux", "uy", "uz", "value", "sd")
COLUMNS = (*FIRST, "feed")
BEGUN = {"plan_sha256": "a"}


def head(**more):
    return {
        "format": "abbe-campaign/1",
        "measured": {**BEGUN, **more},
        "setups": {"s": {"free": ["zero"]}},
    }


def row(x, feed):
    return {"time": x, "setup": "s", "kind": "displacement", "X": x, "X_dir": 1.0, "ux": 1.0,
            "uy": 0.0, "uz": 0.0, "value": 1.0, "sd": 0.3, "feed": feed}  # fmt: skip


def written(path, feeds, columns=COLUMNS, **more):
    file = GrowingCampaign.begin(path, head(**({"seen": ["feed"]} | more)), columns)
    file.append([row(10.0 * k, feed) for k, feed in enumerate(feeds)])
    file.close()
    return path


def test_undeclared_it_is_no_signal_and_read_by_nothing(tmp_path):
    one = read_campaign(written(tmp_path / "a.csv", [1980.0, None, 2010.0]), MACHINE)
    two = read_campaign(written(tmp_path / "b.csv", [None] * 3, FIRST), MACHINE)
    assert one.conditions.signals == two.conditions.signals == {}
    assert one.unseen == {}
    assert (one.value == two.value).all()


def test_declared_and_seen_everywhere_it_is_a_signal(tmp_path):
    found = read_campaign(written(tmp_path / "a.csv", [1980.0, 2010.0]), DECLARED)
    assert found.conditions.signals["feed"].tolist() == [1980.0, 2010.0]


def test_an_effect_that_needs_it_refuses_the_first_row_without(tmp_path):
    path = written(tmp_path / "a.csv", [1980.0, None, 2010.0])
    found = read_campaign(path, DECLARED)
    assert found.conditions.signals == {}
    lag = make_effect("feed_lag", {"axis": "X", "signal": "feed"})
    model = Model(DECLARED, (Term(lag),))
    line = 2 + path.read_text().splitlines().index(",".join(COLUMNS)) + 1
    whole = read_campaign(written(tmp_path / "b.csv", [1.0, 2.0]), DECLARED)
    for campaign in (found, join_campaigns([whole, found])):
        with pytest.raises(InputError, match="not seen here, and the effect 'feed_lag") as raised:
            require_signals(campaign, model)
        assert f"a.csv, line {line}, field 'feed'" in str(raised.value)
        assert "a blank cell" in str(raised.value)
    require_signals(whole, model)


def test_a_text_in_it_and_a_blank_in_a_signal_are_refused(tmp_path):
    path = written(tmp_path / "a.csv", [1980.0, "fast"])
    with pytest.raises(InputError, match="field 'feed': not a number: found 'fast'"):
        read_campaign(path, MACHINE)
    path = written(tmp_path / "b.csv", [1980.0, None], seen=["feed_turn"])
    with pytest.raises(InputError, match="field 'feed': a blank cell"):
        read_campaign(path, MACHINE)


def test_what_an_earlier_version_began_goes_on_with_its_own_columns(tmp_path):
    path = written(tmp_path / "a.csv", [1.0], FIRST)
    file = GrowingCampaign.resume(path, BEGUN, COLUMNS, MACHINE, newer=("feed",))
    file.append([row(50.0, 1980.0)])
    file.close()
    assert read_campaign(path, MACHINE).n == 2
    assert path.read_text().count("1980") == 0
    with pytest.raises(InputError, match="its columns are not those"):
        GrowingCampaign.resume(path, BEGUN, (*COLUMNS, "T"), MACHINE, newer=("feed",))
