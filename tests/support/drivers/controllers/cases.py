"""Small tables with numbers that can be followed by eye, one case for each dialect and form.

Where a maker's manual has a worked example, its numbers are used, so that the golden file can be
laid beside the page.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.tables.table import Table, move

DEGREE = np.pi / 180.0


def machine(code: str = "w b X Y Z t") -> Machine:
    structure = Structure.parse(code)
    travels = {"X": (-100.0, 100.0), "Y": (0.0, 100.0), "Z": (-50.0, 0.0)}
    axes = {a: Axis(a, travels.get(a, (-90 * DEGREE, 90 * DEGREE))) for a in structure.axes}
    return Machine("golden", structure, axes)


def one(output: str, inputs: str, nodes: list[float], up: list[float], down=None) -> Table:
    """A table of moves; values in mm, positions in mm."""
    back = None if down is None else np.array(down)
    return Table(move(output), (inputs,), (np.array(nodes),), np.array(up), back)


def motions(axis: str, nodes: list[float], rows: list[list[float]]) -> list[Table]:
    """Six error motions of an axis; rows of mm and rad."""
    values = np.array(rows)
    where = np.array(nodes)
    return [
        Table(ErrorMotion(axis, c), (axis,), (where,), values[:, k].copy())
        for k, c in enumerate("XYZABC")
    ]


def plane(outputs: str, rows: list[float], columns: list[float], values: list) -> list[Table]:
    """Tables over Y (rows) and X (columns); values (output, row, column), mm."""
    nodes = (np.array(rows), np.array(columns))
    return [
        Table(move(o), ("Y", "X"), nodes, np.array(v)) for o, v in zip(outputs, values, strict=True)
    ]


def fanuc_manual() -> list[Table]:
    """B-63980EN p. 100: entries 33 … 49 with the reference point at number 40, every 50 mm."""
    entries = np.array([2, 1, 1, -2, 0, -1, 0, -1, 2, 1, 0, -1, -1, -2, 0, 1, 2])
    sums = np.concatenate([[0], np.cumsum(entries)])
    nodes = (np.arange(18) - 8) * 50.0
    return [one("X", "X", list(nodes), list(-1e-3 * (sums - sums[8])))]


def grid_of_the_standard() -> list[Table]:
    """ISO/TR 16907, table 2: X 0, 50, 100, compensations; here as errors, in mm and rad."""
    rows = np.array(
        [
            [0, 0, 0, 0, 0, 0],
            [0.001, 0.001, 0, 0.001, 0.002, 0],
            [0.002, -0.002, -0.001, -0.003, -0.003, -0.002],
        ]
    )
    nodes = (np.array([0.0, 50.0, 100.0]), np.zeros(1), np.zeros(1))
    return [
        Table(
            move(c),
            ("X", "Y", "Z"),
            nodes,
            (-rows[:, k] * (DEGREE if c in "ABC" else 1.0)).reshape(3, 1, 1),
        )
        for k, c in enumerate("XYZABC")
    ]


LINUXCNC = [one("X", "X", [-100, 0, 100], [-0.010, 0.0, 0.030], [-0.020, -0.010, 0.015])]
SSFK = [
    one("X", "X", [-20.0, -19.9306, -19.8667, 33.5591], [0.0, 0.0024, -0.0102, -0.0055],
        [0.0, 0.0067, 0.0080, -0.0012]),
    one("Y", "X", [-20.0, 5.0], [0.0012, -0.0034]),
]  # fmt: skip
ISG = [
    *motions("X", [0, 10], [[0.02, 0.01, 0.07, 0, 0.0042, 0.003],
                            [0, -0.1, 0.01, 0, 0.0011, 0.002]]),
    *motions("Y", [-5, 0, 5], [[1e-3, 2e-3, 3e-3, 1e-5, 2e-5, 3e-5], [0] * 6,
                               [-1e-3, -2e-3, -3e-3, -1e-5, -2e-5, -3e-5]]),
]  # fmt: skip
SIEMENS = [
    one("X", "X", [-100, 0, 100], [0.003, 0.010, 0.012]),
    one("Z", "Y", [0, 50, 100], [-0.001, -0.010, -0.012]),
    one("X", "Z", [-50, -25, 0], [0.002, 0.001, 0.0], [0.004, 0.002, 0.001]),
]
PRODUCT = [
    one("Y", "Y", [0, 50, 100], [0.0, 0.001, 0.0]),
    one("X", "Z", [-50, -25, 0], [0.002, 0.001, 0.0]),
    # X carried along by an angle of Y, 16 µrad at Y = 50, with the height above Z = -25
    Table(move("X"), ("Y",), (np.array([0.0, 50.0, 100.0]),), np.array([0.0, 1.6e-5, -8e-6]),
          lever=("Z", -25.0)),
]  # fmt: skip
ISO = [
    *motions("X", [0, 50, 100], [[0.0] * 6, [0.0015, 0.0, 0.0, 1e-5, 0.0, -2e-6],
                                 [0.0019, 0.002, -0.003, 2e-5, 0.0, 4e-6]]),
]  # fmt: skip
ISO[0] = Table(
    ErrorMotion("X", "X"), ("X",), ISO[0].nodes, ISO[0].forward, np.array([0.0008, 0.0022, 0.0025])
)


TNC = [
    # MANUALplus 620 p. 716: Z = F(Z), Y = F(Y), sag Z = F(Y); every 5 mm from Z -200 and Y -90
    one("Y", "Y", [-90, -85, -80, -75], [0.0, 0.01, 0.02, -0.01], [-0.005, 0.008, 0.017, -0.014]),
    one("Z", "Y", [-90, -85, -80, -75], [0.0, -0.06, -0.09, -0.12]),
    one("Z", "Z", [-200, -195, -190], [0.0, 0.0123, -0.0004]),
]  # fmt: skip
KINEMATICS = [
    # iTNC 530 HSCI p. 684: EYX, EZX, EAX, EBX, ECX as Trans rows of C2 … C6 before MachAxis X
    *motions("X", [0, 50, 100], [[0.0] * 6,
                                 [0.01, 0.02, 0.03, *(np.array([1.2, -3.4, 0.5]) * 1e-3 * DEGREE)],
                                 [0.005, -0.02, 0.0, *(np.array([0.1, 0.2, -0.3]) * DEGREE)]]),
    *motions("Z", [-50, 0], [[0.001, 0.002, -0.003, 0.0, 1e-3 * DEGREE, 0.0], [0.0] * 6]),
]  # fmt: skip


@dataclass(frozen=True)
class Case:
    """Tables of errors, the dialect's options, and the folder of the golden files."""

    controller: str
    tables: Callable[[], list[Table]] | list[Table]
    options: dict[str, str] = field(default_factory=dict)
    variant: str = ""
    code: str = "w b X Y Z t"

    @property
    def folder(self) -> str:
        return self.controller + (f"-{self.variant}" if self.variant else "")

    def made(self) -> list[Table]:
        return self.tables() if callable(self.tables) else list(self.tables)


