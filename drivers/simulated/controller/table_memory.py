"""A simulated controller's memory for tables: a staging area, an active image, one step between.

What is active survives a power cut: it is a file that is replaced as a whole. What is staged does
not. Images are zip archives; the control looks into them before it takes them.
"""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from abbe.drivers.simulated.controller.compensating import AppliedCompensation, NotATableError

NOT_READY, NOTHING_STAGED, CHECKSUM, TOO_LARGE, CONTENT, SESSION, NO = range(2, 9)
"""Reasons of a `ControlRefusesError`."""

_WORDS = {
    NOT_READY: "not idle or not referenced",
    NOTHING_STAGED: "nothing whole is staged",
    CHECKSUM: "checksum wrong",
    TOO_LARGE: "does not fit in",
    CONTENT: "not understood",
    SESSION: "of another session",
    NO: "protected",
}


class ControlRefusesError(Exception):
    """The control refuses an operation.

    Attributes
    ----------
    code
        Why, of the constants above.
    """

    def __init__(self, code: int, more: str = "") -> None:
        super().__init__(f"{_WORDS[code]}: {more}" if more else _WORDS[code])
        self.code = code


class PowerFailsError(Exception):
    """The power fails just now."""


class TableMemory:
    """One controller.

    Parameters
    ----------
    file
        Where the active image is kept; none: it does not survive the process.
    capacity
        Bytes that an image may have.
    acts_late
        The control reads its tables only when it is switched on.

    Attributes
    ----------
    idle, referenced
        State of the machine.
    session
        Number of the staging session; 0: none.
    fail_amid
        The power fails in the middle of the next commit.
    stations
        How often the positions were looked at; the axes step on each time.
    """

    def __init__(
        self, file: Path | None = None, capacity: int = 1 << 20, *, acts_late: bool = False
    ) -> None:
        self._acts_late = acts_late
        self._file = file
        self._capacity = capacity
        self.idle = self.referenced = True
        self.session = 0
        self.fail_amid = False
        self.stations = 0
        self.restarts = 0
        self._staged = bytearray()
        self._filled: set[int] = set()
        self._wanted = (0, 0)
        self.active = b""
        self._compensation = AppliedCompensation({})
        self._load()

    # the staging area

    def begin(self, session: int, length: int, crc: int) -> None:
        """Empty the staging area for an image of so many bytes."""
        if length > self._capacity:
            raise ControlRefusesError(TOO_LARGE)
        self.discard()
        self.session, self._wanted = session, (length, crc)
        self._staged = bytearray(length)

    def put(self, session: int, offset: int, data: bytes) -> None:
        """Store a block."""
        if not session or session != self.session:
            raise ControlRefusesError(SESSION)
        if offset + len(data) > len(self._staged):
            raise ControlRefusesError(TOO_LARGE)
        self._staged[offset : offset + len(data)] = data
        self._filled.update(range(offset, offset + len(data)))

    @property
    def staged(self) -> bytes:
        """What is staged, zeros where nothing came yet."""
        return bytes(self._staged)

    @property
    def whole(self) -> bool:
        """Whether all bytes of the staged image came, with the checksum that was announced."""
        length, crc = self._wanted
        return 0 < length == len(self._filled) and zlib.crc32(self._staged) == crc

    def discard(self) -> None:
        """Empty the staging area."""
        self.session, self._wanted = 0, (0, 0)
        self._staged, self._filled = bytearray(), set()

    # the one step

    def commit(self, length: int, crc: int) -> None:
        """Make the staged image active, if it is this one; all or nothing."""
        self._check_ready()
        if not self.whole:
            raise ControlRefusesError(NOTHING_STAGED)
        if (length, crc) != self._wanted:
            raise ControlRefusesError(CHECKSUM)
        image = self.staged
        try:
            AppliedCompensation(_files(image))
        except (NotATableError, zipfile.BadZipFile, ValueError) as error:
            raise ControlRefusesError(CONTENT, str(error)) from None
        self._replace(image)
        self.discard()

    def deactivate(self) -> None:
        """Make no table active."""
        self._check_ready()
        self._replace(b"")

    def load(self, files: Mapping[str, str]) -> None:
        """Make files active by hand, at the control itself; none: no table."""
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            for name, text in sorted(files.items()):
                info = zipfile.ZipInfo(name)
                info.create_system = 3
                archive.writestr(info, text.encode("utf-8"))
        self._replace(buffer.getvalue() if files else b"")

    def _check_ready(self) -> None:
        if not (self.idle and self.referenced):
            raise ControlRefusesError(NOT_READY)

    def _replace(self, image: bytes) -> None:
        if self._file is not None:
            new = self._file.with_name(self._file.name + ".new")
            with new.open("wb") as stream:
                stream.write(image)
                stream.flush()
                os.fsync(stream.fileno())
            if self.fail_amid:
                self.fail_amid = False
                raise PowerFailsError
            new.replace(self._file)
        compensation = AppliedCompensation(_files(image))
        self.active = image
        if not self._acts_late:
            self._compensation = compensation

    # power

    def restart(self) -> None:
        """Off and on again."""
        self.restarts += 1
        self.fail_amid = False
        self.discard()
        self._load()

    def _load(self) -> None:
        if self._file is not None:
            self._file.with_name(self._file.name + ".new").unlink(missing_ok=True)
            self.active = self._file.read_bytes() if self._file.exists() else b""
        self._compensation = AppliedCompensation(_files(self.active))

    # what it does

    def step(self) -> tuple[dict[str, float], dict[str, int], dict[str, float]]:
        """Jog a little; positions (mm), directions, and what is added to each axis (mm)."""
        self.stations += 1
        position, direction = {}, {}
        for k, axis in enumerate("XYZ"):
            curves = self._compensation.curves.get(axis)
            low, high = (
                (curves[0].positions[0], curves[0].positions[-1]) if curves else (0.0, 100.0)
            )
            # up and down through the range in 13, 14, 15 steps each way
            phase = self.stations % (2 * (13 + k))
            up = phase < 13 + k
            part = (phase if up else 2 * (13 + k) - phase) / (13 + k)
            position[axis] = low + 0.997 * part * (high - low)
            direction[axis] = 1 if up else -1
        return position, direction, self._compensation.correction(position, direction)

    @property
    def files(self) -> Mapping[str, str]:
        """The files of the active image."""
        return _files(self.active)


def _files(image: bytes) -> dict[str, str]:
    if not image:
        return {}
    with zipfile.ZipFile(io.BytesIO(image)) as archive:
        return {name: archive.read(name).decode("utf-8") for name in archive.namelist()}
