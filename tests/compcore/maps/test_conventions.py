"""Identifying a controller's conventions from data that an independent algorithm made."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import Angular, Scale, Squareness
from abbe.compcore.errors import InputError
from abbe.compcore.files.switched_points import read_switched
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention, parse_signs
from abbe.compcore.maps.conventions.identify import identify
from abbe.compcore.maps.conventions.subject import MapSubject, ModelSubject
from abbe.compcore.maps.conventions.switched import SwitchedPoints
from abbe.compcore.maps.squareness import with_squareness
from abbe.compcore.maps.to_model import import_map, map_machine
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.article_map import as_map, correction, random_tables

XYZ = ("X", "Y", "Z")
BRIDGE = Structure.parse("w b Y X Z t")
ROUNDING = 1e-4
"""mm: displays show 0.1 µm."""


def switched(
    tables, chain="YXZ", *, n=40, tools=True, artefact=False, both=False, seed=0, **variant
):
    """Differences on − off at random points, rounded as a display does."""
    rng = np.random.default_rng(seed)
    q = {"X": rng.uniform(0, 700, n), "Y": rng.uniform(0, 900, n), "Z": rng.uniform(-360, 0, n)}
    tool = rng.uniform(-100, 100, (n, 3)) * (1.0 if tools else 0.0)
    found = np.array(
        [correction(tables, chain, {a: q[a][i] for a in XYZ}, tool[i], **variant) for i in range(n)]
    )
    found = np.round(found / ROUNDING) * ROUNDING * (-1.0 if artefact else 1.0)
    return SwitchedPoints(Conditions(q, tool=tool), found, ROUNDING / np.sqrt(12.0), both)


@pytest.fixture(scope="module")
def tables():
    return random_tables(np.random.default_rng(12))


def signed(*texts):
    reversed_ = parse_signs(texts, XYZ)
    return {"sign": lambda axis, k: -1.0 if (axis, "XYZABC"[k]) in reversed_ else 1.0}


CASES = {
    "Abbe's own": ({}, Convention()),
    "rotations reversed": (signed("R=-1"), Convention(parse_signs(["R=-1"], XYZ))),
    "linear errors reversed": (signed("L=-1"), Convention(parse_signs(["L=-1"], XYZ))),
    "left-handed about Y": (signed("Ry=-1"), Convention(parse_signs(["Ry=-1"], XYZ))),
    "Z's rotations": (signed("Z.R=-1"), Convention(parse_signs(["Z.R=-1"], XYZ))),
    "one column": (signed("X.Ly=-1"), Convention(parse_signs(["X.Ly=-1"], XYZ))),
    "far end of Z": ({"rotation_point": {"Z": -360.0}}, Convention(rotation_point={"Z": -360.0})),
    "far ends": (
        {"rotation_point": {"X": 700.0, "Z": -360.0}, **signed("R=-1")},
        Convention(parse_signs(["R=-1"], XYZ), {"X": 700.0, "Z": -360.0}),
    ),
    "own travel": ({"own_travel": XYZ}, Convention(own_travel="always")),
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("case", CASES)
def test_conventions_are_found_from_rounded_readings(tables, case):
    variant, expected = CASES[case]
    found = identify(MapSubject(as_map(tables)), switched(tables, **variant), BRIDGE)
    assert found.verdict == "identified"
    h = found.best.hypothesis
    assert (h.convention, h.artefact) == (expected, False)
    assert found.best.rms < 1.3 * ROUNDING / np.sqrt(12.0)
    assert found.best.worst < 0.6 * ROUNDING
    for other in found.changes:
        if other.hypothesis.convention.squareness == "as written":
            assert other.rms > 20 * found.best.rms, "each other way fails clearly"
    assert found.ranking[0] is found.best
    assert [j.rms for j in found.changes] == sorted((j.rms for j in found.changes), reverse=True)


@pytest.mark.parametrize("form", ["angle", "gradient"])
def test_the_form_of_squareness_is_found_with_a_tool(tables, form):
    """A map written in one form, applied by the controller in the other."""
    compensation = as_map(tables)
    machine = map_machine(compensation, BRIDGE)
    other = "gradient" if form == "angle" else "angle"
    for pair, angle in ((("Y", "X"), 1e-4), (("Y", "Z"), -8e-5), (("X", "Z"), 6e-5)):
        compensation = with_squareness(compensation, machine, pair, angle, other)
    truth = import_map(compensation, BRIDGE, Convention(squareness=form))
    points = switched(tables)
    difference = truth.predict(points.conditions).translation
    points = SwitchedPoints(points.conditions, difference, points.sigma)
    found = identify(MapSubject(compensation), points, BRIDGE)
    assert found.best.hypothesis.convention == Convention(squareness=form)
    by_form = {j.hypothesis.convention.squareness: j for j in found.changes}
    assert by_form["as written"].rms > 2e-3


def test_without_a_tool_the_form_of_squareness_stays_open_and_the_pose_that_tells_is_named(tables):
    found = identify(MapSubject(as_map(tables)), switched(tables, tools=False), BRIDGE)
    assert found.verdict == "identified"
    assert found.best.hypothesis.convention == Convention()
    open_ = {t.judged.hypothesis.convention.squareness: t for t in found.ties}
    for form in ("angle", "gradient"):
        assert np.linalg.norm(open_[form].telling.tool) == 150.0
        assert open_[form].telling.difference > 1e-3
    assert {("Z", "A"), ("Z", "B"), ("Z", "C")} <= set(found.unseen)


def test_the_pose_that_tells_does_tell(tables):
    """Measured there too, the tie is gone."""
    subject = MapSubject(as_map(tables))
    bare = switched(tables, tools=False)
    tie = next(
        t for t in identify(subject, bare, BRIDGE).ties
        if t.judged.hypothesis.convention.squareness == "angle"
    )  # fmt: skip
    pose, tool = tie.telling.positions, np.array([tie.telling.tool])
    more = np.array([correction(tables, "YXZ", pose, tool[0])])
    q = {a: np.append(bare.conditions.position(a), pose[a]) for a in XYZ}
    c = Conditions(q, tool=np.vstack([bare.conditions.tool, tool]))
    points = SwitchedPoints(c, np.vstack([bare.difference, more]), bare.sigma)
    again = identify(subject, points, BRIDGE)
    assert all(t.judged.hypothesis.convention.squareness != "angle" for t in again.ties)


@pytest.mark.parametrize("chain", ["YXZ", "ZXY"])
def test_the_chain_order_is_found(tables, chain):
    points = switched(tables, chain, **signed("R=-1"))
    found = identify(MapSubject(as_map(tables)), points, BRIDGE, any_order=True)
    assert found.verdict == "identified"
    assert "".join(found.best.hypothesis.structure.axes) == chain
    assert found.best.hypothesis.convention == Convention(parse_signs(["R=-1"], XYZ))


def test_a_wrong_chain_order_is_not_forced(tables):
    found = identify(MapSubject(as_map(tables)), switched(tables, "XZY"), BRIDGE)
    assert found.verdict == "none"
    assert found.best.rms > 1e-3


def test_any_point_in_the_volume_is_estimated(tables):
    true = {"X": 233.0, "Z": -120.0}
    points = switched(tables, rotation_point=true | {"Y": 400.0}, **signed("R=-1"))
    found = identify(MapSubject(as_map(tables)), points, BRIDGE)
    h = found.best.hypothesis
    assert found.verdict == "identified"
    assert h.fitted_point
    assert h.convention.reversed == parse_signs(["R=-1"], XYZ)
    for axis, position in true.items():
        assert found.point.sd[axis] < 2.0
        assert abs(found.point.position[axis] - position) < 4.0 * found.point.sd[axis]
    assert found.point.undetermined == ("Y",), "Y is first: its travel is no lever"


def test_an_estimated_point_comes_with_any_signs(tables):
    variant = {"rotation_point": {"X": 233.0, "Z": -120.0}, **signed("Z.R=-1", "X.Ly=-1")}
    found = identify(MapSubject(as_map(tables)), switched(tables, **variant), BRIDGE)
    assert found.verdict == "identified"
    assert found.best.hypothesis.convention.reversed == parse_signs(["Z.R=-1", "X.Ly=-1"], XYZ)


def test_a_named_point_wins_over_an_estimate_that_agrees(tables):
    found = identify(MapSubject(as_map(tables)), switched(tables), BRIDGE)
    assert not found.best.hypothesis.fitted_point
    for axis in "XZ":
        assert abs(found.point.position[axis]) < 4.0 * found.point.sd[axis]


def test_measuring_an_artefact_is_recognised(tables):
    found = identify(MapSubject(as_map(tables)), switched(tables, artefact=True), BRIDGE)
    assert found.verdict == "identified"
    assert found.best.hypothesis.artefact
    assert found.best.hypothesis.convention == Convention()
    assert found.opposite
    assert found.gain == pytest.approx(-1.0, abs=0.01)
    assert found.twin.convention.reversed == parse_signs(["L=-1", "R=-1"], XYZ)
    assert "an artefact was measured" in found.best.hypothesis.describe(BRIDGE)


def test_an_artefact_on_a_machine_with_reversed_rotations_has_both_readings(tables):
    """Indistinguishable from reversed linear errors: both are said."""
    points = switched(tables, artefact=True, **signed("R=-1"))
    found = identify(MapSubject(as_map(tables)), points, BRIDGE)
    assert found.opposite
    assert found.best.hypothesis.convention == Convention(parse_signs(["L=-1"], XYZ))
    assert found.twin.artefact
    assert found.twin.convention == Convention(parse_signs(["R=-1"], XYZ))


def test_an_artefact_is_recognised_through_noise_and_errors_outside_the_map(tables):
    """A real artefact shows more than the map; the opposite sign is still seen."""
    rng = np.random.default_rng(1)
    points = switched(tables, artefact=True)
    noisy = SwitchedPoints(
        points.conditions, points.difference + rng.normal(0, 1.5e-3, points.difference.shape)
    )
    found = identify(MapSubject(as_map(tables)), noisy, BRIDGE)
    assert found.verdict == "none"
    assert found.best.hypothesis.artefact
    assert found.gain < -0.7


def test_both_readings_cannot_come_from_an_artefact(tables):
    points = switched(tables, both=True, **signed("L=-1", "R=-1"))
    found = identify(MapSubject(as_map(tables)), points, BRIDGE)
    assert not found.best.hypothesis.artefact
    assert found.best.hypothesis.convention.reversed == parse_signs(["L=-1", "R=-1"], XYZ)
    assert found.opposite
    assert found.twin is None


def test_another_controller_s_map_is_not_forced(tables):
    stranger = random_tables(np.random.default_rng(99))
    found = identify(MapSubject(as_map(stranger)), switched(tables), BRIDGE)
    assert found.verdict == "none"
    assert found.best.rms > 1e-3


def test_points_on_one_line_leave_conventions_open(tables):
    """Along X at Y = Z = 0 the rotation point's Z is not seen, and that is said."""
    q = {"X": np.linspace(0, 700, 15), "Y": np.zeros(15), "Z": np.zeros(15)}
    d = np.array([correction(tables, "YXZ", {a: q[a][i] for a in XYZ}) for i in range(15)])
    points = SwitchedPoints(Conditions(q), d, 3e-5)
    found = identify(MapSubject(as_map(tables)), points, BRIDGE)
    assert found.verdict == "ambiguous"
    assert found.best.hypothesis.convention == Convention()
    distinct = [t for t in found.ties if t.telling and not any(t.telling.tool)]
    assert distinct
    assert all(t.telling.difference > 1e-4 for t in distinct)


