"""Joints and compensation files of an INI file, by LinuxCNC's own parser.

Run by the system's Python with the INI file's path as its argument; imports nothing of Abbe.
Answers one line of JSON: ``{"version": …, "machine": …, "joints": [{"number": 0, …}, …], …}`` or
``{"error": …}``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

MOST_BYTES = 1_000_000
"""Of an INI file."""
MOST_JOINTS = 16
"""LinuxCNC's own limit."""


def facts(path: str) -> dict[str, Any]:
    """What the file says; lengths in the unit that it names."""
    import linuxcnc

    if not Path(path).is_file():
        return {"error": "there is no such file"}
    if Path(path).stat().st_size > MOST_BYTES:
        return {"error": f"larger than {MOST_BYTES / 1e6:g} MB"}
    ini = linuxcnc.ini(path)
    joints = []
    count = int(ini.find("KINS", "JOINTS") or 0)
    if not 0 <= count <= MOST_JOINTS:
        return {"error": f"[KINS] JOINTS is not believable, expected 0 to {MOST_JOINTS}"}
    for number in range(count):
        section = "JOINT_" + str(number)
        joints.append(
            {
                "number": number,
                "comp_file": ini.find(section, "COMP_FILE"),
                "comp_type": int(ini.find(section, "COMP_FILE_TYPE") or 0),
                "type": ini.find(section, "TYPE") or "LINEAR",
            }
        )
    return {
        "version": linuxcnc.version,
        "machine": ini.find("EMC", "MACHINE") or "",
        "task": ini.find("TASK", "TASK") or "milltask",
        "kinematics": ini.find("KINS", "KINEMATICS") or "",
        "coordinates": ini.find("TRAJ", "COORDINATES") or "",
        "joints": joints,
    }


def main() -> int:
    """Answer; always status 0, a failure is an answer too."""
    try:
        said = facts(sys.argv[1])
    except Exception as error:  # noqa: BLE001 - LinuxCNC's module raises its own
        said = {"error": str(error) or type(error).__name__}
    sys.stdout.write(json.dumps(said) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
