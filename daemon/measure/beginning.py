"""The beginning of a measurement: files read and checked, the campaign begun or gone on with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from math import radians
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.growing_campaign import GrowingCampaign
from abbe.compcore.files.plan_file import PlannedWork, read_plan
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.files.visited_targets import IN_A_FILE, READINGS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.sentences import counted
from abbe.daemon.config import Configuration, load_config
from abbe.daemon.config.channels import split
from abbe.daemon.measure.compensation import live_correction, require_stated, stated_compensation
from abbe.daemon.measure.course import MeasureCourse, chosen
from abbe.daemon.measure.events import MeasureEvent, Tell, minutes
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.session import Measurement
from abbe.daemon.measure.person import Person
from abbe.daemon.measure.probing.chosen_artefact import artefact_of
from abbe.daemon.measure.probing.session import ProbedMeasurement
from abbe.daemon.measure.rows import columns, digest, head, seen_beside
from abbe.daemon.measure.task import MeasureTask
from abbe.daemon.outputs import CAMPAIGN, check_outputs
from abbe.daemon.ownership.claims import held_by_watch
from abbe.daemon.ownership.lock import hold


@contextmanager
def begun(
    plan: Path,
    config: Path,
    out: Path,
    names: Sequence[str],
    tell: Tell,
    *,
    yes: bool,
    once: bool,
    active: Path | None = None,
    conditions: Mapping[str, str] | None = None,
) -> Iterator[Measurement | ProbedMeasurement]:
    """A measurement that is ready to run; what it holds is given back with the context.

    Parameters
    ----------
    active
        The model whose compensation acts, in place of what the configuration says.
    conditions
        What the campaign's head says beside those of the configuration, which count before these.

    Raises
    ------
    InputError
        For bad files, instruments that cannot read the plan, and a campaign that was begun with
        another plan or configuration.
    InUseError
        When somebody else measures into this file, or has a line that cannot be shared.
    """
    # a campaign is never overwritten: there is no --force
    wanted, way_out = [(out, CAMPAIGN)], "a new name"
    check_outputs([plan, config], wanted, force=False, way_out=way_out)
    configuration = load_config(config)
    reads = [plan, config, configuration.model_path]
    check_outputs(reads, wanted, force=False, way_out=way_out)
    machine = configuration.model.machine
    work = read_plan(plan, machine)
    setups = chosen(work, names, plan)
    links = configuration.make_links(instruments=True)
    artefact = artefact_of(configuration, setups, links)
    instruments = {} if artefact is not None else _instruments(configuration, setups)
    limits, probing = configuration.file.measure, configuration.file.probing
    # an artefact lies anyhow near its place
    turn = radians(limits.within_turn)
    if artefact is not None and probing is not None:
        course = _touched_course(setups, probing.placing, artefact.beside, turn, config)
    else:
        course = MeasureCourse(setups, limits.within, turn, in_one_go=work.in_one_go)
    require_stated(configuration, live_correction(configuration), active)
    signals = [n for n, s in configuration.file.signals.items() if s.source is not None]
    more = () if artefact is None else artefact.columns
    beside = seen_beside(machine, signals, touches=artefact is not None)
    titles = columns(machine, setups, signals, more, beside)
    origin = {
        "by": "abbe measure",
        "plan_sha256": digest(TomlSource.read(plan).data),
        "configuration_sha256": digest(_of_meaning(TomlSource.read(config).data)),
        **({"setups": ", ".join(s.name for s in setups)} if names else {}),
        **({} if artefact is None else artefact.origin),
        **({} if all(i.section.linked for i in instruments.values()) else {READINGS: IN_A_FILE}),
        **stated_compensation(configuration, out, active),
    }
    with ExitStack() as held:
        what = f"measuring into {out.resolve()}"
        # who moves a machine is the only one who does
        moved = [] if artefact is None or probing is None else [*links[probing.link].owns]
        own = dict.fromkeys([f"campaign {out.resolve()}", *held_by_watch(links), *moved])
        held.enter_context(hold([*own], what))
        goes_on = out.exists() and out.stat().st_size > 0
        if goes_on:
            file = GrowingCampaign.resume(out, origin, titles, machine, newer=beside)
        else:
            now = datetime.now(UTC)
            when = {"plan": str(plan), "started": now.isoformat()}
            top = head(
                machine, setups, {**(conditions or {}), **limits.conditions}, origin | when, now,
                beside,
            )  # fmt: skip
            file = GrowingCampaign.begin(out, top, titles)
        held.callback(file.close)
        torn = course.replay(file.rows, out)
        if torn:
            file.cut(torn)
        stated = active is not None or limits.active is not None
        task = MeasureTask(
            configuration, file, _started(file), instruments,
            # a check makes no model surer
            {} if work.in_one_go else work.expected, stated, work.space,
            None if artefact is None else artefact.touched,
            {} if artefact is None else artefact.turns, once,
        )  # fmt: skip
        kind = Measurement if artefact is None else ProbedMeasurement
        try:
            begins = kind(task, course, Person(there=not yes), tell)
        except InputError as error:
            if not goes_on:  # what was never measured leaves no campaign behind
                file.close()
                out.unlink()
            raise error.at(file=configuration.path) from None
        _say_beginning(course, work, configuration, tell, goes_on=goes_on, follows=artefact is None)
        yield begins


def _touched_course(
    setups: Sequence[PlannedSetup], placing: float, beside: float, turn: float, config: Path
) -> MeasureCourse:
    """The course of an artefact that lies up to `placing` off, the tip `beside` its targets, mm."""
    try:
        return MeasureCourse(setups, placing + beside, turn)
    except InputError as error:
        raise InputError(
            f"{error.problem}: placing, and {beside:g} mm for the tip",
            file=config,
            field="probing.placing",
            found=placing,
            expected=f"{error.expected} for both together",
        ) from None


def _of_meaning(data: Mapping[str, object]) -> Mapping[str, object]:
    """A configuration without what only says when a reading counts."""
    return {key: value for key, value in data.items() if key != "measure"}


def _started(file: GrowingCampaign) -> datetime:
    try:
        return datetime.fromisoformat(str(file.begun_with["started"])).astimezone(UTC)
    except (KeyError, ValueError):
        raise InputError(
            "does not say when it was begun", file=file.path, field="measured.started"
        ) from None


def _instruments(
    configuration: Configuration, setups: Sequence[PlannedSetup]
) -> dict[str, Instrument]:
    """Plan's instrument → the one that stands for it, of those that some set-ups need."""
    links = configuration.make_links(instruments=True)
    made: dict[str, Instrument] = {}
    for name, section in configuration.file.instrument.items():
        unit = ""
        if section.linked:
            link, channel = split(section.sources[0])
            unit = links[link].info(channel).unit
        instrument = Instrument(name, section, unit, configuration.model.machine)
        made |= dict.fromkeys(section.measures or (name,), instrument)
    found = {}
    for setup in setups:
        key = setup.instrument.key
        if key not in made:
            raise InputError(
                f"no instrument reads set-up {setup.name}",
                file=configuration.path,
                field=f"instrument.{key}",
                expected=f"a section [instrument.{key}] with source and reads",
            )
        try:
            made[key].check(setup)
        except InputError as error:
            raise error.at(file=configuration.path) from None
        found[key] = made[key]
    return found


