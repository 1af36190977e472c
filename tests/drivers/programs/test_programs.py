"""Programs of plans, read back: by LinuxCNC's own interpreter, others by parsers of their own."""

import math
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.planning.drawing_back import drawn_back
from abbe.compcore.planning.envelope import KeepOut, WorkingSpace
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.motion import TURN, ProgramStep, steps_of
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.candidates import possible
from abbe.drivers.programs.dialect import plain, targets_csv
from abbe.drivers.programs.dialects import dialect_called
from tests.support.compcore.survey_machines import task

NAMES = {
    "rotary table": ["laser", "r-test", "tracker", "ball-bar"],
    "bridge": ["laser", "straightness", "ball-plate", "gauge-block"],
    "horizontal-arm": ["laser"],
}
AXES = "XYZABC"


def chosen(name):
    """A few set-ups of each instrument; each with a name."""
    aim = task(name)
    found = []
    for key in NAMES[name]:
        some = list(possible(aim, instruments_called([key])))
        found += [some[0], replace(some[-1], runs=2)]
    return aim, [replace(s, name=f"s{i:02d}") for i, s in enumerate(found)]


def expected(aim, setups):
    """Machine positions in mm and degrees at every target, from the set-ups alone."""
    for setup in setups:
        for k, senses in zip(
            setup.visits()[0],
            np.stack([setup.senses()[a] for a in setup.targets], axis=1),
            strict=True,
        ):
            at = {a: math.degrees(q[k]) if is_rotary(a) else q[k] for a, q in setup.targets.items()}
            moving = {a for a, q in setup.targets.items() if np.ptp(q) > 0.0}
            yield at, {a: s for a, s in zip(setup.targets, senses, strict=True) if a in moving}


def check(aim, setups, events):
    """Every stop is at its target, met from the side that the plan says, or beyond the next one.

    Before each target that is met from another side than the one before, it stands beyond.
    """
    wanted = list(expected(aim, setups))
    at, came, seen = {}, {}, 0
    beyond = None
    for event in events:
        if isinstance(event, dict):
            for axis, value in event.items():
                if axis in at and abs(value - at[axis]) > 1e-9:
                    came[axis] = math.copysign(1.0, value - at[axis])
                low, high = aim.machine.axes[axis].travel
                if is_rotary(axis):
                    low, high = math.degrees(low), math.degrees(high)
                assert low - 1e-4 <= value <= high + 1e-4, (axis, value)
            at = at | event
        else:
            position, senses = wanted[seen]
            if event == TURN:
                beyond = dict(at)
                continue
            assert event > 0.0
            if seen:  # which axes come back to it
                last = wanted[seen - 1][0]
                back = {
                    a for a, s in senses.items()
                    if (position[a] - last.get(a, position[a])) * s < -1e-6
                }  # fmt: skip
                assert not back or beyond is not None, seen
                assert all((position[a] - beyond[a]) * senses[a] > 0.0 for a in back), seen
            beyond = None
            for axis, value in position.items():
                assert at[axis] == pytest.approx(value, abs=1e-4), (seen, axis)
            for axis, sense in senses.items():
                assert came[axis] == sense, (seen, axis)
            seen += 1
    assert seen == len(wanted)