def test_squareness_beside_the_map(tables):
    beside = {("Y", "X"): 1e-4, ("X", "Z"): -5e-5}
    points = switched(tables)
    truth = import_map(as_map(tables), BRIDGE, Convention(stated="gradient"), squareness=beside)
    points = SwitchedPoints(points.conditions, truth.predict(points.conditions).translation)
    found = identify(MapSubject(as_map(tables), beside), points, BRIDGE)
    assert found.best.hypothesis.convention == Convention(stated="gradient")


def angular(axis, about, c0, c1):
    effect = Angular(axis=axis, about=about, shape="polynomial:1")
    return Term(effect, {"c0": Value(c0), "c1": Value(c1)})


def fitted_model():
    m = map_machine(as_map(random_tables(np.random.default_rng(1))), BRIDGE)
    terms = (
        Term(Scale(axis="X"), {"k": Value(3e-5)}),
        Term(Scale(axis="Z"), {"k": Value(-2e-5)}),
        angular("Y", "X", 9e-6, 3e-5),
        angular("X", "Y", 1e-5, 4e-5),
        Term(Squareness(axes=("Y", "X")), {"angle": Value(5e-5)}),
    )
    return Model(m, terms)


def test_a_model_may_be_the_subject():
    model = fitted_model()
    rng = np.random.default_rng(5)
    n = 40
    q = {"X": rng.uniform(0, 700, n), "Y": rng.uniform(0, 900, n), "Z": rng.uniform(-360, 0, n)}
    c = Conditions(q, tool=rng.uniform(-100, 100, (n, 3)))
    points = SwitchedPoints(c, model.predict(c).translation, 3e-5)
    found = identify(ModelSubject(model), points, BRIDGE)
    assert found.verdict == "identified"
    assert found.best.hypothesis.words(BRIDGE) == []
    sloped = found.changes
    assert any(j.hypothesis.convention.stated == "gradient" and j.rms > 1e-3 for j in sloped)


