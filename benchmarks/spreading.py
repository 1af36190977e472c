"""How much two workers do in the time of one: ``python -m benchmarks.spreading``, some 7 minutes.

Blocks of virtual measurements and diagnoses of simulated campaigns, by processes here and by a real
Dask scheduler's workers, one and two of them in processes of their own, after they have started.
Writes its section of docs/performance.md, with the plan for a thousand machines.
"""

from __future__ import annotations

import argparse
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from abbe.daemon.answers.fleet_diagnosis.diagnosed import diagnosis_tasks
from abbe.daemon.answers.fleet_diagnosis.fleet_files import fleet_campaigns
from abbe.daemon.answers.uncertainty.blocks import block_tasks
from abbe.daemon.demo.prepare import Workshop, prepare
from abbe.daemon.spreading.dask_cluster import DaskCluster, SchedulerAddress
from abbe.daemon.spreading.engine import Engine
from abbe.daemon.spreading.process_pool import ProcessPool
from abbe.daemon.spreading.spread_work import SpreadTask, TaskPayload
from benchmarks.hidden.scenario import hide, scenarios
from benchmarks.hidden.scenes.scene import scene
from benchmarks.measuring.report import machine, write_section
from tests.support.daemon.dask_processes import dask_processes

PART = """format = "abbe-part/1"
[styli.1]
offset = [0, 0, -100]
radius = 1.5
[probe]
repeatability = 0.3
[signals]
{signals}
[[features]]
name = "A"
kind = "plane"
at = [350, 350, -150]
size = [380, 280]
grid = [4, 4]
[[features]]
name = "B"
kind = "circle"
at = [200, 250, -160]
diameter = 40
inside = true
[[features]]
name = "C"
kind = "circle"
at = [500, 450, -160]
diameter = 40
inside = true
"""
SIGNALS = "\n".join(
    f"T_{axis}{end} = {{ value = 21.0, sd = 0.05, varies = 1.0 }}" for axis in "xyz" for end in "12"
)
MACHINES, CAMPAIGNS = 1000, 100
PROCESSORS = 64
QUIET = 1.5
"""Load before measuring up to which two workers have two cores."""


@dataclass(frozen=True)
class Pace:
    """How fast tasks were answered while every worker was busy.

    Attributes
    ----------
    rate
        Tasks per second of the wall clock.
    seconds
        Processor seconds of a task, mean.
    """

    rate: float
    seconds: float


def pace(engine: Engine, tasks: Sequence[Callable[[], SpreadTask]], workers: int) -> Pace:
    """Carry tasks out; the first and the last few of each worker are not counted."""
    apart = 2 * workers
    numbered = ((i, make()) for i, make in enumerate(tasks))
    times, seconds = [], []
    for _, answer in engine.carry_out(numbered):
        assert not answer.problem, answer.problem
        times.append(time.perf_counter())
        seconds.append(answer.seconds)
    counted = slice(apart, len(times) - apart)
    spent = times[len(times) - apart - 1] - times[apart - 1]
    return Pace((len(times) - 2 * apart) / spent, float(np.mean(seconds[counted])))


def virtual_tasks(folder: Path, count: int) -> list[Callable[[], SpreadTask]]:
    """Blocks of virtual measurements on the demo's fitted machine."""
    prepare(1, Workshop(folder), _quietly)
    model = (folder / "model.toml").read_bytes()
    return block_tasks(model, PART.format(signals=SIGNALS).encode(), 1, 250 * count)


@contextmanager
def _quietly(_: str) -> Iterator[Callable[[str], None]]:
    yield lambda _: None