def _say_beginning(
    course: MeasureCourse,
    work: PlannedWork,
    configuration: Configuration,
    tell: Tell,
    *,
    goes_on: bool,
    follows: bool,
) -> None:
    about = {"done": course.done, "of": course.total, "left_s": round(course.seconds_left, 1)}
    count = f"{counted(len(course.setups), '1 set-up', '{n} set-ups')}, "
    count += counted(course.total, "1 target", "{n} targets")
    left = minutes(course.seconds_left)
    if goes_on:
        words = (
            f"goes on: {course.done} of {counted(course.total, '1 target', '{n} targets')} "
            f"{'is' if course.done == 1 else 'are'} done, about {left} left"
        )
        tell(MeasureEvent("resumed", words, about))
    else:
        warm = f"; warm up as in use for {minutes(work.warm_up)} first" if work.warm_up else ""
        tell(MeasureEvent("began", f"{count}, about {left}{warm}", about))
    limits = configuration.file.measure
    needs = limits.still_for + limits.settle + limits.average
    short = [s.name for s in course.setups if s.instrument.reading < needs]
    if short and follows:
        stands = min(s.instrument.reading for s in course.setups if s.name in short)
        words = (
            f"a target needs {needs:g} s ([measure] still_for + settle + average), and the program "
            f"of {', '.join(short)} stands {stands:g} s: targets may be missed"
        )
        tell(MeasureEvent("note", words, about))