def test_a_model_with_rotary_axes_or_another_order_is_refused():
    with pytest.raises(InputError, match="a model's chain order cannot be changed"):
        ModelSubject(fitted_model()).machine(Structure.parse("w b X Y Z t"))


@pytest.mark.parametrize("code", ["w b Y X Z t", "w Y' b X Z t"])
def test_predictions_are_those_of_the_imported_model(tables, code):
    """Identification and import are the same computation."""
    structure = Structure.parse(code)
    rng = np.random.default_rng(4)
    points = switched(tables)
    for own in ("structure", "never", "always"):
        for form in ("as written", "angle", "gradient"):
            chosen = frozenset((a, c) for a in XYZ for c in "XYZABC" if rng.random() < 0.4)
            convention = Convention(chosen, {"X": 100.0, "Z": -50.0}, own, form)
            got = MapSubject(as_map(tables)).at(points.conditions).correction(structure, convention)
            model = import_map(as_map(tables), structure, convention)
            np.testing.assert_allclose(
                got, model.predict(points.conditions).translation, atol=1e-12
            )


def test_what_corrects_nothing_is_said(tables):
    """A model that was never fitted, and a map of zeros, with differences to explain."""
    points = switched(tables)
    bare = Model(map_machine(as_map(tables), BRIDGE), (Term(Scale(axis="X")),))
    zeros = as_map({axis: (q, np.zeros_like(v)) for axis, (q, v) in tables.items()})
    for subject in (ModelSubject(bare), MapSubject(zeros)):
        with pytest.raises(InputError, match="corrects nothing at these points"):
            identify(subject, points, BRIDGE)


