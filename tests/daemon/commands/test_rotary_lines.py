"""Where a rotary axis's line lies, and what to enter: said as it is, on either side of the bed.

Truth is an exact chain (`tests.support.compcore.true_lines`) whose lines lie elsewhere than the
controller believes, measured as an R-test measures (ISO 10791-6): a sphere on the table, the
controller keeps the tool at its centre while the rotary axes turn, three readings a pose. What
Abbe says is entered in that controller, and the machine must then err no more.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.compcore.true_lines import Line, bed, moved, moves_to, pose, shift, turn
from tests.support.daemon.command_line import abbe

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
SD = 0.05
"""µm"""


@dataclass(frozen=True)
class Scene:
    """A machine: order from workpiece to tool, what its controller believes, and what is so."""

    structure: str
    order: str
    workpiece_side: str
    believed: dict[str, Line]
    true: dict[str, Line]
    tool: tuple[float, float, float] = (0.0, 0.0, -120.0)
    travels: dict[str, tuple[float, float]] = field(default_factory=dict)
    datum: str = '["frame"]'
    drawn: dict[str, Line] = field(default_factory=dict)
    """Where the lines were meant to be; what is believed at first."""

    def __post_init__(self):
        if not self.drawn:
            self.drawn.update(self.believed)

    def angles(self):
        grids = [np.deg2rad(np.linspace(*self.travels[a], 7)) for a in self.believed]
        for values in np.array(np.meshgrid(*grids)).reshape(len(grids), -1).T:
            yield dict(zip(self.believed, values.tolist(), strict=True))

    def pose(self, lines, q):
        """Workpiece → tool; the tool sits in the head as drawn, wherever the head's line lies."""
        head = next((a for a in self.order[::-1] if a in "ABC"), None)
        if head is None or head in self.workpiece_side:
            return pose(self.order, lines, q, self.tool)
        return pose(self.order, lines, q) @ moved(self.drawn[head], lines[head]) @ shift(self.tool)

    def poses(self):
        """The controller keeps the tool at each sphere's centre: (sphere, axes' positions)."""
        for i, sphere in enumerate(self.spheres()):
            for angles in self.angles():
                yield i, moves_to(lambda q: self.pose(self.believed, q), angles, sphere)

    def error(self, q):
        """Actual − indicated at one pose, machine axes, mm; what the exact chains differ by."""
        off = self.pose(self.true, q) - self.pose(self.believed, q)
        return bed(self.workpiece_side, self.believed, q).T @ off[:3, 3]

    def spheres(self):
        return np.array([(90.0, 40.0, 60.0), (-70.0, 110.0, 20.0), (20.0, -95.0, 140.0)])


def leaning(point, unit, off=(0.0, 0.0, 0.0), lean=(0.0, 0.0, 0.0)):
    """A line that lies `off` (mm) from a place and leans by a rotation vector (rad)."""
    d = np.array(unit) + np.cross(lean, unit)
    d /= np.linalg.norm(d)
    return Line(tuple(np.array(point) + off), tuple(d.tolist()))


C0, A0, B0 = (50.0, 30.0, 0.0), (0.0, 25.0, -40.0), (80.0, 0.0, 15.0)
TURNTABLE = Scene(
    "w C' b X Y Z t", "CXYZ", "C",
    {"C": Line(C0, Z)},
    {"C": leaning(C0, Z, (-0.010, 0.004, 0.0))},
    travels={"C": (-180.0, 180.0)},
)  # fmt: skip
TRUNNION = Scene(
    "w C' A' b X Y Z t", "CAXYZ", "CA",
    {"C": Line(C0, Z), "A": Line(A0, X)},
    {
        "C": leaning(C0, Z, (-0.010, 0.004, 0.0), (20e-6, -30e-6, 0.0)),
        "A": leaning(A0, X, (0.0, 0.012, -0.007), (0.0, 25e-6, 15e-6)),
    },
    travels={"C": (-180.0, 180.0), "A": (-90.0, 30.0)},
)  # fmt: skip
HEAD = Scene(
    "w b X Y Z C B t", "XYZCB", "",
    {"C": Line(C0, Z), "B": Line(B0, Y)},
    {
        "C": leaning(C0, Z, (-0.010, 0.004, 0.0), (20e-6, -30e-6, 0.0)),
        "B": leaning(B0, Y, (0.009, 0.0, -0.006), (18e-6, 0.0, -12e-6)),
    },
    travels={"C": (-180.0, 180.0), "B": (-90.0, 90.0)},
    datum="[]",
)  # fmt: skip
MIXED = Scene(
    "w C' b X Y Z B t", "CXYZB", "C",
    {"C": Line(C0, Z), "B": Line(B0, Y)},
    {
        "C": leaning(C0, Z, (-0.010, 0.004, 0.0), (20e-6, -30e-6, 0.0)),
        "B": leaning(B0, Y, (0.009, 0.0, -0.006), (18e-6, 0.0, -12e-6)),
    },
    travels={"C": (-180.0, 180.0), "B": (-90.0, 90.0)},
)  # fmt: skip
SCENES = {"turntable": TURNTABLE, "table-table": TRUNNION, "head-head": HEAD, "mixed": MIXED}


