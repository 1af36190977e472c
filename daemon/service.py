"""The service: links opened and supervised, the pipeline run, everything ended cleanly."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import NoReturn

from abbe.compcore.errors import AbbeError
from abbe.daemon.config import Configuration
from abbe.daemon.control.controls import Controls
from abbe.daemon.control.server import ControlServer
from abbe.daemon.identity import RunIdentity
from abbe.daemon.ownership.claims import held_by_run
from abbe.daemon.ownership.lock import hold
from abbe.daemon.pipeline.cycle import LAST_WORD, Pipeline
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.record import Listener
from abbe.daemon.records.recorder import Recorder
from abbe.daemon.records.run import recorded
from abbe.daemon.reload import Prepared, Takeover, prepare
from abbe.daemon.systemd.notify import Notifier
from abbe.daemon.systemd.supervised import Supervised
from abbe.daemon.upload.history.unfinished import unfinished_in
from abbe.drivers.link import Link

logger = logging.getLogger("abbe.service")

_OPEN_WITHIN = 5.0
"""s that a link is given to open before the cycle begins without it."""


_LOOK = 10.0
"""s between two looks at whether the files are still those that run."""
_GRACE = 2.0
"""s that a link is given, beyond the ramp, to take the last word, and to close."""


class Service:
    """One configuration at work.

    Parameters
    ----------
    configuration
        What was checked.
    links
        Its links where they are made already; default: made from the configuration.
    notifier
        The service manager; default: the one that started this process, if one did.

    Attributes
    ----------
    links
        By name; opened in `run`.
    pipeline
        Made, not yet running; its listeners can be added to.
    identity
        Version and files of what runs.
    uncertainty
        How sure the correction is.
    again
        Whether, after a reload that changed wires, Abbe has to begin anew once it has ended.
    """

    def __init__(
        self,
        configuration: Configuration,
        links: Mapping[str, Link] | None = None,
        notifier: Notifier | None = None,
    ) -> None:
        self.configuration = configuration
        self.identity = RunIdentity.of(configuration)
        self.again = False
        self.links = configuration.make_links() if links is None else dict(links)
        self.pipeline = Pipeline(configuration, self.links)
        self.uncertainty = LiveUncertainty(
            configuration.model, self.pipeline.axes, lambda: self.pipeline.tool
        )
        self.add([self.uncertainty])
        self._stop = asyncio.Event()
        self._at_once = asyncio.Event()
        self._notifier = Notifier.of_environment() if notifier is None else notifier
        self._reloading: asyncio.Task[None] | None = None
        self._recorder: Recorder | None = None

    def add(self, listeners: Sequence[Listener]) -> None:
        """Have more listeners told of every cycle."""
        self.pipeline.listeners.extend(listeners)

    def owning(self) -> AbstractContextManager[None]:
        """Hold what must not be written to by two; nothing is opened before.

        Raises
        ------
        InUseError
            On entry, when somebody holds it.
        """
        resources = held_by_run(self.configuration, self.links)
        return hold(resources, f"live correction with {self.configuration.path.resolve()}")

    def stop(self) -> None:
        """End: ramp the correction to zero first; called again, end at once."""
        if self._stop.is_set():
            self._at_once.set()
        self._stop.set()

    def hang_up(self) -> None:
        """SIGHUP: a service reloads; with a terminal that was closed it ends, with the ramp.

        Shell and kernel may both say that a terminal was closed: a second time changes nothing.
        """
        if self._notifier.there:
            self.reload()
        elif not self._stop.is_set():
            logger.info("the terminal was closed: ending")
            self.stop()

    def reload(self) -> None:
        """Take over what stands in the files now, while the correction goes on where it can.

        What cannot be read changes nothing, and is said. A reload while one is under way, or while
        the service ends, is none.
        """
        if self._stop.is_set() or (self._reloading and not self._reloading.done()):
            return
        self._notifier.reloading()
        self._reloading = asyncio.create_task(self._reload())

    async def _reload(self) -> None:
        path = self.configuration.path
        try:
            new = await asyncio.to_thread(prepare, path, self.configuration, self.identity)
        except AbbeError as error:
            logger.error("reload: %s; going on with what runs: %s", error, self.identity.words())
        except Exception:
            logger.exception("reload failed; going on with what runs: %s", self.identity.words())
        else:
            self._take_over(new)
        finally:
            if not self.again:
                self._notifier.ready()

    def _take_over(self, new: Prepared) -> None:
        if self._stop.is_set():
            return
        logger.info("reload: %s: %s", new.change.value, new.identity.words())
        if new.change is Takeover.ANEW:
            self.again = True
            self.stop()
        elif new.compensation is not None and new.expected is not None:
            self.pipeline.change_model(new.configuration, new.compensation, new.expected)
            self.uncertainty.change_model(new.configuration.model)
            self.configuration, self.identity = new.configuration, new.identity
            if self._recorder is not None:
                self._recorder.began(new.identity, new.configuration.model.machine.name)

    async def _watch_files(self) -> None:
        """Say, once, that a file was changed since it was read."""
        known: tuple[object, ...] = ()
        while True:
            await asyncio.sleep(_LOOK)
            changed = await asyncio.to_thread(self.identity.changed)
            if changed and changed != known:
                names = " and ".join(path.name for path in changed)
                how = (
                    f"systemctl reload takes {'it' if len(changed) == 1 else 'them'} over"
                    if self._notifier.there
                    else "it counts from the next start on"
                )
                logger.warning("%s on disk is not what runs any more: %s", names, how)
            known = changed

    async def run(self, duration: float | None = None) -> None:
        """Run until `stop`, SIGINT, SIGTERM or SIGHUP, or for `duration` s.

        A device that cannot be reached is no error: its link goes on trying.

        Raises
        ------
        LinkConfigError
            When a link can never work.
        NotToldError
            When the controller could not be told of the end: it may go on with what it holds.
        AbbeError
            When a driver hung, so that the correction could not be ramped down.
        """
        loop = asyncio.get_running_loop()
        timer = None if duration is None else loop.call_later(duration, self._stop.set)
        self._supervise()
        control = self._control()
        watching = asyncio.create_task(self._watch_files())
        looking = asyncio.create_task(self.uncertainty.run())
        with (
            _signals(loop, self),
            recorded(self.configuration, self.pipeline, self.identity) as self._recorder,
        ):
            try:
                await asyncio.gather(*(self._open(link) for link in self.links.values()))
                # what is there by now stays: the collector need not walk it within a cycle
                gc.collect()
                gc.freeze()
                logger.info("running: %s: %s", self.configuration.path, self.identity.words())
                self._warn_of_uploads()
                if control is not None:
                    await control.start()
                await self._until_ended()
            finally:
                gc.unfreeze()
                if control is not None:
                    await control.stop()
                watching.cancel()
                looking.cancel()
                if self._reloading is not None:
                    await asyncio.wait({self._reloading}, timeout=_GRACE)
                if timer is not None:
                    timer.cancel()
                await asyncio.gather(*(self._close(link) for link in self.links.values()))
                self._notifier.close()

    def _control(self) -> ControlServer | None:
        """Where a person may change what runs, if the configuration says so."""
        path = self.configuration.control_path
        return None if path is None else ControlServer(path, Controls(self))

    def _supervise(self) -> None:
        """Have the service manager, where there is one, told of every cycle."""
        if self._notifier.there:
            file = self.configuration.file
            self.add([Supervised(self._notifier, tuple(file.output.axes), file.cycle.period)])

    def _warn_of_uploads(self) -> None:
        """Say that an upload of tables was cut off: which table is active is not sure then."""
        upload = self.configuration.upload
        reported = unfinished_in(upload.journal) if upload is not None else ""
        if reported:
            logger.warning("%s; run abbe upload %s --recover", reported, self.configuration.path)

    async def _until_ended(self) -> None:
        """Run the pipeline; a driver that never returns cannot keep the service from ending.

        Raises
        ------
        NotToldError
            When the controller could not be told.
        AbbeError
            When it was told, but the correction not ramped down.
        """
        running = asyncio.create_task(self.pipeline.run(self._stop, self._at_once))
        stopped = asyncio.create_task(self._stop.wait())
        at_once = asyncio.create_task(self._at_once.wait())
        ending = self.pipeline.ending
        try:
            await asyncio.wait({running, stopped}, return_when=asyncio.FIRST_COMPLETED)
            grace = self.pipeline.longest_end + LAST_WORD + _GRACE
            await asyncio.wait(
                {running, at_once}, timeout=grace, return_when=asyncio.FIRST_COMPLETED
            )
            if at_once.done():
                await asyncio.wait({running}, timeout=LAST_WORD + _GRACE)
            if running.done():
                running.result()
                ending.check()
                logger.info("ended")
                return
            running.cancel()
            await asyncio.wait({running}, timeout=_GRACE)
            await ending.tell(LAST_WORD)
            ending.check()
            raise AbbeError(
                "ended without ramping the correction down, because a driver does not come back; "
                "the controller was told (status word 0)"
            )
        finally:
            for task in (running, stopped, at_once):
                task.cancel()
            await asyncio.wait({running, stopped, at_once}, timeout=_GRACE)

    async def _open(self, link: Link) -> None:
        try:
            async with asyncio.timeout(_OPEN_WITHIN):
                await link.open()
        except TimeoutError:
            logger.warning(
                "link %s: not open after %g s; going on without it", link.name, _OPEN_WITHIN
            )

    async def _close(self, link: Link) -> None:
        try:
            async with asyncio.timeout(_GRACE):
                await link.close()
        except TimeoutError:
            logger.warning("link %s: not closed after %g s", link.name, _GRACE)
        except Exception:
            logger.exception("link %s: its driver failed while closing", link.name)


def begin_again() -> NoReturn:
    """Replace this process by the same command, begun anew; its number stays, for the manager."""
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


@contextlib.contextmanager
def _signals(loop: asyncio.AbstractEventLoop, service: Service) -> Iterator[None]:
    handlers = {signal.SIGINT: service.stop, signal.SIGTERM: service.stop}
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        # nohup has a process outlive its terminal: then it goes on
        handlers[signal.SIGHUP] = service.hang_up
    for number, handler in handlers.items():
        loop.add_signal_handler(number, handler)
    try:
        yield
    finally:
        for number in handlers:
            loop.remove_signal_handler(number)
