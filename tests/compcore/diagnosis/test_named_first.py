"""One cause in a campaign of its own, by geometry written here: it is named before all others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import Diagnosis, diagnose
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

F64 = NDArray[np.float64]


def turn(vector: F64) -> F64:
    """A rotation by a vector's length about it (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k))


def about(letter: str, angle: float) -> F64:
    return turn(angle * np.eye(3)["XYZ".index(letter)])


Orientation = Callable[[float, float], F64]
"""From the angles of C and B to where the tool truly points."""


def sky(truth: Orientation, seed: int, *, places: int = 80) -> tuple[Model, Campaign]:
    """A mount of two rotary axes and nothing else: two angles across the tool in each place."""
    rng = np.random.default_rng(seed)
    text = """
format = "abbe-model/1"
[machine]
name = "mount"
structure = "w b C B t"
[machine.axes.C]
travel = [-180.0, 180.0]
[machine.axes.B]
travel = [0.0, 90.0]
"""
    rows = ['# format = "abbe-campaign/1"', '# instrument = "autocollimator"']
    rows += ["# [setups.sky]\n# free = []", "time,setup,kind,C,B,ux,uy,uz,value"]
    for i in range(places):
        c, b = rng.uniform(-math.pi, math.pi), rng.uniform(0.1, 1.4)
        nominal = about("Z", c) @ about("Y", b)
        error = truth(c, b) @ nominal.T
        small = 0.5 * np.array(
            [error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]]
        )
        for across in (nominal[:, 0], nominal[:, 1]):
            value = 1e6 * float(across @ small) + rng.normal(0.0, 3.0)
            u = ",".join(f"{x:.9f}" for x in across)
            angles = f"{math.degrees(c):.9f},{math.degrees(b):.9f}"
            rows.append(f"{60 * i},sky,rotation,{angles},{u},{value:.4f}")
    model = parse_model(TomlSource(text))
    return model, as_campaign("\n".join(rows) + "\n", model)


def flexed(pull: F64) -> Orientation:
    """A tube that hangs towards a force fixed in the ground, by the sine of its angle to it."""

    def truth(c: float, b: float) -> F64:
        nominal = about("Z", c) @ about("Y", b)
        return turn(np.cross(nominal[:, 2], pull)) @ nominal

    return truth


def first(found: Diagnosis) -> str:
    return found.established[0].effect.spec if found.established else "nothing"


@pytest.mark.parametrize(
    ("truth", "expected"),
    [
        (lambda c, b: about("X", 9e-5) @ about("Z", c) @ about("Y", b), "rotary_location axis=C"),
        (lambda c, b: about("Z", c) @ about("X", 9e-5) @ about("Y", b), "rotary_location axis=B"),
        (
            lambda c, b: about("Z", c) @ about("Y", b) @ about("X", 9e-5),
            "spindle_squareness direction=Y",
        ),
        (flexed(np.array([0.0, 0.0, -9e-5])), "gravity_flexure axis=B"),
        (lambda c, b: about("Z", c) @ about("Y", b - 0.02), "rotary_location axis=B"),
        (
            # gravity that pulls from the side would do the same, on a mount that lies down
            lambda c, b: about("Z", c + 9e-5 * math.cos(c - 0.7)) @ about("Y", b),
            "rotary_positioning axis=C harmonics=1",
        ),
    ],
    ids=["leaning", "not square", "collimation", "gravity", "zero of B", "eccentric graduation"],
)
def test_what_a_mount_lacks_is_called_by_its_name(truth: Orientation, expected: str) -> None:
    found = diagnose(*sky(truth, 5))
    assert first(found) == expected
    assert len(found.established) == 1
    words = "\n".join(found.words())
    assert "nan" not in words
    assert math.isfinite(found.established[0].rms_after)


@pytest.mark.parametrize(
    ("truth", "seed", "expected"),
    [
        (
            lambda c, b: about("Z", c) @ about("X", 9e-5) @ about("Y", b),
            0,
            "rotary_location axis=B",
        ),
        (
            lambda c, b: about("Z", c) @ about("X", 9e-5) @ about("Y", b),
            3,
            "rotary_location axis=B",
        ),
        (flexed(np.array([0.0, 0.0, -9e-5])), 4, "gravity_flexure axis=B"),
    ],
)
def test_no_pair_of_motions_takes_the_place_of_one_cause(
    truth: Orientation, seed: int, expected: str
) -> None:
    """What two error motions can both say was refunded though neither had paid for it."""
    found = diagnose(*sky(truth, seed, places=60))
    assert [e.effect.spec for e in found.established] == [expected]


