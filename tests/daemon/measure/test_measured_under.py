"""Campaigns that say which compensation acted: put back as --active does, each by its own model."""

import hashlib
import shutil

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.answers.inputs import load
from abbe.drivers.simulated.bridge.measure import campaign
from tests.support.daemon.live_run import MODEL


@pytest.fixture
def shop(tmp_path):
    """A model, a campaign that says nothing, and the same one measured under the model."""
    shutil.copy(MODEL, tmp_path / "model.toml")
    shutil.copy(MODEL, tmp_path / "active.toml")
    text = campaign(1, "check")
    (tmp_path / "plain.csv").write_text(text, encoding="utf-8")
    digest = hashlib.sha256(MODEL.read_bytes()).hexdigest()
    said = f'# [measured]\n# active = "active.toml"\n# active_sha256 = "{digest}"\n# [setups.'
    under = text.replace("# [setups.", said, 1).replace("# format", "# # under\n# format", 1)
    (tmp_path / "under.csv").write_text(under, encoding="utf-8")
    return tmp_path


def test_it_is_put_back_as_by_hand(shop):
    model = shop / "model.toml"
    raw = load(model, [shop / "plain.csv"])[1].value
    by_hand = load(model, [shop / "plain.csv"], shop / "active.toml")[1].value
    by_itself = load(model, [shop / "under.csv"])[1].value
    assert np.abs(by_hand - raw).max() > 5e-3
    assert (by_itself == by_hand).all()


def test_of_several_only_those_that_say_so(shop):
    model = shop / "model.toml"
    raw = load(model, [shop / "plain.csv"])[1]
    under = load(model, [shop / "under.csv"])[1]
    both = load(model, [shop / "plain.csv", shop / "under.csv"])[1]
    assert (both.value[: raw.n] == raw.value).all()
    assert (both.value[raw.n :] == under.value).all()


@pytest.mark.parametrize("how", ["gone", "changed"])
def test_a_model_that_is_gone_or_changed_is_refused(shop, how):
    active = shop / "active.toml"
    if how == "gone":
        active.unlink()
    else:
        active.write_text(active.read_text("utf-8") + "# \n", "utf-8")
    with pytest.raises(InputError, match="a compensation was active") as refused:
        load(shop / "model.toml", [shop / "under.csv"])
    assert "under.csv" in str(refused.value)
    assert "--active" in str(refused.value)
