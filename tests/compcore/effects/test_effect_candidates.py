"""Effects propose themselves: complete, plausible ones first, none twice."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.campaign.coverage import Coverage, SetupCoverage
from abbe.compcore.effects import effect_class, effect_kinds, make_effect
from tests.support.compcore.catalogue import FIVE_AXIS, MILL, conditions, world


def campaign(machine) -> Campaign:
    w = world(machine)
    # one line with the laser, so that beams along the path exist
    line = w.setup == "line"
    q = {a: np.where(line & (a != "X"), 0.0, x) for a, x in w.q.items()}
    u = np.where(line[:, None], [1.0, 0.0, 0.0], w.u)
    at = conditions(type(w)(**{**vars(w), "q": q, "u": u}))
    n = at.n
    free = {"line": ("zero",), "level": ("zero",), "plate": ("frame",), "bar": ()}
    return Campaign(
        "test",
        at,
        w.kind,
        np.zeros(n),
        np.ones(n),
        np.full(n, ""),
        np.full(n, ""),
        np.arange(n),
        setups={name: Setup(name, keys) for name, keys in free.items()},
        bases={"B1": (0.0, 0.0, 0.0), "B2": (500.0, 0.0, 0.0)},
    )


CAMPAIGNS = {m.name: (m, campaign(m)) for m in (MILL, FIVE_AXIS)}
EVERYTHING = {name: c.coverage() for name, (_, c) in CAMPAIGNS.items()}
ALL = [(m.name, kind) for m in (MILL, FIVE_AXIS) for kind in effect_kinds()]


def candidates(name: str, kind: str):
    machine, _ = CAMPAIGNS[name]
    return list(effect_class(kind).candidates(machine, EVERYTHING[name]))


@pytest.mark.parametrize(("name", "kind"), ALL)
def test_candidates_make_sense_on_their_machine(name, kind):
    machine, c = CAMPAIGNS[name]
    seen = set()
    for effect in candidates(name, kind):
        effect.check(machine)
        assert effect.kind == kind
        assert effect.spec not in seen
        seen.add(effect.spec)
        _, *pairs = effect.spec.split(" ")
        assert make_effect(kind, dict(p.split("=", 1) for p in pairs)) == effect
        nonlinear = {}
        for p in effect.search(machine, EVERYTHING[name]):
            assert p.bounds[0] <= min(p.starts) <= max(p.starts) <= p.bounds[1]
            nonlinear[p.name] = p.starts[len(p.starts) // 2]
        for motion in effect.motions(machine, c.conditions, nonlinear):
            assert np.isfinite(motion.columns).all()


@pytest.mark.parametrize(("name", "kind"), ALL)
def test_no_candidate_is_another_one_over_again(name, kind):
    """Unit-length columns of one kind at one choice of non-linear parameters: none are parallel."""
    machine, c = CAMPAIGNS[name]
    found = {}
    for effect in candidates(name, kind):
        nonlinear = {
            p.name: p.starts[len(p.starts) // 2] for p in effect.search(machine, EVERYTHING[name])
        }
        motions = effect.motions(machine, c.conditions, nonlinear)
        if not motions or any(m.columns.shape[1] > 1 for m in motions):
            continue
        stacked = {}
        for m in motions:
            key = (m.error_motion, tuple(nonlinear.items()))
            stacked[key] = stacked.get(key, 0.0) + m.columns[:, 0]
        norm = np.sqrt(sum(float(v @ v) for v in stacked.values()))
        if norm == 0.0:
            continue
        found[effect.spec] = {key: v / norm for key, v in stacked.items()}
    for (one, a), (two, b) in itertools.combinations(found.items(), 2):
        overlap = sum(float(a[key] @ b[key]) for key in a.keys() & b.keys())
        assert abs(overlap) < 1.0 - 1e-9, f"{one} = {two}"


def test_the_number_of_candidates_is_bounded():
    """Seven temperatures on a three-axis machine, as in the campaigns with known answers."""
    seven = dict.fromkeys(list(MILL.signals)[:7], (19.0, 24.0))
    coverage = Coverage(frozenset("XYZ"), frozenset("XYZ"), seven, duration=2e4, tool_varies=True)
    total = sum(len(list(cls.candidates(MILL, coverage))) for cls in effect_kinds().values())
    assert 500 < total < 800


def test_nothing_that_did_not_vary_is_proposed():
    coverage = Coverage()
    for kind, cls in effect_kinds().items():
        found = list(cls.candidates(MILL, coverage))
        assert not found, f"{kind}: {[e.spec for e in found]}"


def test_pairs_of_the_structure_come_first():
    coverage = EVERYTHING["mill"]
    for kind in ("thermal_bending", "thermal_tilt"):
        first = next(iter(effect_class(kind).candidates(MILL, coverage)))
        assert set(first.signals) == {"T_front", "T_rear"}
    offsets = list(effect_class("thermal_offset").candidates(MILL, coverage))
    assert MILL.signals[offsets[0].signal].role in ("structure", "spindle")
    assert offsets[0].direction == "Z"
    screw = next(iter(effect_class("screw_heating").candidates(MILL, coverage)))
    assert MILL.signals[screw.signal].role in ("screw", "speed")


@pytest.mark.parametrize(
    "spec",
    [
        "backlash axis=Z",
        "warm_up direction=X",
        "drift direction=Y",
        "event direction=X",
        "thermal_tilt axis=Y about=X signals=T_front,T_rear",
        "thermal_tilt axis=Y about=X signal=T_air",
        "thermal_bending axis=Z about=X signals=T_front,T_rear",
        "thermal_bending axis=Z about=X signals=T_front,T_rear tau=fit",
        "thermal_offset direction=Z signal=T_spindle",
        "thermal_offset direction=Z signal=speed tau=fit",
        "scale_expansion axis=X signals=T_x",
        "screw_heating axis=Y signal=T_screw",
        "cyclic axis=X",
        "local_defect axis=X error=E_ZX",
        "reversal_angle axis=Y about=Z",
        "cross_angular axis=Y about=X by=Z",
        "overhang_sag axis=Z direction=Y by=Z",
        "load_bending axis=X direction=Z signal=load",
        "load_bending axis=Y about=X signal=load shape=constant",
        "feed_lag axis=X signal=feed",
        "workpiece_expansion signal=T_part",
        "cosine setup=line",
        "dead_path setups=line",
        "air_refraction",
        "instrument_drift setup=line",
        "instrument_drift setup=level measures=angle",
        "length_bias",
        "length_bias base=B2",
        "sensor_offset signal=T_x",
        "sensor_gain signal=T_rear",
        "sensor_bend signal=T_rear",
        "spindle_squareness direction=X",
    ],
)
def test_among_the_candidates_of_a_mill(spec):
    assert spec in [e.spec for e in candidates("mill", spec.split(" ", 1)[0])]


@pytest.mark.parametrize(
    "spec",
    [
        "rotary_location axis=C",
        "rotary_positioning axis=A",
        "rotary_radial axis=C direction=X",
        "rotary_axial axis=C",
        "rotary_tilt axis=A direction=Y",
        "warm_up axis=C",
        "event axis=A",
        "backlash axis=C",
        "cross_angular axis=C about=X by=A",
    ],
)
def test_among_the_candidates_of_five_axes(spec):
    assert spec in [e.spec for e in candidates("five axes", spec.split(" ", 1)[0])]


def test_instrument_effects_only_where_they_could_be_distinguished():
    """A slope that is free contains a cosine; a level has none; a plate's frame no zero."""
    details = {
        "free": SetupCoverage(
            frozenset({"displacement"}), 20, 300.0, 500.0, 0.0, ("zero", "slope")
        ),
        "tied": SetupCoverage(frozenset({"displacement"}), 20, 300.0, 500.0, 0.0, ("zero",)),
        "edge": SetupCoverage(frozenset({"displacement"}), 20, 300.0, 0.0, 500.0, ("zero",)),
        "level": SetupCoverage(frozenset({"rotation"}), 20, 300.0, 500.0, 0.0, ()),
        "short": SetupCoverage(frozenset({"displacement"}), 3, 300.0, 500.0, 0.0, ("zero",)),
        "plate": SetupCoverage(frozenset({"displacement"}), 60, 300.0, 0.0, 500.0, (), 3),
        "loose": SetupCoverage(frozenset({"displacement"}), 60, 300.0, 0.0, 500.0, ("frame",), 3),
    }
    coverage = Coverage(setups=tuple(details), setup_details=details, duration=1e4)

    def specs(kind: str) -> list[str]:
        return [e.spec for e in effect_class(kind).candidates(MILL, coverage)]

    assert specs("cosine") == ["cosine setup=tied", "cosine setup=short"]
    assert specs("setup_slope") == ["setup_slope setup=edge", "setup_slope setup=plate"]
    assert specs("setup_zero") == [
        "setup_zero setup=level measures=angle",
        "setup_zero setup=plate",
    ]
    assert specs("setup_frame") == ["setup_frame setup=plate"]
    assert "instrument_drift setup=short" not in specs("instrument_drift")
    assert "instrument_drift setup=level measures=angle" in specs("instrument_drift")
    assert specs("dead_path") == [], "no signal of the air varied"