def model_text(scene):
    text = f'format = "abbe-model/1"\n[machine]\nname = "M"\nstructure = "{scene.structure}"\n'
    for axis in "XYZ":
        text += f"[machine.axes.{axis}]\ntravel = [-900.0, 900.0]\n"
    for axis, line in scene.believed.items():
        low, high = scene.travels[axis]
        text += f"[machine.axes.{axis}]\ntravel = [{low}, {high}]\nlocation = {list(line.point)}\n"
        text += f"direction = {list(line.direction)}\n"
    for axis in scene.believed:
        text += f'[[effects]]\nkind = "rotary_location"\naxis = "{axis}"\n'
    return text


def campaign_text(scene):
    rng = np.random.default_rng(4)
    head = '# format = "abbe-campaign/1"\n# machine = "M"\n'
    for i in range(len(scene.spheres())):
        head += f"# [setups.S{i}]\n# free = {scene.datum}\n"
    tool, rows = ",".join(map(str, scene.tool)), []
    for n, (i, q) in enumerate(scene.poses()):
        seen = scene.error(q) * 1e3 + rng.normal(0.0, SD, 3)
        at = [f"{q[a]:.9f}" for a in "XYZ"] + [f"{np.rad2deg(q[a]):.9f}" for a in scene.believed]
        for d, u in enumerate(("1,0,0", "0,1,0", "0,0,1")):
            row = f"{10 * n},S{i},displacement,{','.join(at)},{tool},{u},{seen[d]:.4f},{SD}"
            rows.append(row)
    names = f"time,setup,kind,X,Y,Z,{','.join(scene.believed)},tool_x,tool_y,tool_z,ux,uy,uz"
    return "\n".join([head + names + ",value,sd", *rows]) + "\n"


def fitted(scene, folder):
    """What ``abbe fit --json`` says, and as text."""
    (folder / "m.toml").write_text(model_text(scene), encoding="utf-8")
    (folder / "c.csv").write_text(campaign_text(scene), encoding="utf-8")
    command = ("fit", folder / "m.toml", folder / "c.csv", "--force", "-o", folder / "f.toml")
    done = abbe(*command, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out), abbe(*command).out


def entered(scene, found, factor=1.0):
    """The controller with the lines that Abbe says (−1: with the opposite, as a wrong sign)."""
    lines = dict(scene.believed)
    for line in found["rotary_axes"]:
        old = lines[line["axis"]]
        place = list(old.point)
        for letter, value in line["enter"].items():
            k = "XYZ".index(letter)
            place[k] += factor * (value - place[k])
        d = np.array(old.direction)
        d = d + factor * (np.array(line["direction"]) - d)
        d /= np.linalg.norm(d)
        lines[line["axis"]] = Line(tuple(place), tuple(d.tolist()))
    return replace(scene, believed=lines)


def left(scene):
    """What is left of the error over the poses, µm rms, beyond where each sphere is on the table.

    The exact chains' difference in the workpiece's frame, less its mean for each sphere.
    """
    seen = {}
    for i, q in scene.poses():
        off = scene.pose(scene.true, q) - scene.pose(scene.believed, q)
        seen.setdefault(i, []).append(off[:3, 3])
    rest = [np.array(v) - np.mean(v, axis=0) for v in seen.values()]
    return 1e3 * np.sqrt(np.mean(np.concatenate(rest) ** 2))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", SCENES)
def test_what_is_said_and_entered_takes_the_error_away(tmp_path, name):
    scene = SCENES[name]
    found, _ = fitted(scene, tmp_path)
    assert [line["axis"] for line in found["rotary_axes"]] == list(scene.believed)
    before, after = left(scene), left(entered(scene, found))
    assert before > 4.0
    assert after < 0.03, "entered as said, the lines are where they are"
    assert left(entered(scene, found, -1.0)) == pytest.approx(2.0 * before, rel=0.02)


@pytest.mark.parametrize("name", ["turntable", "table-table", "head-head"])
def test_the_lines_are_said_to_be_where_they_are(tmp_path, name):
    """Where artefact and machine zero leave nothing open, each line's place and lean by itself."""
    scene = SCENES[name]
    found, _ = fitted(scene, tmp_path)
    for line in found["rotary_axes"]:
        axis, truth = line["axis"], scene.true[line["axis"]]
        assert line["side"] == ("workpiece" if axis in scene.workpiece_side else "tool")
        for letter, value in line["enter"].items():
            assert value == pytest.approx(truth.point["XYZ".index(letter)], abs=1e-4), axis
            assert line["sd"][letter] < 5e-5
        np.testing.assert_allclose(line["direction"], truth.direction, atol=1e-6)