def line(error: Callable[[F64], F64], seed: int, head: str = "") -> tuple[Model, Campaign]:
    """Lines along X, twice there and back, at three places of Y, noise 0.3 µm."""
    rng = np.random.default_rng(seed)
    text = ['format = "abbe-model/1"', "[machine]", 'name = "mill"', 'structure = "w b X Y Z t"']
    text += [f"[machine.axes.{a}]\ntravel = [0.0, 500.0]" for a in "XYZ"]
    rows = ['# format = "abbe-campaign/1"', *head.splitlines()]
    rows.append("time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd")
    there = np.linspace(0.0, 500.0, 21)
    for k in range(12):
        way = 1 if k % 2 == 0 else -1
        for x in there[::way]:
            value = float(error(x)) + rng.normal(0.0, 0.3)
            at = f"{x},{100 + 150 * (k // 4)},0,{way},1,0,0,{value:.4f},0.3"
            rows.append(f"{10 * len(rows)},x{k // 4},displacement,{at}")
    model = parse_model(TomlSource("\n".join(text)))
    return model, as_campaign("\n".join(rows) + "\n", model)


def test_a_wave_as_long_as_the_travel_is_no_screws() -> None:
    found = diagnose(*line(lambda x: 4.0 * np.sin(x / 90.0), 1))
    assert [e.effect.spec for e in found.established] == ["positioning axis=X"]


def test_what_else_it_could_be_begins_with_the_likeliest() -> None:
    """Rare turns by where another axis stands, that say exactly the same, come after it."""
    found = diagnose(*line(lambda x: 0.02 * x, 2, '# instrument = "laser interferometer"'))
    (cause,) = found.established
    assert cause.effect.spec == "scale axis=X"
    values = [a.found.evidence.value for a in cause.aliases]
    assert values == sorted(values, reverse=True)
    assert cause.aliases[0].found.candidate.effect.axis == "X"


def test_a_cosine_error_never_makes_a_line_too_long() -> None:
    """Of three lines the middle one is longer by 40 ppm: no angle of a beam does that."""
    model, campaign = line(lambda x: 0.0 * x, 3, '# instrument = "laser"')
    longer = np.where(campaign.conditions.setup == "x1", 4e-5, 0.0)
    value = campaign.value + longer * campaign.conditions.position("X")
    found = diagnose(model, replace(campaign, value=value))
    assert [e.effect.spec for e in found.established] == ["setup_scale setup=x1"]


def test_the_zero_of_a_table_is_where_what_it_carries_is_turned_about_it() -> None:
    """C's zero and the turn of B's line about C are the same error: both are said."""
    found = diagnose(*sky(lambda c, b: about("Z", c + 0.02) @ about("Y", b), 5))
    (cause,) = found.established
    named = {cause.effect.spec, *(a.found.candidate.effect.spec for a in cause.aliases)}
    assert {"rotary_location axis=C", "rotary_location axis=B"} <= named


def test_gravity_on_a_mount_that_stands_tilted_is_found_with_where_it_pulls() -> None:
    pull = 2e-4 * np.array([math.cos(0.8), 0.0, -math.sin(0.8)])
    model, campaign = sky(flexed(pull), 6)
    course = to_the_verdict(model, campaign)
    term = next(t for t in course.last.result.model.terms if t.effect.kind == "gravity_flexure")
    assert term.effect.spec == "gravity_flexure axis=B gravity=fit"
    for key, true in zip("xyz", pull, strict=True):
        value = term.values[f"g{key}"]
        assert abs(value.value - true) < 4.0 * value.sd + 1e-7
    assert course.diagnosis.verdict == "complete"


def plates(seed: int, warm: float) -> tuple[Model, Campaign]:
    """Two plates of 7 × 7 bores in the plane, the second larger by a part; frames free."""
    rng = np.random.default_rng(seed)
    text = ['format = "abbe-model/1"', "[machine]", 'name = "mill"', 'structure = "w b X Y Z t"']
    text += [f"[machine.axes.{a}]\ntravel = [0.0, 400.0]" for a in "XYZ"]
    rows = ['# format = "abbe-campaign/1"', '# instrument = "plate"']
    for name in ("one", "two"):
        rows += [f'# [setups.{name}]\n# free = ["frame"]']
    rows.append("setup,kind,X,Y,Z,ux,uy,uz,value")
    for name, larger in (("one", 0.0), ("two", warm)):
        for x in np.linspace(20.0, 380.0, 7):
            for y in np.linspace(20.0, 380.0, 7):
                # where the bores of a warm plate are, the machine says they are nearer
                for u, q in (("1,0,0", x), ("0,1,0", y)):
                    value = -1e3 * larger * (q - 200.0) + rng.normal(0.0, 0.7)
                    rows.append(f"{name},displacement,{x},{y},0,{u},{value:.4f}")
    model = parse_model(TomlSource("\n".join(text)))
    return model, as_campaign("\n".join(rows) + "\n", model)


def test_a_warm_plate_without_a_thermometer_is_called_one() -> None:
    found = diagnose(*plates(3, 40e-6))
    assert [e.effect.spec for e in found.established] == ["setup_scale setup=two"]
    (part,) = found.established[0].estimates
    assert part.value == pytest.approx(40e-6, abs=4.0 * part.sd)
    assert diagnose(*plates(3, 0.0)).verdict == "complete"
