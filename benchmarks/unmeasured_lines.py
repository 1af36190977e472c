"""Lines that nobody measured, after a calibration by each instrument: least squares, and cautious.

The exact simulated bridge at 20 °C, measured as ``abbe plan`` chooses with one instrument; the
start model with play fitted to it. No model of Abbe's says what the machine does.

    python -m benchmarks.unmeasured_lines
"""

from __future__ import annotations

import sys

import numpy as np

from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import fit
from abbe.drivers.simulated.bridge.machine import make_bridge
from benchmarks.measuring.report import write_section
from benchmarks.validation import PAGE, table
from tests.support.drivers.measured_bridge import measured_by, on_unseen_lines

PLANS = (
    ("ball-bar", 4.0), ("ball-plate", 4.0), ("gauge-block", 4.0), ("step-gauge", 4.0),
    ("laser", 4.0), ("laser", 8.0), ("laser-tracker", 4.0), ("tracker", 4.0),
    ("laser,angle,straightness", 8.0),
)  # fmt: skip
MACHINES = range(1, 9)
_WORSE = 1.02
"""Of what there is without a model, from which a model is worse than none."""


def main() -> int:
    """Measure, fit both ways, write; 1 where a cautious model is worse than none."""
    rows, worse = [], 0
    for instruments, hours in PLANS:
        plain = measured_by(instruments, hours)
        found = []
        for seed in MACHINES:
            machine = make_bridge(seed)
            fitted = fit(plain.model, plain.campaign(machine, seed))
            careful = cautiously(fitted)
            models = (None, fitted.model, careful.model)
            found.append([on_unseen_lines(machine, m) for m in models])
        nothing, least, held = np.array(found).T
        worse += int((held > _WORSE * nothing).sum())
        most = float((held / nothing).max())
        means = [f"{v.mean():.2f}" for v in (nothing, least, held)]
        part, often = f"{(held / nothing).mean():.2f}", str(int((least > nothing).sum()))
        rows.append([instruments, f"{hours:g}", *means, part, f"{most:.2f}", often])
        print(*rows[-1], flush=True)
    head = ["instrument", "h", "nothing", "least squares", "cautious", "cautious ÷ nothing",
            "the worst machine", "least squares worse than nothing"]  # fmt: skip
    write_section(
        "unmeasured-lines",
        f"""## Lines that nobody measured, instrument by instrument

`python -m benchmarks.unmeasured_lines`: {len(MACHINES)} exact bridges (not Abbe's model), each
measured by one plan of one instrument, fitted by the start model with play. 50 lines anywhere, rms
in µm, mean of the machines: without a correction, by least squares (`abbe fit`), with
[cautious values](fit.md#cautious-values) (`abbe fit --cautious`, `abbe calibrate`).

{table(head, rows)}
""",
        PAGE,
    )
    return int(worse > 0)


if __name__ == "__main__":
    sys.exit(main())