def test_too_little_to_go_by():
    still = SwitchedPoints(Conditions.at({a: [0.0] * 5 for a in XYZ}), np.zeros((5, 3)))
    subject = MapSubject(as_map(random_tables(np.random.default_rng(1))))
    with pytest.raises(InputError, match="on and off read alike"):
        identify(subject, still, BRIDGE)
    few = SwitchedPoints(Conditions.at({a: [0.0] * 2 for a in XYZ}), np.ones((2, 3)))
    with pytest.raises(InputError, match="too few points"):
        identify(subject, few, BRIDGE)


# --- the file ------------------------------------------------------------------------------------

HEAD = '# format = "abbe-points/1"\n# unit = "um"\n'
MACHINE = map_machine(as_map(random_tables(np.random.default_rng(1))), BRIDGE)


def read(tmp_path, text):
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    return read_switched(path, MACHINE)


def test_differences_in_um(tmp_path):
    points = read(tmp_path, HEAD + "X,Y,Z,dX,dY,dZ\n200,600,-150,46.9,187.5,79.2\n1,2,3,0.1,0,-1\n")
    np.testing.assert_allclose(points.difference[0], [0.0469, 0.1875, 0.0792])
    assert points.conditions.position("X").tolist() == [200.0, 1.0]
    assert points.sigma == pytest.approx(1e-4 / np.sqrt(12.0))
    assert not points.both_read
    assert not points.conditions.tool.any()


