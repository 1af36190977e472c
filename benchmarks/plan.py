"""Plans of measurements on five structures: beside presets, and carried out by simulation.

``python -m benchmarks.plan [KEY...]``: all structures, or those named (``bridge`` …). Each is
written into its section of ``docs/validation.md`` as it finishes; rows of others stay as they are.
Fails where a plan leaves more than 0.8 of what the best preset, or the best two in turn, leave in
the same time, or where what it foretells is off by more than 15 %.
"""

from __future__ import annotations

import sys
import time
from itertools import permutations
from math import radians
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from abbe.compcore.linalg import threads_for
from abbe.compcore.machine.common_machines import COMMON_MACHINES
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.choice import Knowledge
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.knowledge import VolumeError, added, prior
from abbe.compcore.planning.plan import plan_survey
from abbe.compcore.planning.setups.presets import PRESETS, filled, possible_of
from abbe.compcore.planning.simulation import carry_out
from abbe.compcore.planning.targets import SurveyTask
from benchmarks.measuring.report import write_section
from benchmarks.validation import PAGE, table

LINEAR = ("laser", "straightness", "angle", "level", "tracker", "ball-bar", "step-gauge")
HEAD = ("structure", "h", "plan", *PRESETS, "two presets", "plan ÷ best", "fit states", "is left",
        "before", "s")  # fmt: skip
SEEDS = range(1, 13)
AT_MOST = 0.8
"""Of what the best preset leaves in the same time."""
WITHIN = 0.15
"""Part by which what a simulated campaign reaches may differ from what the plan foretells."""
TABLE = {"C": (300.0, 300.0, -550.0), "A": (300.0, 300.0, -500.0)}
CASES = (
    ("bridge", 6.0, LINEAR),
    ("c-frame", 6.0, LINEAR),
    ("gantry", 8.0, LINEAR),
    ("horizontal-arm", 8.0, LINEAR),
    ("table-table", 10.0, (*LINEAR, "r-test")),
)


def machine(key: str) -> Machine:
    """A common machine; rotary tables stand in the middle of the travels."""
    kind = COMMON_MACHINES[key]
    axes = {}
    for name, (low, high) in kind.travels.items():
        place = TABLE.get(name, (0.0, 0.0, 0.0))
        ends = (radians(low), radians(high)) if is_rotary(name) else (low, high)
        axes[name] = Axis(name, ends, location=place)
    return Machine(kind.title, Structure.parse(kind.structure), axes)


def measured(key: str, hours: float, names: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """A structure's row of the table, and what of it is missed."""
    begin = time.process_time()
    made = machine(key)
    model = start_model(made, StartOptions(play=True, rotary_motions=True))
    task = SurveyTask(model)
    plan = plan_survey(task, instruments_called(names), hours * 3600.0, compare=True)
    planned = time.process_time() - begin
    reached = [carry_out(plan, seed) for seed in SEEDS]
    stated, after, before = (
        float(np.sqrt(np.mean([getattr(r, name) ** 2 for r in reached])))
        for name in ("stated", "after", "before")
    )
    presets = plan.presets or {}
    both, pair = in_turn(task, hours * 3600.0)
    best = min(*presets.values(), both)
    row = [
        f"{made.structure}",
        f"{hours:g}",
        f"{plan.after * 1e3:.2f}",
        *(f"{presets[k] * 1e3:.3g}" if k in presets else "–" for k in PRESETS),
        f"{both * 1e3:.3g} ({' + '.join(pair)})",
        f"{plan.after / best:.2f}",
        f"{stated * 1e3:.2f}",
        f"{after * 1e3:.2f}",
        f"{before * 1e3:.0f}",
        f"{planned:.0f}",
    ]
    missed = [f"{key}: {plan.after / best:.2f} of presets"] * (plan.after > AT_MOST * best)
    missed += [
        f"{key}: {what} {found / plan.after:.2f} of what the plan foretells"
        for what, found in (("the fit states", stated), ("left is", after))
        if abs(found / plan.after - 1.0) > WITHIN
    ]
    return row, missed


def in_turn(task: SurveyTask, seconds: float) -> tuple[float, tuple[str, str]]:
    """What the best two presets leave, one after the other in the same time, mm; and which."""
    with threads_for(1):
        setups = {p.key: possible_of(p, task) for p in PRESETS.values()}
        roots = {k: [added(task, s) for s in found] for k, found in setups.items()}
        start = Knowledge.beforehand(prior(task.model), VolumeError.of(task))
        left = {}
        for one, other in permutations(setups, 2):
            several, each = setups[one] + setups[other], roots[one] + roots[other]
            known = start
            for i in filled(several, seconds):
                known = known.with_(each[i], several[i].runs)
            left[one, other] = float(np.sqrt(known.variance))
    pair = min(left, key=lambda k: left[k])
    return left[pair], pair


def written() -> dict[str, list[str]]:
    """The rows that the page has, by structure."""
    section = PAGE.read_text(encoding="utf-8").partition("<!-- plan:begin -->")[2]
    section = section.partition("<!-- plan:end -->")[0]
    rows = [
        [cell.strip() for cell in line.strip("| ").split(" | ")] for line in section.splitlines()
    ]
    return {row[0]: row for row in rows if len(row) == len(HEAD)}


def main() -> None:
    """Plan, compare, simulate, write."""
    asked = sys.argv[1:] or [key for key, _, _ in CASES]
    unknown = set(asked) - {key for key, _, _ in CASES}
    if unknown:
        sys.exit(f"no structure here: {', '.join(sorted(unknown))}")
    missed = []
    for key, hours, names in CASES:
        if key in asked:
            row, short = measured(key, hours, names)
            print(row, flush=True)
            missed += short
            write(written() | {row[0]: row})
    sys.exit("; ".join(missed) or 0)


def write(rows: dict[str, list[str]]) -> None:
    """The section, in the order of the cases."""
    order = [str(machine(key).structure) for key, _, _ in CASES]
    write_section(
        "plan",
        f"""## Plans of measurements

`abbe plan` on five structures (start models with splines by travel, play and rotary motions), with
{", ".join(LINEAR)} (and an R-test where axes turn)
at hand. Volumetric standard uncertainty after correction, µm: of the plan; of the same time
spent on each preset with the instruments that it asks for, and on the best two presets in turn;
then what a simulated campaign of
{len(SEEDS)} machines reaches, with each set-up's zero, slope, frame and base point unknown: what
the fit's covariance states, what is really left, what the machine erred before. Plan ÷ the best of
all presets and pairs
is to be at most {AT_MOST:g}; what the fit states, and what is left, within {100 * WITHIN:.0f} % of
the plan's. The last column is the processor time that planning took, with the presets weighed, s.

{table(HEAD, [rows[k] for k in order if k in rows])}
""",
        PAGE,
    )


if __name__ == "__main__":
    main()
