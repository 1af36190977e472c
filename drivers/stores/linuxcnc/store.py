"""The store of a LinuxCNC on this computer: compensation files of all joints, switched as one.

LinuxCNC reads ``COMP_FILE`` of each joint when it starts, and never again. So that it can never
start with files of two tables, all joints read theirs through one symbolic link (`SetFolders`), and
the link is what an upload switches. The table acts once LinuxCNC was started anew; then the
running LinuxCNC itself shows what it does.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from abbe.drivers import resources
from abbe.drivers.link import LinkConfigError, LinkDownError, LinkError, LinkTimeoutError
from abbe.drivers.linuxcnc.restarting import run_command
from abbe.drivers.linuxcnc.running import Task, find_task
from abbe.drivers.stores.base import (
    Files,
    Identity,
    Progress,
    Readiness,
    RefusedError,
    ShownCorrection,
    Store,
    StoreConfig,
)
from abbe.drivers.stores.linuxcnc.config import LinuxCncStoreConfig
from abbe.drivers.stores.linuxcnc.ini import NEUTRAL, IniLayout, read_layout
from abbe.drivers.stores.linuxcnc.loaded import loaded, note_switch, restart_needed
from abbe.drivers.stores.linuxcnc.running import Running, attached, largest_trim
from abbe.drivers.stores.set_folders import SetFolders

_LOOK = 0.1
"""s between two looks whether LinuxCNC is back."""


class LinuxCncStore(Store):
    """Compensation files of one LinuxCNC.

    Parameters
    ----------
    name
        For messages.
    config
        Its section.
    """

    Config: ClassVar[type[StoreConfig]] = LinuxCncStoreConfig

    def __init__(self, name: str, config: LinuxCncStoreConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._ini = Path(config.ini)
        self._opened: tuple[IniLayout, SetFolders] | None = None
        self._moved = False

    @property
    def owns(self) -> tuple[str, ...]:
        """The LinuxCNC of this computer, and the files of this one."""
        return resources.linuxcnc(), resources.linuxcnc(str(self._ini))

    async def open(self) -> None:
        """Read the INI file and see whether its compensation files can be switched.

        Raises
        ------
        LinkConfigError
            When they cannot; says which lines to write.
        LinkDownError, LinkTimeoutError
            When LinuxCNC's parser cannot be run.
        """
        layout = await read_layout(self._config.python, self._ini)
        if self._config.verify_by_moving and not layout.trivial:
            raise LinkConfigError(
                f"{self.name}: verify_by_moving needs [KINS] KINEMATICS = trivkins: with others an "
                "axis moves several joints"
            )
        folders = SetFolders(layout.root)
        try:
            folders.check()
        except ValueError as error:
            raise LinkConfigError(f"{self.name}: {error}") from None
        self._opened = layout, folders
        self._moved = False
        self._look_for_restart()

    async def close(self) -> None:
        """Forget what was read."""
        self._opened = None

    async def identity(self) -> Identity:
        """LinuxCNC's version and the machine's name; as serial number the INI file."""
        layout, _ = self._there()
        return Identity(f"LinuxCNC {layout.version}, {layout.machine}".rstrip(", "), str(self._ini))

    async def readiness(self) -> Readiness:
        """Not running is ready; running, it must be idle, stand still and be homed."""
        self._look_for_restart()
        if self._task() is None:
            return Readiness(idle=True, referenced=True)
        async with self._attached() as running:
            state = await running.state()
        hindrances = []
        if not self._is_ours(state):
            hindrances.append(f"LinuxCNC runs {state['ini']}, not {self._ini}")
        if not state["idle"]:
            hindrances.append("a programme runs")
        elif not state["in_position"]:
            hindrances.append("the machine moves")
        unhomed = [str(j) for j, homed in enumerate(state["homed"]) if not homed]
        if unhomed:
            hindrances.append(f"not homed: joint {', '.join(unhomed)}")
        return Readiness(
            idle=state["idle"] and state["in_position"],
            referenced=not unhomed,
            hindrances=tuple(hindrances),
        )

    async def active(self, progress: Progress = lambda _: None) -> Files:
        """The files that LinuxCNC reads when it starts (`restart_needed`: it has not read them).

        Raises
        ------
        LinkError
            When a file was changed or cannot be read.
        """
        layout, folders = self._there()
        try:
            files = folders.read_current(layout.names)
        except (OSError, ValueError) as error:
            raise LinkError(f"{self.name}: {error}") from error
        progress(1.0)
        return files

    async def stage(self, files: Files, progress: Progress = lambda _: None) -> None:
        """Write a set into a folder of its own, beside the current one.

        Raises
        ------
        RefusedError
            When the INI file names other files, or a file would correct too much.
        LinkError
            When it cannot be written.
        """
        layout, folders = self._there()
        strange = sorted(set(files) - set(layout.names))
        if strange or not files:
            raise RefusedError(
                f"{self.name}: {', '.join(strange) or 'nothing'} to upload; {self._ini.name} reads "
                f"{', '.join(layout.names)}"
            )
        largest = largest_trim(files, layout.kinds)
        if not largest <= self._config.max_correction:
            raise RefusedError(
                f"{self.name}: LinuxCNC would correct by {largest:g}, more than max_correction = "
                f"{self._config.max_correction:g}. Are the files of the INI file's COMP_FILE_TYPE, "
                f"{', '.join(f'{n}: {k}' for n, k in layout.kinds.items())}?"
            )
        try:
            folders.write_next(files, self._fillers(files))
        except OSError as error:
            raise LinkError(f"{self.name}: not written: {error}") from error
        progress(1.0)

    async def staged(self, progress: Progress = lambda _: None) -> Files:
        """The folder that was written, read again; empty when it is not whole."""
        _, folders = self._there()
        files = folders.read_next()
        progress(1.0)
        return files or {}

    async def activate(self, files: Files) -> None:
        """Switch the link to what is staged; LinuxCNC reads it at its next start.

        Raises
        ------
        RefusedError
            When something else is staged, the INI file was changed, or LinuxCNC is just starting:
            nothing was switched.
        LinkError
            When it cannot be written.
        """
        layout, folders = self._there()
        if not files or folders.read_next() != dict(files):
            raise RefusedError(f"{self.name}: something else is staged; nothing was switched")
        if await read_layout(self._config.python, self._ini) != layout:
            raise RefusedError(f"{self.name}: {self._ini} was changed; nothing was switched")
        await self._switch()

    async def discard(self) -> None:
        """Remove all folders but the current one."""
        _, folders = self._there()
        try:
            folders.discard_next()
        except OSError as error:
            raise LinkError(f"{self.name}: {error}") from error

    async def deactivate(self) -> None:
        """Switch to files without effect: LinuxCNC does not start when one is missing."""
        _, folders = self._there()
        try:
            folders.write_next({}, self._fillers({}))
        except OSError as error:
            raise LinkError(f"{self.name}: not written: {error}") from error
        await self._switch()

    async def restart(self) -> None:
        """Run the configured command and wait until LinuxCNC has read the current files.

        Raises
        ------
        RefusedError
            When there is no such command, it fails, or the machine is not idle.
        LinkTimeoutError
            When LinuxCNC is not back in time.
        """
        command = self._config.restart
        if not command:
            await super().restart()
        if self._task() is not None:
            async with self._attached() as running:
                state = await running.state()
            if not (state["idle"] and state["in_position"]):
                raise RefusedError(f"{self.name}: not restarted: the machine is not idle")
        deadline = time.monotonic() + self._config.restart_timeout
        before = self._task()
        try:
            await run_command(command, self._ini.parent, deadline - time.monotonic())
        except LinkTimeoutError as error:
            raise LinkTimeoutError(f"{self.name}: {error}") from error
        except LinkError as error:
            raise RefusedError(f"{self.name}: not restarted: {error}") from error
        while time.monotonic() < deadline:
            task = self._task()
            if task is not None and task != before:
                with contextlib.suppress(LinkDownError):
                    async with self._attached() as running:
                        await running.state()
                    self._moved = False
                    self._look_for_restart()
                    return
            await asyncio.sleep(_LOOK)
        raise LinkTimeoutError(
            f"{self.name}: LinuxCNC is not back {self._config.restart_timeout:g} s after "
            f"{' '.join(command)}"
        )

    async def effects(self) -> Sequence[ShownCorrection]:
        """What the running LinuxCNC adds to each axis where it stands, or on small moves.

        Empty when it does not run or is not homed.

        Raises
        ------
        LinkError
            When it is gone, or does not stand still.
        """
        self._look_for_restart()
        if self._task() is None:
            return ()
        config = self._config
        async with self._attached() as running:
            state = await running.state()
            if not self._is_ours(state) or not all(state["homed"]):
                return ()
            if config.verify_by_moving and not self._moved and state["on"] and state["idle"]:
                seen = await running.move(
                    config.verify_step, config.verify_points, config.verify_feed
                )
                self._moved = True  # once is enough, however often the effect is looked at
                return seen
            return await running.watch(config.watch)

    # What is under it

    def _there(self) -> tuple[IniLayout, SetFolders]:
        if self._opened is None:
            raise LinkDownError(f"{self.name} is closed")
        return self._opened

    def _fillers(self, files: Files) -> dict[str, str]:
        """Files without effect for the joints that have none."""
        layout, _ = self._there()
        return {name: NEUTRAL for name in layout.names if name not in files}

    def _is_ours(self, state: Mapping[str, Any]) -> bool:
        return Path(state["ini"]).resolve() == self._ini

    def _task(self) -> Task | None:
        layout, _ = self._there()
        return find_task(layout.task, self._ini)

    @contextlib.asynccontextmanager
    async def _attached(self) -> AsyncIterator[Running]:
        layout, _ = self._there()
        joints = {layout.axis(name): joint for name, joint in layout.joints.items()}
        async with attached(self._config.python, joints, self._config.timeout) as running:
            yield running

    def _look_for_restart(self) -> None:
        _, folders = self._there()
        self.restart_needed = restart_needed(folders, self._task())

    async def _switch(self) -> None:
        """Switch the link, unless LinuxCNC is reading the files at this moment."""
        _, folders = self._there()
        if self._task() is not None:
            try:
                async with self._attached() as running:
                    if not self._is_ours(await running.state()):
                        raise LinkDownError("another one runs")
            except LinkError as error:
                raise RefusedError(
                    f"{self.name}: LinuxCNC is starting or ending ({error}); nothing was switched"
                ) from error
        before = loaded(folders, self._task())
        self._moved = False
        try:
            folders.switch()
            note_switch(folders, self._task(), before)
        except OSError as error:
            raise LinkError(f"{self.name}: {error}") from error
        self._look_for_restart()