def test_both_readings_in_mm(tmp_path):
    text = (
        "tool_x,tool_y,tool_z,X_on,Y_on,Z_on,X_off,Y_off,Z_off\n"
        "0,0,-80,200.0469,600.1875,-149.9208,200.0000,600.0000,-150.0000\n"
    )
    points = read(tmp_path, text)
    np.testing.assert_allclose(points.difference, [[0.0469, 0.1875, 0.0792]], atol=1e-12)
    assert points.conditions.position("Y").tolist() == [600.0]
    assert points.conditions.tool.tolist() == [[0.0, 0.0, -80.0]]
    assert points.both_read
    assert points.sigma == pytest.approx(1e-4 / np.sqrt(6.0))


def test_positions_read_with_the_correction_on(tmp_path):
    head = HEAD + '# positions = "on"\n'
    points = read(tmp_path, head + "X,Y,Z,dX,dY,dZ\n200.0469,600.1875,-149.9208,46.9,187.5,79.2\n")
    found = [points.conditions.position(a)[0] for a in XYZ]
    assert found == pytest.approx([200.0, 600.0, -150.0])


def test_computed_numbers_are_not_taken_for_a_display_s(tmp_path):
    assert read(tmp_path, HEAD + "X,Y,Z,dX,dY,dZ\n0,0,0,1e-3,2.5,3\n").sigma == 0.0
    many = read(tmp_path, HEAD + "X,Y,Z,dX,dY,dZ\n0,0,0,46.90038124,2.5,3\n")
    assert many.sigma == 0.0


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("X,Y,Z,dX,dY,dZ\n0,0,0,1,2,3\n", 1, "unit of dX, dY, dZ is not stated.*# unit"),
        (HEAD.replace("um", "inch") + "X,Y,Z,dX,dY,dZ\n", 2, "'unit'.*found 'inch'"),
        (HEAD.replace("points/1", "campaign/1") + "X\n", 1, "found 'abbe-campaign/1'"),
        (HEAD + "X,Y,Z,dX,dY\n0,0,0,1,2\n", 3, "'dZ': a column is missing"),
        (HEAD + "X,Y,Z,dX,dY,dZ,dW\n", 3, "'dW': unknown column"),
        (HEAD + "X,Y,Z,dX,dY,dZ,dX\n", 3, "'dX': the same column twice"),
        (HEAD + "X,Y,Z,dX,dY,dZ,tool_x\n", 3, "'tool_y': a column is missing"),
        (HEAD + "X_off,Y_off,Z_off,X_on,Y_on\n", 3, "'Z_on': a column is missing"),
        (HEAD + "X_off,Y_off,Z_off,X_on,Y_on,Z_on,dX\n", 3, "differences and readings"),
        (HEAD + "X,Y,Z,dX,dY,dZ\n0,0,0,1,2\n", 4, "too few fields: found 5, expected 6"),
        (HEAD + "X,Y,Z,dX,dY,dZ\n\n0,0,0,1,2,3\n0,0,x,1,2,3\n", 6, "'Z': not a number: found 'x'"),
        (HEAD + "X,Y,Z,dX,dY,dZ\n0,0,0,1,2,nan\n", 4, "'dZ': not a number"),
        (HEAD + "X,Y,Z,dX,dY,dZ\n", 3, "no points"),
        (HEAD, 3, "the header is missing"),
    ],
)
def test_errors_in_the_file_name_the_line(tmp_path, text, line, message):
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, text)
    assert caught.value.line == line
    assert caught.value.file.endswith("points.csv")
