"""Files of instruments that cannot be linked, put in place by a person, matched by target."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.importers.lines.matched import moving, write_all_matched
from abbe.compcore.files.importers.points_matched import reads_points, write_points
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.visited_targets import VisitedTargets
from abbe.compcore.planning.motion import steps_of
from abbe.compcore.sentences import counted, said
from abbe.daemon.answers.measurements.foreign_file import ForeignOptions, read_foreign
from abbe.daemon.arguments.measurements.foreign_layout import ForeignLayout
from abbe.daemon.arguments.measurements.foreign_placing import foreign_placing
from abbe.daemon.calibration.asking import AskPerson
from abbe.drivers.programs.dialect import targets_csv

LAYOUTS = {".rtl": ForeignLayout.RTL, ".csv": ForeignLayout.ISO230_2}
"""Ending of a file → what it is."""


def write_targets(plan: Path, model: Path, out: Path) -> None:
    """Write the list of a plan's targets, for the person who types them into the instrument."""
    machine = load_model(model).machine
    work = read_plan(plan, machine)
    write_atomically(out, targets_csv(steps_of(machine, work.setups, work.space), machine))


def placed_in(folder: Path) -> tuple[Path, ...]:
    """The instrument's files that are in a folder, by name; none where there is no folder."""
    if not folder.is_dir():
        return ()
    return tuple(sorted(p for p in folder.iterdir() if p.suffix.lower() in LAYOUTS))


def match_readings(
    visits: Path,
    model: Path,
    folder: Path,
    out: Path,
    say: Callable[[str], None],
    ask: AskPerson | None,
) -> None:
    """Write the campaign of all set-ups that were followed, each with the file called like it.

    Parameters
    ----------
    visits
        Where the machine stood.
    model
        The machine, of which a tracker's points are.
    folder
        Where the person puts the instrument's files; made where it is not there.
    out
        The campaign.
    ask
        Asks whether missing files are there now; None: nobody is asked.

    Raises
    ------
    AbbeError
        Where files are missing, by name.
    InputError
        Where one does not fit its targets; nothing is written then.
    """
    every = VisitedTargets.read_all(visits)
    folder.mkdir(exist_ok=True)
    points = [reads_points(one) for one in every]
    if any(points) and not all(points):
        raise AbbeError(
            said("points of a tracker and lines along axes in one measurement are not matched yet")
        )
    files = _all_there([one.setup for one in every], folder, ask, points=all(points))
    matched, notes = [], dict[str, None]()
    if all(points):
        machine = load_model(model).machine
        placed = [(files[one.setup], one) for one in every]
        count, found = write_points(placed, machine, out)
        _said(found, count, len(placed), out, say)
        return
    for one in every:
        file = files[one.setup]
        axis, component = moving(one), _component(one)
        rotation = component in "ABC"
        placing = foreign_placing("", "0,0,0", one.setup, None, [], 1, rotation=rotation)
        options = ForeignOptions(axis=axis, component=component)
        readings = read_foreign(LAYOUTS[file.suffix.lower()], file, placing, None, options)
        matched.append((readings, one))
        notes |= dict.fromkeys(str(readings.metadata[0]["notes"]).split("; "))
    count = write_all_matched(matched, out, "; ".join(notes))
    _said(notes, count, len(matched), out, say)


def _said(
    notes: Iterable[str], count: int, files: int, out: Path, say: Callable[[str], None]
) -> None:
    for note in notes:
        say(note)
    say(
        said(
            "{count} of {files} matched with their targets: {out}",
            count=counted(count, "1 reading", "{n} readings"),
            files=counted(files, "1 file", "{n} files"), out=out,
        )
    )  # fmt: skip


def _all_there(
    setups: list[str], folder: Path, ask: AskPerson | None, *, points: bool
) -> dict[str, Path]:
    """Set-up → its file; who is asked is asked until all are there, or no more."""
    while True:
        found: dict[str, Path] = {}
        for path in placed_in(folder):
            if path.stem in found:
                raise InputError(
                    "two files of one set-up",
                    file=path,
                    found=f"{found[path.stem].name} and {path.name}",
                    expected="one of them",
                )
            found[path.stem] = path
        lacking = [name for name in setups if name not in found]
        if not lacking:
            return found
        named = ", ".join(f"{folder / name}.{'csv' if points else 'rtl'}" for name in lacking)
        if points:
            words = said(
                "the instrument's files are not there: put them as {files} (columns x, y, z, or "
                "distance, mm: one line for each pose, in their order)",
                files=named,
            )
        else:
            words = said(
                "the instrument's files are not there: put them as {files} (or .csv: position, "
                "run, direction, deviation)",
                files=named,
            )
        if ask is None or not ask(said("{what}. Are they there now?", what=words)):
            raise AbbeError(said("{what}; then the same command goes on here", what=words))


def _component(visits: VisitedTargets) -> str:
    """What a set-up reads: X Y Z along, A B C about."""
    row = visits.rows[0]
    u = [abs(float(row[name])) for name in ("ux", "uy", "uz")]
    names = "ABC" if row["kind"] == "rotation" else "XYZ"
    return names[u.index(max(u))]