ROTARY = [
    Table(ErrorMotion("C", "C"), ("C",), (np.array([-90.0, 0.0, 45.0]) * DEGREE,),
          np.array([0.0010, 0.0, -0.0005]) * DEGREE),
    Table(move("X"), ("C",), (np.array([-90.0, 90.0]) * DEGREE,), np.array([0.004, -0.004])),
]  # fmt: skip

CASES = [
    Case("linuxcnc", LINUXCNC),
    Case("linuxcnc", LINUXCNC, {"type": "1"}, "trims"),
    Case("fanuc", fanuc_manual),
    Case("fanuc", [one("X", "X", [-50, 0, 50, 100], [0.014, 0.0, -0.007, 0.028],
                       [0.021, 0.007, 0.0, 0.035])],
         {"bidirectional": "true", "format": "16i", "first_point": "100"}, "two-ways"),
    Case("weihong", [one("X", "X", [-570.025, -450.020, -330.015, -210.010],
                         [0.027, 0.025, 0.015, 0.0], [0.083, 0.077, 0.068, 0.057]),
                     one("Y", "Y", [0.0, 1000.0], [0.0, 0.0], [0.030, 0.030])]),
    Case("pmac", [one("Y", "Y", list(np.arange(11) * 10.0),
                      [0, *(np.array([-16, -24, -32, -20, -8, 0, 8, 12, 4, 0]) / 16e3)]),
                  one("Z", "X", [-100, -50, 0, 50, 100], [2e-3, 1e-3, 0.0, -1e-3, -3e-3])]),
    Case("heidenhain-nd", [one("X", "X", [-100 + 16.384 * i for i in range(4)],
                               [0.0, 0.005, -0.012, 0.123]),
                           one("Z", "Y", [32.768 * i for i in range(3)], [0.0, -0.001, 0.002])]),
    Case("heidenhain-tnc", TNC),
    Case("heidenhain-tnc", KINEMATICS, {"form": "kinematics"}, "kinematics"),
    Case("aerotech-2d", plane("XY", [0, 10], [-20, 0, 20],
                              [[[-1e-4, 0, 1e-4], [2e-3, 0, -2e-3]],
                               [[2e-4, 0, -2.5e-4], [1.5e-4, 0, 1e-3]]])),
    Case("aerotech-2d", plane("XYZ", [5, 10, 15], [0, 50], np.arange(18).reshape(3, 3, 2) * 1e-3),
         {"outputs": "X,Y,Z"}, "triplets"),
    Case("siemens-840d", SIEMENS),
    Case("siemens-840d", [one("X", "X", [-100, 0, 100], [0.003, 0.0, 0.012],
                              [0.005, 0.001, 0.011])],
         {"pitch": "cec", "axes": "X:AX1,Y:AX2,Z:AX3"}, "cec"),
    Case("siemens-840d", PRODUCT, {"products": "mirrored"}, "products"),
    Case("siemens-840d", [ROTARY[0].on(np.array([-90.0, -45.0, 0.0, 45.0]) * DEGREE), ROTARY[1]],
         {}, "rotary", "w C' b X Y Z t"),
    Case("twincat-isg", ISG),
    Case("twincat-isg", SSFK, {"form": "axes"}, "axes"),
    Case("etalon-exchange", motions("Y", [-280, -270, -260, 260],
                                    [[-0.0013586, 0, 0, 0, 0, 2.23557e-5], [-0.0002407] + [0.0] * 5,
                                     [0.0008773] + [0.0] * 5, [-0.0012971] + [0.0] * 5])),
    Case("cmm-map", [*motions("X", [0, 200], [[0] * 6, [0.01, 0.02, 0.03, 2.1e-5, -1.5e-5, 9e-6]]),
                     *motions("Y", [0, 600], [[0] * 6,
                                              [0.009, 0.12, 0.018, 1.1e-5, 2.4e-5, 2.7e-5]]),
                     *motions("Z", [-50, 0], [[0.01, 0.02, 0.03, 1e-6, 2e-6, 3e-6], [0] * 6])]),
    Case("csv", ISO),
    Case("csv", ISO, {"reversal": "difference", "entries": "incremental", "sign": "compensation"},
         "difference"),
    Case("csv", [one("X", "X", [-50, 0, 50], [0.001, 0.0, 0.002], [0.003, 0.002, 0.004]),
                 one("Y", "X", [-50, 0, 50], [0.0005, 0.0, 0.001])],
         {"holds": "moves", "reversal": "single", "sign": "compensation"}, "single"),
    Case("grid-csv", grid_of_the_standard),
    Case("grid-csv", grid_of_the_standard, {"sign": "error"}, "error"),
]  # fmt: skip
