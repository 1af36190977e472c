"""Campaigns that say which compensation acted: put back as --active does, each by its own model."""

import hashlib
import shutil

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.answers.inputs import load
from abbe.drivers.simulated.bridge.measure import campaign
from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine
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


def _own(q: np.ndarray) -> np.ndarray:
    """What C errs by, rad."""
    return 8e-5 * np.cos(q) + 3e-5 * np.sin(2.0 * q)


@pytest.mark.parametrize("turns", ["", "C"])
@pytest.mark.parametrize("code", ["w b Z C t", "w C' A' b Z t"])
def test_a_rotary_axis_that_is_compensated_is_put_back_too(tmp_path, code, turns):
    """A calibrator on C while its table acts, and a tilt of Z that no table touches."""
    axes = code.replace("'", "").split()[1:-1]
    axes = [a for a in axes if a != "b"]
    travels = {"Z": "-200, 0", "C": "0, 360", "A": "-30, 30"}
    effects = (
        '[[effects]]\nkind = "rotary_positioning"\naxis = "C"\n'
        "[effects.parameters]\nA1.value = 8e-5\nB1.value = 0.0\n"
        "A2.value = 0.0\nB2.value = 3e-5\n"
    )
    lines = "".join(f"{a} = {{ travel = [{travels[a]}] }}\n" for a in axes)
    model = tmp_path / "m.toml"
    model.write_text(
        f'format = "abbe-model/1"\n[machine]\nname = "m"\nstructure = "{code}"\n[machine.axes]\n'
        f"{lines}{effects}",
        encoding="utf-8",
    )

    def campaign(name: str, acting: bool) -> str:
        exact = ExactMachine(
            code,
            {
                "C": ExactAxis(actual=lambda s: (q := s["C"] - acting * _own(s["C"])) + _own(q)),
                "Z": ExactAxis(error=lambda s: [0, 0, 0, 0, 0, -1e-7 * s["Z"]]),
            },
        )
        digest = hashlib.sha256(model.read_bytes()).hexdigest()
        said = (
            f'# [measured]\n# active = "m.toml"\n# active_sha256 = "{digest}"\n' if acting else ""
        )
        said += f'# active_turns = "{turns}"\n' if acting and turns else ""
        text = f'# format = "abbe-campaign/1"\n{said}time,setup,kind,{",".join(axes)},'
        text += "ux,uy,uz,value,sd\n"
        for k, q in enumerate(np.linspace(0.1, 6.0, 9)):
            at = {"C": q, "Z": -20.0 * k, "A": 0.3}
            # machine axes, as campaigns have them
            about = exact.nominal_pose(at)[:3, :3].T @ exact.orientation_error(at)
            for u in np.eye(3):
                cells = [f"{np.degrees(at[a]) if a != 'Z' else at[a]:.9f}" for a in axes]
                cells += [*map(str, u), f"{1e6 * u @ about:.6f}", "1"]
                text += f"{k},s,rotation,{','.join(cells)}\n"
        (tmp_path / name).write_text(text, encoding="utf-8")
        return text

    campaign("bare.csv", acting=False)
    campaign("acting.csv", acting=True)
    bare = load(model, [tmp_path / "bare.csv"])[1].value
    put_back = load(model, [tmp_path / "acting.csv"])[1].value
    by_hand = load(model, [tmp_path / "acting.csv"], model)[1].value
    assert (put_back == by_hand).all()
    off = np.abs(put_back - bare).max()
    assert off < 2e-8 if turns else off > 5e-5