def test_a_laser_stands_elsewhere_for_each_direction():
    """Lines along X and along Y: a dead path of all, of each direction, and of each line."""
    along = {"x0": (1.0, 0.0, 0.0), "x1": (1.0, 0.0, 0.0), "y0": (0.0, 1.0, 0.0)}
    along |= {"x2": (1.0, 0.0, 0.0), "y1": (0.0, 1.0, 0.0)}
    details = {
        name: SetupCoverage(frozenset({"displacement"}), 20, along=500.0, spread=1, toward=u)
        for name, u in along.items()
    }
    signals = {"T_air": (19.0, 23.0)}
    coverage = Coverage(setups=tuple(details), setup_details=details, signals=signals)
    stands = [e.setups for e in effect_class("dead_path").candidates(MILL, coverage)]
    assert stands == [
        tuple(details), ("x0", "x1", "x2"), ("y0", "y1"), *[(name,) for name in details]
    ]  # fmt: skip


def test_what_a_campaign_tells_of_its_set_ups():
    seen = EVERYTHING["mill"].setup_details
    assert set(seen) == {"line", "level", "plate", "bar"}
    assert seen["level"].kinds == {"rotation"}
    assert seen["line"].along == pytest.approx(np.ptp(CAMPAIGNS["mill"][1].conditions.position("X")
        [CAMPAIGNS["mill"][1].conditions.setup == "line"]))  # fmt: skip
    assert seen["line"].across == pytest.approx(0.0, abs=1e-9)
    assert seen["plate"].free == ("frame",)
    assert (seen["line"].spread, seen["plate"].spread) == (1, 3)
    assert (seen["line"].toward, seen["plate"].toward) == ((1.0, 0.0, 0.0), ())
    assert (CAMPAIGNS["mill"][1].conditions.kind == Kind.DISTANCE).sum() == seen["bar"].rows


def test_set_ups_that_are_renamed_are_found_anew():
    """Joining campaigns renames set-ups; what was kept for the old names must not survive."""
    at = conditions(world(MILL))
    before = at.setup_rows()
    assert at.setup_rows() is before
    renamed = replace(at, setup=np.char.add("day 2: ", at.setup))
    assert set(renamed.setup_rows().index) == {f"day 2: {name}" for name in before.index}
    later = replace(at, time=-at.time)
    first = later.setup_rows().first
    assert [at.time[i] for i in first] == [at.time[before.number == k].max() for k in range(4)]
    assert [at.time[i] for i in before.first] == [
        at.time[before.number == k].min() for k in range(4)
    ]
    part = at.rows(at.setup == "line")
    assert set(part.setup_rows().index) == {"line"}
    assert not part.setup_rows().mask("plate").any()