def test_in_words(tmp_path):
    """The line of C lies 10 µm towards −X of (50, 30): 49.990 instead of 50.000."""
    found, text = fitted(TURNTABLE, tmp_path)
    words = " ".join(text.split())
    assert "the line of C lies 10" in words or "the line of C lies 9.9" in words
    assert "towards −X and" in words
    digits = re.search(r"the line of C lies (\S+) ± (\S+) µm", words)
    assert digits is not None
    assert len(digits[1].partition(".")[2]) == len(digits[2].partition(".")[2]), "as the GUM has it"
    assert "towards +Y of the configured place: enter X 49.9900 instead of 50.0000 mm" in words
    assert "Y 30.0040 instead of 30.0000 mm" in words
    (effect,) = found["effects"]
    assert effect["parameters"]["E_X0C"]["value"] == pytest.approx(0.010, abs=1e-4)
    seen = effect["on_the_table"]["parameters"]["E_X0C"]["value"]
    assert seen == pytest.approx(-0.010, abs=1e-4), "what lies there has the opposite sign"
    assert "it is corrected twice" in words


def test_what_is_found_is_not_entered_before_it_is_fitted(tmp_path):
    """What is entered for one line counts from causes that may still be missing."""
    bare, campaign = tmp_path / "bare.toml", tmp_path / "c.csv"
    bare.write_text(model_text(TURNTABLE).partition("[[effects]]")[0], encoding="utf-8")
    campaign.write_text(campaign_text(TURNTABLE), encoding="utf-8")
    done = abbe("diagnose", bare, campaign, "--no-measure-next")
    words = " ".join(done.out.split())
    assert "he line of C lies" in words
    assert "enter X" not in words
    assert "What to enter for it in the controller is said once it is added and fitted." in words


def test_on_a_head_nothing_is_turned_round(tmp_path):
    found, text = fitted(HEAD, tmp_path)
    assert all(effect["on_the_table"] is None for effect in found["effects"])
    assert "on the table itself" not in text


def table_model(structure, effect, *axes):
    text = f'format = "abbe-model/1"\n[machine]\nname = "M"\nstructure = "{structure}"\n'
    for axis in axes:
        text += f"[machine.axes.{axis}]\ntravel = [-180.0, 180.0]\n"
    return text + f"[[effects]]\n{effect}\n"


