"""The service: links opened and supervised, the pipeline run, everything ended cleanly."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import NoReturn

from abbe.compcore.errors import AbbeError
from abbe.compcore.model.model import Switch
from abbe.daemon.answers.typed import uploading
from abbe.daemon.beside import beside
from abbe.daemon.checks.live import LiveChecks
from abbe.daemon.collector import as_a_service
from abbe.daemon.config import Configuration
from abbe.daemon.config.identity import RunIdentity
from abbe.daemon.control.live_switches import back_words, start_words
from abbe.daemon.ownership.claims import held_by_run
from abbe.daemon.ownership.lock import hold
from abbe.daemon.pipeline.cycle import LAST_WORD, Pipeline
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.record import Listener
from abbe.daemon.pipeline.writing.reported_uncertainty import ReportedUncertainty
from abbe.daemon.records.recorder import Recorder
from abbe.daemon.records.run import recorded
from abbe.daemon.reload import Prepared, Takeover, prepare
from abbe.daemon.status.logbook import Logbook
from abbe.daemon.systemd.late_cycles import LateCycles
from abbe.daemon.systemd.notify import Notifier
from abbe.daemon.systemd.supervised import Supervised
from abbe.daemon.upload.history.unfinished import unfinished_in
from abbe.drivers.link import Link

logger = logging.getLogger("abbe.service")

_OPEN_WITHIN = 5.0
"""s that a link is given to open before the cycle begins without it."""


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
    checks
        What check measurements say of the machine.
    logbook
        What the status says of the run so far.
    switches_in_file
        Effects' switches as the model file has them; `abbe switch` changes those that count.
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
        self.switches_in_file: Mapping[str, Switch] = configuration.model.switches
        self.again = False
        self.links = configuration.make_links() if links is None else dict(links)
        self.pipeline = Pipeline(configuration, self.links)
        self.uncertainty = LiveUncertainty(
            configuration.model, self.pipeline.axes, lambda: self.pipeline.tool
        )
        self._reported = ReportedUncertainty(
            configuration, self.links, self.pipeline, self.uncertainty
        )
        self.checks = LiveChecks(lambda: self.configuration, self.links, self.pipeline)
        holds = held_by_run(configuration, self.links)
        self.logbook = Logbook(self.pipeline, configuration.model.machine, holds)
        self.add([self.uncertainty])
        self._stop = asyncio.Event()
        self._at_once = asyncio.Event()
        self._notifier = Notifier.of_environment() if notifier is None else notifier
        self._late = LateCycles(configuration.file.cycle.period, self._notifier.watchdog)
        self.add([self._late])
        self._reloading: asyncio.Task[None] | None = None
        self._recorder: Recorder | None = None

    def add(self, listeners: Sequence[Listener]) -> None:
        """Add listeners to every cycle."""
        self.pipeline.listeners.extend(listeners)

    def owning(self) -> AbstractContextManager[None]:
        """Hold what must not be written to by two; nothing is opened before.

        Raises
        ------
        InUseError
            On entry, when somebody holds it.
        """
        what = f"live correction with {self.configuration.path.resolve()}"
        return hold(self.logbook.holds, what)

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
            logger.error(
                "reload: %s; going on with what runs: %s",
                error,
                self.identity.words(),
                extra={"event": "reload refused"},
            )
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
        said = {"event": "reloaded"}
        logger.info("reload: %s: %s", new.change.value, new.identity.words(), extra=said)
        self._say_switched_back(new.configuration.model.switches)
        if new.change is Takeover.ANEW:
            self.again = True
            self.stop()
        elif new.compensation is not None and new.expected is not None:
            self.pipeline.change_model(new.configuration, new.compensation, new.expected)
            self.uncertainty.change_model(new.configuration.model)
            self.configuration, self.identity = new.configuration, new.identity
            self.switches_in_file = new.configuration.model.switches
            self.checks.judge_anew()
            if self._recorder is not None:
                self._recorder.began(new.identity, new.configuration.model.machine.name)

    def _say_switched_back(self, then: Mapping[str, Switch]) -> None:
        """Say which live switches count no longer, the others being `then`."""
        running = self.configuration
        switches = (running.model.switches, self.switches_in_file, then)
        if words := back_words(*switches, running.model_path):
            logger.warning("compensation: %s", words)

    async def run(self, duration: float | None = None) -> None:
        """Run until `stop`, SIGINT, SIGTERM or SIGHUP, or for `duration` s.

        A device that cannot be reached is no error: its link goes on trying.

        Raises
        ------
        LinkConfigError
            When a link can never work.
        NotToldError
            When the controller could not be informed of the end: it may go on with what it holds.
        AbbeError
            When a driver hung, so that the correction could not be ramped down.
        """
        loop = asyncio.get_running_loop()
        timer = None if duration is None else loop.call_later(duration, self._stop.set)
        self._supervise()
        with (
            _signals(loop, self),
            self.logbook.open(),
            recorded(
                self.configuration, self.pipeline, self.identity, self.uncertainty
            ) as self._recorder,
        ):
            try:
                await asyncio.gather(*(self._open(link) for link in self.links.values()))
                with as_a_service():
                    await self._work()
            finally:
                if not self.again:
                    self._say_switched_back(self.switches_in_file)
                if self._reloading is not None:
                    await asyncio.wait({self._reloading}, timeout=_GRACE)
                if timer is not None:
                    timer.cancel()
                await asyncio.gather(*(self._close(link) for link in self.links.values()))
                self._notifier.close()

    def _supervise(self) -> None:
        """Report every cycle to the service manager, where there is one."""
        if self._notifier.there:
            file = self.configuration.file
            self.add([Supervised(self._notifier, tuple(file.output.axes), file.cycle.period)])

    async def _work(self) -> None:
        """Say what runs, and run it with all that goes on beside it."""
        logger.info(
            "running: %s: %s",
            self.configuration.path,
            self.identity.words(),
            extra={"event": "began"},
        )
        logger.info(start_words(self.configuration.model, self.configuration.model_path))
        self._warn_of_uploads()
        if self._recorder is not None:
            self.checks.keep = self._recorder.keep
        async with (
            beside(self, supervised=self._notifier.there),
            self._reported.running(),
            self.checks.running(),
        ):
            with self._late.running():
                await self._until_ended()

    def _warn_of_uploads(self) -> None:
        """Say that an upload of tables was cut off: which table is active is not sure then."""
        upload = self.configuration.upload
        reported = unfinished_in(upload.journal) if upload is not None else ""
        if reported:
            recovering = uploading(self.configuration.path, "--recover")
            logger.warning("%s; run %s", reported, recovering)

    async def _until_ended(self) -> None:
        """Run the pipeline; a driver that never returns cannot keep the service from ending.

        Raises
        ------
        NotToldError
            When the controller could not be informed.
        AbbeError
            When it was informed, but the correction not ramped down.
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
                logger.info("ended", extra={"event": "ended"})
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
