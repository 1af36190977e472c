"""A real LinuxCNC, its compensation files behind one link, that a command starts anew."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from tests.support.drivers.linuxcnc.machine import PATIENCE, Machine

# Ends it and starts it again, switches on and homes, as a machine's own start-up may.
RESTART = """
import sys
sys.path.insert(0, {here!r})
from tests.support.drivers.linuxcnc.mill import Mill
Mill.existing({folder!r}, {mark!r}).start_anew()
"""


class Mill(Machine):
    """Not started before there are compensation files: it would not start without."""

    def __init__(self) -> None:
        super().__init__(
            {
                f"[JOINT_{i}]": f"[JOINT_{i}]\nCOMP_FILE = comp/current/{a}.comp\n"
                "COMP_FILE_TYPE = 0"
                for i, a in enumerate("xyz")
            }
        )

    @classmethod
    def existing(cls, folder: str, mark: str) -> Mill:
        """One that another process has made."""
        mill = cls()
        mill.folder, mill._mark = Path(folder), mark.encode()
        return mill

    def start(self) -> None:
        if (self.folder / "comp").exists():
            super().start()

    def restart_command(self) -> list[str]:
        """For a store's ``restart``."""
        script = self.folder / "restart.py"
        here = str(Path(__file__).parents[4])
        script.write_text(
            RESTART.format(here=here, folder=str(self.folder), mark=self._mark.decode())
        )
        return [sys.executable, str(script)]

    def start_anew(self) -> None:
        """What the command does."""
        self.end()
        self.start()
        self.ready()
        self._end_operator()

    def end(self) -> None:
        """End it and wait until nothing of it is left, so that it can be started again."""
        screen = self._screen()
        self._end_operator()
        if screen is not None:
            os.kill(screen, signal.SIGTERM)
        deadline = time.monotonic() + PATIENCE
        while self._running():
            assert time.monotonic() < deadline, "LinuxCNC does not end"
            time.sleep(0.05)
        if self._process is not None:
            self._process.wait(PATIENCE)
            self._process = None

    def _running(self) -> list[int]:
        return [pid for pid in self._all() if pid != os.getpid()]

    def stop(self) -> None:
        self.end()
        super().stop()

    def ready(self) -> None:
        """Switch on and home."""
        assert self.order("on") == []
        assert self.order("home") == []