@pytest.mark.skipif(shutil.which("rs274") is None, reason="needs LinuxCNC's interpreter")
@pytest.mark.parametrize("name", NAMES)
def test_linuxcncs_own_interpreter_stops_at_every_target(name, tmp_path):
    aim, setups = chosen(name)
    steps = steps_of(aim.machine, setups, aim.space)
    (tmp_path / "tool.tbl").touch()
    (tmp_path / "p.ngc").write_text(
        dialect_called("linuxcnc").text(steps, aim.machine, "test (µ)", 3000.0), "ascii"
    )
    done = subprocess.run(
        ["rs274", "-t", "tool.tbl", "-g", "p.ngc"],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    assert "PROGRAM_END()" in done.stdout

    def events():
        for line in done.stdout.splitlines():
            if found := re.search(r"STRAIGHT_FEED\((.*)\)", line):
                numbers = [float(v) for v in found[1].split(",")]
                yield {a: v for a, v in zip(AXES, numbers, strict=True) if a in aim.machine.axes}
            elif found := re.search(r"DWELL\((.*)\)", line):
                yield float(found[1])
            assert "STRAIGHT_TRAVERSE" not in line

    stream = list(events())
    # before its first word of an axis the interpreter has it at 0
    first = next(i for i, e in enumerate(stream) if isinstance(e, dict))
    check(aim, setups, stream[first + 1 :])
    there = sum(bool(s.instrument.there) for s in setups)
    assert there > 0
    assert done.stdout.count("PROGRAM_STOP()") == len(setups) + there


def test_rotary_axes_that_turn_alone_go_as_the_plan_counts_them():
    """3 m/min beside 10 degrees a second: 600 degrees a minute, not 3000."""
    axes = {a: Axis(a, (-1.5, 1.5)) for a in ("B", "C")} | {"X": Axis("X", (0.0, 500.0))}
    machine = Machine("turns", Structure.parse("w C' B' X' b t"), axes)
    angles = {"X": np.full(3, 100.0), "B": np.zeros(3), "C": np.array([-1.0, 0.0, 1.0])}
    setup = PlannedSetup(
        instruments_called(["rotary-calibrator"])[0], "angle of C", "C", angles,
        np.tile([[[0.0, 0.0, 1.0]]], (3, 1, 1)), Kind.ROTATION, ("zero",), np.full(3, 1e-6),
        name="s",
    )  # fmt: skip
    steps = steps_of(machine, [setup], WorkingSpace())
    for name, fed in (("siemens", r"C=(\S+) F(\d+)"), ("heidenhain", r"C(\S+) R0 F(\d+)")):
        text = dialect_called(name).text(steps, machine, "test", 3000.0)
        between = text[text.index("target 1") : text.rindex("target")]
        turned = [float(f) for _, f in re.findall(fed, between)]
        assert len(turned) > 4
        assert set(turned) == {600.0}


def test_siemens_ends_a_five_axis_transformation_where_there_are_rotary_axes():
    for name, said in (("rotary table", True), ("bridge", False)):
        aim, setups = chosen(name)
        steps = steps_of(aim.machine, setups[:1], aim.space)
        lines = dialect_called("siemens").text(steps, aim.machine, "test", 2000.0).splitlines()
        first = next(i for i, line in enumerate(lines) if line.startswith("SUPA"))
        assert ("TRAFOOF" in lines[:first]) == said


def words(text, pattern):
    return {a: float(v) for a, v in re.findall(pattern, text)}


def klartext(text):
    """A reader of the few words of Klartext, apart from the writer."""
    lines = text.splitlines()
    assert [int(line.split(" ", 1)[0]) for line in lines] == list(range(len(lines)))
    body = [line.split(" ", 1)[1] for line in lines]
    assert body[0] == "BEGIN PGM ABBE MM"
    assert body[-1] == "END PGM ABBE MM"
    for line in body[1:-1]:
        if line.startswith("L "):
            assert line.endswith(" M91")
            yield words(line, r"\b([A-CX-Z])([+-]\d+\.\d+)")
        elif found := re.fullmatch(r"CYCL DEF 9\.1 DWELL (\d+\.\d+)", line):
            yield float(found[1])
        else:
            assert line.startswith(";") or line in ("STOP", "CYCL DEF 9.0 DWELL TIME")


def siemens(text):
    for line in text.splitlines():
        if line.startswith("SUPA G1 "):
            yield words(line, r"\b([A-CX-Z])=(-?\d+\.\d+)")
        elif found := re.fullmatch(r"G4 F([\d.]+)", line):
            yield float(found[1])
        else:
            own = ("M0", "M30", "G710 G90 G94 G40 G500 D0", "TRAFOOF")
            assert line.startswith(";") or line in own


def fanuc(text):
    lines = text.splitlines()
    assert lines[0] == lines[-1] == "%"
    assert text == text.upper()
    for line in lines:
        if line.startswith("G1 "):
            yield words(line, r"\b([A-CX-Z])(-?\d+\.\d+)")
        elif found := re.fullmatch(r"G4 X([\d.]+)", line):
            yield float(found[1])


READERS = {"heidenhain": klartext, "siemens": siemens, "fanuc": fanuc}


@pytest.mark.parametrize("controller", READERS)
@pytest.mark.parametrize("name", NAMES)
def test_other_languages_say_the_same(name, controller):
    aim, setups = chosen(name)
    steps = steps_of(aim.machine, setups, aim.space)
    text = dialect_called(controller).text(steps, aim.machine, "test", 2000.0)
    check(aim, setups, READERS[controller](text))


def test_ipp_commands_have_their_tags_and_go_to_every_target():
    aim, setups = chosen("bridge")
    text = dialect_called("ipp").text(
        steps_of(aim.machine, setups, aim.space), aim.machine, "", 600
    )
    commands = [line for line in text.split("\r\n") if line and not line.startswith("#")]
    assert [line[:6] for line in commands] == [f"{i:05d} " for i in range(1, len(commands) + 1)]
    assert commands[0].endswith("StartSession()")
    assert commands[-1].endswith("EndSession()")
    assert commands[1].endswith("SetCoordSystem(MachineCsy)")
    assert "SetProp(Tool.GoToPar.Speed(10.000))" in commands[2]

    def events():
        for line in text.split("\r\n"):
            if line == f"# stand {TURN:g} s":  # each GoTo ends before the next is sent
                yield TURN
            elif " GoTo(" in line:
                yield words(line, r"\b([XYZ])\((-?\d+\.\d+)\)")
            elif line.endswith("Get(X(), Y(), Z())"):
                yield 1.0

    check(aim, setups, events())


MANUALS = {
    "siemens": [
        (r"SUPA G1(?: [XYZ]=-?\d+\.\d{4})+ F2000", 10),
        (r"G4 F[\d.]+", 10),
        (r"G710 G90 G94 G40 G500 D0", 1),
        (r"M0", 2),
        (r"M30|;.*", 1),
    ],
    "fanuc": [
        (r"G1(?: [XYZ]-?\d+\.\d{4})+ F2000\.0", 10),
        (r"G4 X\d+\.\d{3}", 10),
        (r"IF \[#52[02][1-3] NE 0\] THEN #3000=1 \(OFFSET NOT ZERO\)", 6),
        (r"G21 G90 G94 G40 G49 G80 G54", 1),
        (r"M0", 2),
        (r"%|O0001 \(.*\)|\(.*\)|M30", 4),
    ],
    "heidenhain": [
        (r"\d+ L(?: [XYZ][+-]\d+\.\d{4})+ R0 F2000 M91", 10),
        (r"\d+ CYCL DEF 9\.0 DWELL TIME", 10),
        (r"\d+ CYCL DEF 9\.1 DWELL \d+\.\d{3}", 10),
        (r"\d+ STOP", 2),
        (r"\d+ (?:BEGIN|END) PGM ABBE MM|\d+ ;.*", 2),
    ],
    "ipp": [
        (r"\d{5} SetCoordSystem\(MachineCsy\)", 1),
        (r"\d{5} SetProp\(Tool\.GoToPar\.Speed\(33\.333\)\)", 1),
        (r"\d{5} GoTo\((?:(?:, )?[XYZ]\(-?\d+\.\d{4}\))+\)", 10),
        (r"\d{5} Get\(X\(\), Y\(\), Z\(\)\)", 10),
        (r"\d{5} (?:Start|End)Session\(\)|#.*", 2),
    ],
}
"""Lines in the words that docs/sources.md cites, and of how many there are at least."""


@pytest.mark.parametrize("controller", MANUALS)
def test_words_are_those_of_the_manuals(controller):
    aim, setups = chosen("bridge")
    steps = steps_of(aim.machine, setups, aim.space)
    text = dialect_called(controller).text(steps, aim.machine, "test", 2000.0)
    lines = text.replace("\r", "").splitlines()
    known = set()
    for pattern, least in MANUALS[controller]:
        found = {line for line in lines if re.fullmatch(pattern, line)}
        assert sum(line in found for line in lines) >= least, pattern
        known |= found
    assert [line for line in lines if line not in known] == []


def test_ipp_has_no_rotary_axes():
    aim, setups = chosen("rotary table")
    steps = steps_of(aim.machine, setups, aim.space)
    with pytest.raises(InputError, match="X, Y and Z only"):
        dialect_called("ipp").text(steps, aim.machine, "", 600.0)


def test_what_lies_outside_the_travels_is_refused():
    aim, setups = chosen("bridge")
    low = {**setups[0].targets, "Z": np.full(setups[0].count, 0.5)}
    with pytest.raises(InputError, match="Z would leave its travel"):
        steps_of(aim.machine, [replace(setups[0], targets=low)], aim.space)
    edge = {**setups[0].targets, "Y": setups[0].targets["Y"] - 9.0}
    with pytest.raises(InputError, match="Y would leave its travel"):
        steps_of(aim.machine, [replace(setups[0], targets=edge)], aim.space)


def test_a_way_between_set_ups_through_a_box_is_refused():
    """Both set-ups are free; the way at the height of drawing back is not."""
    aim, _ = chosen("bridge")
    # a wall from side to side: what can be gone around is (test_ways_between.py)
    box = KeepOut((-500.0, 400.0, -140.0), (5000.0, 500.0, -80.0))
    space = WorkingSpace((box,))
    lines = [s for s in possible(replace(aim, space=space), instruments_called(["laser"]))
             if s.axis == "Z"]  # fmt: skip
    here, there = lines[0], lines[-1]
    assert len(lines) > 1
    with pytest.raises(InputError, match="keep-out box 1"):
        steps_of(aim.machine, [replace(here, name="a"), replace(there, name="b")], space)


def test_the_list_of_targets_counts_them_all():
    aim, setups = chosen("rotary table")
    steps = steps_of(aim.machine, setups, aim.space)
    lines = targets_csv(steps, aim.machine).splitlines()
    assert lines[0] == "number,setup,C,Y,X,Z,C_dir,Y_dir,X_dir,Z_dir,seconds"
    wanted = list(expected(aim, setups))
    assert len(lines) == len(wanted) + 1
    for line, (at, senses) in zip(lines[1:], wanted, strict=True):
        cells = line.split(",")
        assert [float(c) for c in cells[2:6]] == pytest.approx([at[a] for a in "CYXZ"], abs=1e-4)
        assert [int(c) for c in cells[6:10]] == [int(senses.get(a, 0)) for a in "CYXZ"]


@pytest.mark.parametrize("bad", ["(M2)", "a\nM30", "x;G0", "5 µm − 3°"])
def test_words_of_people_cannot_become_commands(bad):
    said = plain(bad)
    assert said.isascii()
    assert not set(said) & set('();"\n')


def test_an_unknown_controller_is_named():
    with pytest.raises(InputError, match="linuxcnc, fanuc, siemens, heidenhain, ipp"):
        dialect_called("mazak")


LATHE = Machine(
    "lathe",
    Structure.parse("w (C') b Z X t"),
    {"X": Axis("X", (-200.0, 0.0)), "Z": Axis("Z", (-500.0, 0.0))},
)
FACING = [
    ProgramStep("move", at={"X": -10.0, "Z": -20.0}, seconds=0.0),
    ProgramStep("target", at={"X": -10.0, "Z": -20.0}, number=1, seconds=2.0),
]


@pytest.mark.skipif(shutil.which("rs274") is None, reason="needs LinuxCNC's interpreter")
def test_a_lathe_that_counts_in_diameters_goes_where_it_should(tmp_path):
    """LinuxCNC's own interpreter, left in G7 by what ran before: there -10 would be -5."""
    text = dialect_called("linuxcnc").text(FACING, LATHE, "lathe", 500.0)
    program = tmp_path / "lathe.ngc"
    program.write_text("G7\n" + text)
    done = subprocess.run(
        ["rs274", "-g", str(program)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    (fed,) = re.findall(r"STRAIGHT_FEED\(([-\d.]+), ([-\d.]+), ([-\d.]+)", done.stdout)
    assert [float(v) for v in fed] == [-10.0, 0.0, -20.0]


def test_siemens_is_told_that_x_is_a_radius_before_it_moves():
    lines = dialect_called("siemens").text(FACING, LATHE, "lathe", 500.0).splitlines()
    assert lines.index("DIAMOF") < next(i for i, line in enumerate(lines) if "SUPA" in line)


MILLS_TOO = Machine(
    "mill-turn",
    Structure.parse("w C' b Z X Y t"),
    {**LATHE.axes, "C": Axis("C", (0.0, 6.3)), "Y": Axis("Y", (-40.0, 40.0))},
)
"""Its spindle is a positioned axis, and it has a Y."""


@pytest.mark.parametrize("machine", [LATHE, MILLS_TOO])
@pytest.mark.parametrize("controller", ["fanuc", "heidenhain"])
def test_no_lathe_is_moved_by_a_language_that_cannot_say_radius(controller, machine):
    with pytest.raises(InputError, match="no programs for a lathe"):
        dialect_called(controller).text(FACING, machine, "lathe", 500.0)


def test_a_lathe_that_mills_is_told_that_x_is_a_radius_and_draws_back_in_x():
    """Not in Y: that moves the tool along the work."""
    for controller, word in (("linuxcnc", "G8"), ("siemens", "DIAMOF")):
        lines = dialect_called(controller).text(FACING, MILLS_TOO, "lathe", 500.0).splitlines()
        assert word in lines
    assert drawn_back(MILLS_TOO, (-100.0, 0.0, 0.0)) == ("X", pytest.approx(-1.0))


def test_a_mill_is_told_nothing_of_diameters():
    for controller in ("linuxcnc", "siemens"):
        mill = replace(LATHE, structure=Structure.parse("w b Z X (C) t"))
        text = dialect_called(controller).text(FACING, mill, "mill", 500.0)
        assert "G8\n" not in text
        assert "DIAMOF" not in text


@pytest.mark.parametrize("name", ["linuxcnc", "fanuc", "heidenhain"])
def test_an_axis_of_two_characters_is_no_word_there(name):
    """LinuxCNC calls C0 C2-121.6 several c words on one line; Siemens has a sign between them."""
    axes = {"C": Axis("C", (-2.0, 2.0)), "C2": Axis("C2", (-2.4, 2.4), location=(325.0, 0.0, 0.0))}
    machine = Machine("arm", Structure.parse("w b C C2 t"), axes)
    steps = [ProgramStep("move", at={"C": 0.0, "C2": -math.radians(121.6)})]
    with pytest.raises(InputError, match="one letter"):
        dialect_called(name).text(steps, machine, "arm", 600.0)
    assert " C=0.0000 C2=-121.6000 " in dialect_called("siemens").text(steps, machine, "arm", 600.0)
