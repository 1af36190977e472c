"""Some signals of a message, decoded by themselves: what cantools makes of the whole frame."""

from __future__ import annotations

import math
import random
from itertools import combinations

import cantools
import pytest

from abbe.drivers.can.dbc.file import decoder
from tests.support.drivers.can.links import DBC

MIXED = """VERSION ""

NS_ :

BS_:

BU_: Abbe Box

BO_ 1 MIXED: 8 Box
 SG_ a : 0|12@1- (0.25,-3) [0|0] "mm" Abbe
 SG_ b : 23|12@0- (0.5,1) [0|0] "mm" Abbe
 SG_ c : 24|4@1+ (1,0) [0|0] "" Abbe
 SG_ d : 39|32@0- (1,0) [0|0] "V" Abbe

BO_ 2 LITTLE: 6 Box
 SG_ a : 3|17@1+ (0.001,0) [0|0] "mm" Abbe
 SG_ f : 24|16@1- (1,0) [0|0] "" Abbe

VAL_ 1 c 1 "open" 2 "shut" ;
SIG_VALTYPE_ 1 d : 1;
"""


def messages() -> list[cantools.database.can.Message]:
    return [
        *cantools.database.load_string(MIXED, "dbc").messages,
        *cantools.database.load_file(DBC).messages,
    ]


@pytest.mark.parametrize("message", messages(), ids=lambda message: message.name)
def test_any_choice_of_signals_has_the_values_of_the_whole(
    message: cantools.database.can.Message,
) -> None:
    generator = random.Random(5)
    names = [signal.name for signal in message.signals]
    choices = [c for n in range(1, len(names) + 1) for c in combinations(names, n)]
    multiplexed = message.is_multiplexed()
    for used in choices:
        decode = decoder(message, used)
        for more in (0, 0, 0, 3):
            data = bytearray(generator.randbytes(message.length + more))
            if multiplexed:
                data[0] = generator.choice([0, 1])  # its pages
            expected = message.decode(bytes(data), decode_choices=False)
            assert isinstance(expected, dict)
            found = decode(bytes(data))
            assert set(found) == (set(expected) if multiplexed else set(used))
            for name, value in found.items():
                same = value == expected[name]
                assert same or (math.isnan(value) and math.isnan(float(str(expected[name]))))
        with pytest.raises(ValueError, match="the DBC file says"):
            decode(bytes(message.length - 1))
