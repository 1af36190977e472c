"""plan.toml: written and read back; what is wrong in one is named with file, line and field."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.plan_file import read_plan, write_plan
from abbe.compcore.planning.envelope import KeepOut, WorkingSpace
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.plan import plan_survey
from tests.support.compcore.survey_machines import task

AIM = replace(
    task("rotary table", "polynomial:1"),
    space=WorkingSpace((KeepOut((0.0, 0.0, -900.0), (30.0, 30.0, -800.0)),), 10.0),
    tools={"T1": (0.0, 0.0, -120.0), "long": (0.0, 0.0, -200.0)},
)


@pytest.fixture(scope="module")
def plan():
    return plan_survey(AIM, instruments_called(["laser", "angle", "tracker", "r-test"]), 9000.0)


@pytest.fixture
def written(plan, tmp_path):
    path = tmp_path / "plan.toml"
    write_plan(plan, path, 'a "model" µ.toml')
    return path


def test_what_is_written_is_read_back(plan, written):
    found = read_plan(written, AIM.machine)
    assert found.model == 'a "model" µ.toml'
    assert found.warm_up == plan.warm_up
    assert found.tools == AIM.tools
    assert found.space == AIM.space
    assert len(found.setups) == len(plan.steps)
    kinds = set()
    for step, setup in zip(plan.steps, found.setups, strict=True):
        kinds.add(setup.kind)
        for key in ("name", "what", "axis", "kind", "free", "tool", "offset", "runs", "both_ways",
                    "base", "optics", "instrument"):  # fmt: skip
            one, two = getattr(step.setup, key), getattr(setup, key)
            if key in ("base", "optics"):
                one, two = (
                    str(np.round(list((one or {}).values() if key == "optics" else one or ()), 3)),
                    str(np.round(list((two or {}).values() if key == "optics" else two or ()), 3)),
                )
            assert one == two, key
        np.testing.assert_allclose(setup.sd, step.setup.sd, rtol=1e-6)
        np.testing.assert_allclose(setup.u, step.setup.u, atol=1e-6)
        for axis, at in step.setup.targets.items():
            np.testing.assert_allclose(setup.targets[axis], at, atol=2e-6 * 1e3)
        assert setup.seconds == pytest.approx(step.setup.seconds, rel=1e-4)
    assert len(kinds) > 1


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('format = "abbe-plan/1"', 'format = "abbe-plan/2"', "format"),
        ("structure = \"w C' Y' b X Z (C) t\"", 'structure = "w b X Y Z t"', "another machine"),
        ("warm_up = 60", "warm_up = nan", "warm_up"),
        ("runs = ", "runs = 10", "runs"),
        ("runs = ", "laps = ", "laps"),
        ('tool = "T1"', 'tool = "T9"', "no such tool"),
        ('instrument = "', 'instrument = "x', "no such instrument"),
        ("targets = [\n  [", "targets = [\n  [1, ", "each axis"),
        ("targets = [\n  [", "targets = [\n  [99999", "travel"),
        ("sd = [", "sd = [0, ", "sd"),
        ('free = ["', 'free = ["all", "', "free"),
        ("beyond = 2", "beyond = 0", "beyond"),
        ("low = [", "low = [1, ", "low"),
        ('kind = "', 'kind = "about_', "kind"),
    ],
)
def test_what_is_wrong_is_named(written, old, new, says):
    text = written.read_text("utf-8")
    assert old in text
    written.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(InputError) as refused:
        read_plan(written, AIM.machine)
    assert says in str(refused.value)
    assert "plan.toml, line" in str(refused.value)


def test_a_plan_for_a_machine_of_the_same_structure_and_another_name_is_refused(written):
    text = written.read_text("utf-8")
    own = f'machine = "{AIM.machine.name}"'
    assert own in text
    written.write_text(text.replace(own, 'machine = "the one beside it"'), "utf-8")
    with pytest.raises(InputError, match="another machine") as refused:
        read_plan(written, AIM.machine)
    assert refused.value.field == "machine"
    written.write_text(text.replace(own, 'machine = ""'), "utf-8")
    assert read_plan(written, AIM.machine).setups


def test_a_name_twice_is_refused(written):
    text = written.read_text("utf-8")
    names = [line for line in text.splitlines() if line.startswith("name = ")]
    written.write_text(text.replace(names[1], names[0]), "utf-8")
    with pytest.raises(InputError, match="a name twice"):
        read_plan(written, AIM.machine)


def test_a_way_through_a_box_is_refused(written):
    text = written.read_text("utf-8")
    wide = text.replace("low = [0, 0, -900]", "low = [-900, -900, -900]").replace(
        "high = [30, 30, -800]", "high = [900, 900, 900]"
    )
    assert wide != text
    written.write_text(wide, "utf-8")
    with pytest.raises(InputError, match="keep-out box 1"):
        read_plan(written, AIM.machine)
