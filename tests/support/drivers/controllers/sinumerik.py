"""What a SINUMERIK makes of its archives, written from the manual apart from the dialect.

6FC5397-1BP40-3BA1, K3: linear between interpolation points, ends held; table number is index plus
one; the product is added. What the factors of a product do by themselves the manual leaves open.
"""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np

READINGS = {
    "both factors act as well": (1.0, 1.0),
    "the product stands alone": (0.0, 0.0),
    "the product takes its own table's place": (0.0, 1.0),
    "the second factor is one only": (1.0, 0.0),
}
"""How much of the first and of the second factor acts by itself."""


def moved_by(files: dict[str, str], where: dict[str, np.ndarray], reading: str) -> np.ndarray:
    """How far X, Y and Z stand from where they would stand without the tables, (n, 3), mm."""
    first, second = READINGS[reading]
    points: dict = defaultdict(dict)
    stated: dict = defaultdict(dict)
    for text in files.values():
        for found in re.finditer(r"^\$A[AN]_(\w+)\[([^]]*)\]=(\S+)$", text, re.MULTILINE):
            name, inside, value = found.groups()
            index = inside.split(",")
            if name == "ENC_COMP":
                points[index[2]][int(index[1])] = float(value)
            elif name == "CEC":
                points[int(index[0])][int(index[1])] = float(value)
            elif name.startswith("ENC"):
                stated[index[-1]][name.removeprefix("ENC_COMP_")] = value
            else:
                stated[int(index[0])][name.removeprefix("CEC_")] = value

    def at(table, axis: str) -> np.ndarray:
        own = stated[table]
        nodes = np.arange(float(own["MIN"]), float(own["MAX"]) + 1e-6, float(own["STEP"]))
        return np.interp(where[axis], nodes, [points[table][i] for i in range(len(nodes))])

    moves = {a: np.zeros(len(where["X"])) for a in "XYZ"}
    factors = {int(own["MULT_BY_TABLE"]) - 1 for t, own in stated.items() if isinstance(t, int)}
    for table, own in stated.items():
        if isinstance(table, str):
            # added to the actual value: the axis moves the other way
            moves[table[0]] -= at(table, table[0])
            continue
        value, output = at(table, own["INPUT_AXIS"][1]), own["OUTPUT_AXIS"][1]
        number = int(own["MULT_BY_TABLE"])
        if number:
            by = at(number - 1, stated[number - 1]["INPUT_AXIS"][1])
            moves[output] += first * value + value * by
        else:
            moves[output] += value * (second if table in factors else 1.0)
    return np.stack([moves[a] for a in "XYZ"], axis=1)