def test_a_level_on_a_moving_table_shows_what_is_said_of_the_table(tmp_path):
    """A table X' that tilts by 12 µrad + 0.1 µrad/mm about Y, as a level on it shows."""
    effect = 'kind = "angular"\naxis = "X"\nabout = "Y"\nshape = "polynomial:1"'
    (tmp_path / "m.toml").write_text(table_model("w X' b Y Z t", effect, *"XYZ"), "utf-8")
    rows = [
        '# format = "abbe-campaign/1"',
        "# [setups.level]",
        "# free = []",
        "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd",
    ]
    for i, x in enumerate(np.linspace(-180.0, 180.0, 13)):
        table = turn(Y, 12e-6 + 0.1e-6 * x)[:3, :3]
        tool = table.T  # the tool's axes in the workpiece's frame: the table's turn undone
        value = 0.5e6 * (tool[0, 2] - tool[2, 0])
        rows.append(f"{i},level,rotation,{x},0,0,0,1,0,{value:.6f},0.1")
    (tmp_path / "c.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    command = ("fit", tmp_path / "m.toml", tmp_path / "c.csv", "-o", tmp_path / "f.toml", "--force")
    done = abbe(*command, "--json")
    assert done.status == 0, done.err
    (fitted_effect,) = json.loads(done.out)["effects"]
    seen = [v["value"] for v in fitted_effect["on_the_table"]["parameters"].values()]
    assert seen[0] == pytest.approx(12e-6, abs=1e-9)
    assert seen[1] == pytest.approx(0.1e-6 * 180.0, abs=1e-9), "at the end of the travel"
    text = abbe(*command).out
    assert "(on the table itself +12 µrad)" in text
    assert "shows the opposite sign" in text


def test_an_r_test_s_radial_motion_is_said_as_the_table_makes_it(tmp_path):
    """A table C' that runs out by +3 µm·cos 2θ along X: E_XC is −3 µm·cos 2θ, the table's +3."""
    effect = 'kind = "rotary_radial"\naxis = "C"\ndirection = "X"\nharmonics = 2'
    (tmp_path / "m.toml").write_text(table_model("w C' b X Y Z t", effect, *"XYZC"), "utf-8")
    names = "time,setup,kind,X,Y,Z,C,ux,uy,uz,value,sd"
    rows = ['# format = "abbe-campaign/1"', "# [setups.sphere]", "# free = []", names]
    for i, angle in enumerate(np.linspace(-180.0, 180.0, 25)):
        theta = np.deg2rad(angle)
        out = 3e-3 * np.cos(2 * theta)
        # bed → table as it is: turned back by θ, carried out along the bed's X
        table = shift((out, 0.0, 0.0)) @ turn(Z, -theta)
        sphere = np.array([40.0, 10.0, 30.0, 1.0])
        at = turn(Z, -theta) @ sphere  # where the controller takes the tool
        off = np.linalg.inv(table) @ at - sphere  # tool relative to the sphere, on the table
        seen = turn(Z, -theta)[:3, :3] @ off[:3] * 1e3
        x, y, z = (f"{v:.9f}" for v in at[:3])
        for d, u in enumerate(("1,0,0", "0,1,0", "0,0,1")):
            rows.append(f"{i},sphere,displacement,{x},{y},{z},{angle},{u},{seen[d]:.6f},0.1")
    (tmp_path / "c.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    command = ("fit", tmp_path / "m.toml", tmp_path / "c.csv", "-o", tmp_path / "f.toml")
    done = abbe(*command, "--json")
    assert done.status == 0, done.err
    (fitted_effect,) = json.loads(done.out)["effects"]
    table_itself = fitted_effect["on_the_table"]["parameters"]["A2"]["value"]
    assert fitted_effect["parameters"]["A2"]["value"] == pytest.approx(-3e-3, abs=1e-7)
    assert table_itself == pytest.approx(3e-3, abs=1e-7)


def test_a_place_that_no_row_shows_is_not_called_measured(tmp_path):
    """Stars show how a telescope's lines lean, never where they lie."""
    sky = Path(__file__).parents[2] / "data" / "real" / "r01-telescope"
    first, both = tmp_path / "first.toml", tmp_path / "both.toml"
    for start, axis, out in ((sky / "model.toml", "C", first), (first, "B", both)):
        done = abbe("add", start, "rotary_location", f"axis={axis}", "--campaign", sky / "run.csv",
                    "-o", out)  # fmt: skip
        assert done.status == 0, done.err
        assert f"E_X0{axis} not measured" in done.out
        assert f"E_B0{axis} = " in done.out, "what it leans, or where it stands"
    done = abbe("fit", both, sky / "run.csv", "-o", tmp_path / "fitted.toml")
    assert done.status == 0, done.err
    words = " ".join(done.out.split())
    for axis in "CB":
        assert f"where the line of {axis} lies was not measured" in words
        assert f"the line of {axis} leans" in words
    again = abbe("fit", both, sky / "run.csv", "-o", tmp_path / "fitted.toml", "--json")
    for line in json.loads(again.out)["rotary_axes"]:
        assert set(line["sd"].values()) == {None}


def test_a_line_without_an_error_is_measured_all_the_same(tmp_path):
    """What the readings say of a place decides whether it was measured, not that it is 0."""
    effect = 'kind = "rotary_location"\naxis = "C"'
    (tmp_path / "m.toml").write_text(table_model("w C' b X Y Z t", effect, *"XYZC"), "utf-8")
    names = "time,setup,kind,X,Y,Z,C,ux,uy,uz,value,sd"
    rows = ['# format = "abbe-campaign/1"', "# [setups.sphere]", "# free = []", names]
    for i, angle in enumerate(np.linspace(-180.0, 180.0, 13)):
        at = turn(Z, -np.deg2rad(angle)) @ np.array([40.0, 10.0, 30.0, 1.0])
        x, y, z = (f"{v:.9f}" for v in at[:3])
        seen = f"{i},sphere,displacement,{x},{y},{z},{angle}"
        rows += [f"{seen},{u},0,0.1" for u in ("1,0,0", "0,1,0", "0,0,1")]
    (tmp_path / "c.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    command = ("fit", tmp_path / "m.toml", tmp_path / "c.csv", "-o", tmp_path / "f.toml", "--force")
    done = abbe(*command, "--json")
    assert done.status == 0, done.err
    (line,) = json.loads(done.out)["rotary_axes"]
    assert all(0.0 < sd < 1e-3 for sd in line["sd"].values())
    assert line["text"][0] == "the line of C lies where it is configured"
    again = abbe("table", tmp_path / "f.toml", "--controller", "linuxcnc", "-o", tmp_path / "t")
    assert again.status == 0, again.err
    said = " ".join((again.out + again.err).split())
    assert "the line of C lies where it is configured" in said, "also when it is read from its file"
