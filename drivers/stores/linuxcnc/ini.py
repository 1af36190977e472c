"""Compensation files of joints in an INI file, and whether it lets them be switched."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import abbe.drivers.linuxcnc
from abbe.drivers.link import LinkConfigError, LinkDownError, LinkTimeoutError

_FACTS = Path(abbe.drivers.linuxcnc.__file__).with_name("ini_facts.py")
_PATIENCE = 20.0
"""s for LinuxCNC's parser to answer."""
_ROTARY = "ABC"
NEUTRAL = "0 0 0\n"
"""A compensation file without effect, of either type: no trim anywhere."""


@dataclass(frozen=True, slots=True)
class IniLayout:
    """The joints and compensation files of an INI file.

    Attributes
    ----------
    ini
        Its path.
    version
        LinuxCNC's.
    machine
        ``[EMC] MACHINE``.
    task
        Name of the task process.
    trivial
        Whether joints are axes (``trivkins``).
    root
        The folder in which ``current`` is the link to the files of all joints.
    joints
        File → the first joint that reads it.
    kinds
        File → COMP_FILE_TYPE.
    """

    ini: Path
    version: str
    machine: str
    task: str
    trivial: bool
    root: Path
    joints: dict[str, int]
    kinds: dict[str, int]

    @property
    def names(self) -> tuple[str, ...]:
        """All files that LinuxCNC needs to start."""
        return tuple(self.joints)

    def axis(self, name: str) -> str:
        """The axis of a file."""
        return name.partition(".")[0].upper()


def is_rotary(axis: str) -> bool:
    """Whether an axis is in degrees."""
    return axis in _ROTARY


async def read_layout(python: str, ini: Path) -> IniLayout:
    """Read an INI file with LinuxCNC's own parser.

    Raises
    ------
    LinkDownError, LinkTimeoutError
        When that cannot be run.
    LinkConfigError
        When the compensation files could not be switched all at once; says which lines to write.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            python,
            str(_FACTS),
            str(ini),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
    except OSError as error:
        raise LinkDownError(f"cannot start {python}: {error.strerror}") from error
    try:
        out, complaint = await asyncio.wait_for(process.communicate(), _PATIENCE)
    except TimeoutError:
        process.kill()
        raise LinkTimeoutError(f"{python} did not read {ini} in {_PATIENCE:g} s") from None
    try:
        facts = json.loads(out.splitlines()[-1])
    except (ValueError, IndexError):
        raise LinkDownError(
            f"{python} did not read {ini}: {complaint.decode(errors='replace').strip()[-200:]}"
        ) from None
    if "error" in facts:
        raise LinkDownError(f"{ini}: {facts['error']}")
    return _layout(ini, facts)


def _layout(ini: Path, facts: dict[str, Any]) -> IniLayout:
    letters = facts["coordinates"].replace(" ", "").upper() or "XYZABCUVW"
    joints: dict[str, int] = {}
    kinds: dict[str, int] = {}
    folders = set()
    for joint in facts["joints"]:
        stated = joint["comp_file"]
        if stated is None:
            continue
        path = ini.parent / stated
        folders.add(path.parent)
        axis = path.name.partition(".")[0].upper()
        if path.name in joints and kinds[path.name] != joint["comp_type"]:
            raise _refused(ini, facts, letters, f"{stated} has two COMP_FILE_TYPEs")
        if path.name != f"{axis.lower()}.comp" or len(axis) != 1 or axis not in letters:
            raise _refused(ini, facts, letters, f"COMP_FILE = {stated} is not named after its axis")
        joints.setdefault(path.name, joint["number"])
        kinds[path.name] = joint["comp_type"]
    if not joints:
        raise _refused(ini, facts, letters, "no joint has a COMP_FILE")
    if len(folders) > 1 or next(iter(folders)).name != "current":
        raise _refused(
            ini,
            facts,
            letters,
            "the COMP_FILEs are not in one folder named current, so that LinuxCNC could start "
            "with files of two tables",
        )
    return IniLayout(
        ini,
        facts["version"],
        facts["machine"],
        facts["task"],
        facts["kinematics"].startswith("trivkins"),
        next(iter(folders)).parent,
        joints,
        kinds,
    )


def _refused(ini: Path, facts: dict[str, Any], letters: str, why: str) -> LinkConfigError:
    """What is wrong, and the lines that mend it."""
    lines = []
    for joint, letter in zip(facts["joints"], letters, strict=False):
        kind = joint["comp_type"]
        lines.append(
            f"  [JOINT_{joint['number']}]\n"
            f"  COMP_FILE = comp/current/{letter.lower()}.comp\n"
            f"  COMP_FILE_TYPE = {kind}"
        )
    head = f"{ini}: {why}."
    copies = [
        f"cp '{joint['comp_file']}' comp/mine/{letter.lower()}.comp"
        if joint["comp_file"]
        else f"echo 0 0 0 > comp/mine/{letter.lower()}.comp"
        for joint, letter in zip(facts["joints"], letters, strict=False)
    ]
    if any(joint["comp_file"] for joint in facts["joints"]):
        keep = ["mkdir -p comp/mine", *copies, "ln -s mine comp/current"]
        head += f" Keep the files that act now: in {ini.parent}\n  " + "\n  ".join(keep) + "\nThen"
    else:
        head += " The first upload makes the folder, and LinuxCNC needs it to start; before that,"
    return LinkConfigError(head + f" write into {ini.name}:\n" + "\n".join(lines))