def diagnosis_work(folder: Path, count: int) -> list[Callable[[], SpreadTask]]:
    """Campaigns of simulated machines with hidden causes, a machine each."""
    chosen = list(scenarios())
    for i, scenario in enumerate(chosen[:: max(1, len(chosen) // count)][:count]):
        stage = scene(scenario.seed, scenario.kind)
        hidden = hide(scenario, stage)
        own = folder / f"machine-{i:03d}"
        own.mkdir(parents=True)
        omitted = [cause.omits for cause, _ in hidden if cause.omits]
        (own / "model.toml").write_text(stage.model_text(omitted), encoding="utf-8")
        (own / "campaign.csv").write_text(stage.simulate(hidden).text, encoding="utf-8")
    return diagnosis_tasks(fleet_campaigns(folder))


def measured(tasks: Sequence[Callable[[], SpreadTask]], folder: Path) -> dict[str, list[Pace]]:
    """Way of spreading → its pace with one and with two workers."""
    found: dict[str, list[Pace]] = {"processes here": [], "Dask": []}
    for workers in (1, 2):
        found["processes here"].append(pace(ProcessPool(workers), tasks, workers))
        own = folder / f"dask-{workers}"
        own.mkdir(parents=True)
        with dask_processes(own, workers) as cluster:
            engine = DaskCluster(SchedulerAddress(cluster.address))
            while True:
                if _present(engine) == workers:
                    break
                time.sleep(0.1)
            found["Dask"].append(pace(engine, tasks, workers))
    return found


def _present(engine: DaskCluster) -> int:
    from distributed import Client

    with Client(engine.scheduler.address, set_as_default=False) as client:
        return len(client.nthreads())


def section(
    work: dict[str, dict[str, list[Pace]]], sizes: dict[str, tuple[int, int, int]], load: float
) -> str:
    """The section of docs/performance.md."""
    lines = []
    for name, ways in work.items():
        for way, (one, two) in ways.items():
            lines.append(
                f"| {name} | {way} | {one.seconds:.2f} | {two.seconds:.2f} | "
                f"{two.rate / one.rate:.2f} | {two.rate / one.rate / 2.0:.2f} |"
            )
    virtual, diagnosis = sizes["virtual measurements"], sizes["diagnosis"]
    seconds = float(np.mean([p.seconds for ways in work["diagnosis"].values() for p in ways]))
    draws = float(
        np.mean([p.seconds for ways in work["virtual measurements"].values() for p in ways])
    )
    count = MACHINES * CAMPAIGNS
    total = seconds * count
    rows = "\n".join(lines)
    paragraphs = [
        "## Work spread over workers",
        f"{machine()}. One and two workers in processes of their own, after they have started, "
        "while each of them is busy: tasks per second with two over those with one; 1.00 of linear "
        "is twice as many. A task is a block of 250 virtual measurements of a part of 32 points on "
        "a fitted machine of 222 parameters, or the diagnosis of a simulated campaign with hidden "
        "causes. The ratio of the wall clock holds for a quiet machine only; processor seconds a "
        "task, which two workers must not raise, for a busy one as well. Load while this was "
        f"measured: {load:.1f} on {os.cpu_count()} cores"
        + (": **the ratio waits for a quiet machine**." if load > QUIET else "."),
        "| work | spread over | processor s a task, 1 worker | 2 workers | 2 ÷ 1 | of linear |\n"
        f"| --- | --- | ---: | ---: | ---: | ---: |\n{rows}",
        f"A task goes out with {virtual[0] / 1e3:.0f} kB (virtual measurements) or "
        f"{diagnosis[0] / 1e3:.0f} kB (diagnosis: the model and its campaign), and comes back as "
        f"{virtual[1] / 1e3:.0f} or {diagnosis[1] / 1e3:.1f} kB.",
        f"**A thousand machines × a hundred campaigns**, reckoned from these: {count:,} diagnoses "
        f"of {seconds:.1f} processor seconds are {total / 3600.0:,.0f} hours of one processor, "
        f"{total / 3600.0 / PROCESSORS:.1f} hours of {PROCESSORS} workers. "
        f"{diagnosis[0] * count / 1e9:.1f} GB go out once, "
        f"{diagnosis[0] / seconds * PROCESSORS / 1e6:.2f} MB/s for those {PROCESSORS}, "
        f"{diagnosis[1] * count / 1e9:.2f} GB come back; the scheduler hands out "
        f"{PROCESSORS / seconds:.0f} tasks a second (Dask states some thousand). The client holds "
        f"three tasks a worker, {3 * PROCESSORS * diagnosis[0] / 1e6:.0f} MB, and all answers. "
        f"Where each machine brings a hundred campaigns a year, a store grows by "
        f"{diagnosis[2] * count / 1e9:.1f} GB of campaigns and {diagnosis[1] * count / 1e9:.2f} GB "
        "of diagnoses a year, apart from the history of runs. A part program with 100,000 draws "
        f"takes {400 * draws:.0f} processor seconds, {400 * draws / PROCESSORS:.0f} s of "
        f"{PROCESSORS} workers.",
    ]
    return "\n\n".join(paragraphs)


def main() -> None:
    """Measure, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=40)
    parser.add_argument("--print-only", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="abbe-spreading-") as name:
        folder = Path(name)
        work = {
            "virtual measurements": virtual_tasks(folder / "demo", options.tasks),
            "diagnosis": diagnosis_work(folder / "fleet", options.tasks),
        }
        paces, sizes = {}, {}
        load = os.getloadavg()[0]
        for what, tasks in work.items():
            sizes[what] = _sizes(tasks)
            paces[what] = measured(tasks, folder / what.split()[0])
        text = section(paces, sizes, load)
    print(text)
    if not options.print_only:
        write_section("spreading", text)


def _sizes(tasks: Sequence[Callable[[], SpreadTask]]) -> tuple[int, int, int]:
    """Bytes of a task on its way out, of its answer, and of what it reads besides the model."""
    from abbe.daemon.spreading.spread_work import perform

    few = [make() for make in tasks[:: max(1, len(tasks) // 6)]]
    out = np.mean([len(pickle.dumps(TaskPayload.of(task))) for task in few])
    back = np.mean([len(perform(TaskPayload.of(task)).body) for task in few])
    campaigns = [len(t.contents.get("campaign.csv", b"")) for t in few]
    return int(out), int(back), int(np.mean(campaigns))


if __name__ == "__main__":
    main()
