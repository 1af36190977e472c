"""What runs beside the correction while it runs: none of it is waited for by the cycle."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from abbe.compcore.errors import AbbeError
from abbe.daemon.control.controls import ControlledService, Controls
from abbe.daemon.control.doors import ControlDoor, StatusDoor
from abbe.daemon.control.server import ControlServer
from abbe.daemon.status.status_source import ObservedService

logger = logging.getLogger("abbe.service")

_LOOK = 10.0
"""s between two looks at whether the files are still those that run."""
_GRACE = 5.0
"""s that all of it is given to end."""


@asynccontextmanager
async def beside(service: ControlledService, *, supervised: bool) -> AsyncIterator[None]:
    """Doors for those who ask, an eye on the files and on how sure the correction is, HTTP, MQTT,
    OPC UA, the plant's store.

    Parameters
    ----------
    service
        What runs.
    supervised
        Whether a service manager started it.

    Raises
    ------
    AbbeError
        On entry, when the control socket that the configuration names cannot be had.
    """
    controls = Controls(service)
    async with AsyncExitStack() as stack:
        path = service.configuration.control_path
        if path is not None:
            await _open(ControlServer(ControlDoor(path), controls), stack)
        if StatusDoor.can_be():
            try:
                await _open(ControlServer(StatusDoor(), controls), stack)
            except AbbeError as error:
                logger.warning("abbe status will not find this run: %s", error)
        tasks = {
            asyncio.create_task(_watch_files(service, supervised=supervised)),
            asyncio.create_task(service.uncertainty.run()),
            asyncio.create_task(_show(service, controls)),
            asyncio.create_task(_publish(service, controls)),
            asyncio.create_task(_serve_opcua(service, controls)),
            asyncio.create_task(_store(service, controls)),
        }
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks, timeout=_GRACE)


async def _open(server: ControlServer, stack: AsyncExitStack) -> None:
    await server.start()
    stack.push_async_callback(server.stop)


async def _watch_files(service: ObservedService, *, supervised: bool) -> None:
    """Say, once, that a file was changed since it was read."""
    known: tuple[object, ...] = ()
    while True:
        await asyncio.sleep(_LOOK)
        changed = await service.logbook.look_at_files(service.identity)
        if changed and changed != known:
            names = " and ".join(path.name for path in changed)
            how = (
                f"systemctl reload takes {'it' if len(changed) == 1 else 'them'} over"
                if supervised
                else "it counts from the next start on"
            )
            event = {"event": "file changed"}
            logger.warning("%s on disk is not what runs any more: %s", names, how, extra=event)
        known = changed


async def _show(service: ObservedService, controls: Controls) -> None:
    """Keep the HTTP process running, where the configuration wants one."""
    setup = service.configuration.http
    if setup is not None:
        # its packages are there only for those who ask for it
        from abbe.daemon.http.supervisor import HttpProcess

        await HttpProcess(service, controls, setup).run()


async def _publish(service: ObservedService, controls: Controls) -> None:
    """Keep the process that publishes running, where the configuration names a broker."""
    setup = service.configuration.mqtt
    if setup is not None:
        # nothing of it is there for those who do not ask for it
        from abbe.daemon.side_process.told import ToldProcess

        module, every = "abbe.daemon.mqtt.process", setup.section.every
        await ToldProcess("mqtt", module, service, controls, setup.task(), every).run()


async def _serve_opcua(service: ObservedService, controls: Controls) -> None:
    """Keep the OPC UA server running, where the configuration wants one."""
    setup = service.configuration.opcua_server
    if setup is not None:
        from abbe.daemon.side_process.told import ToldProcess

        module, every = "abbe.daemon.opcua_server.process", setup.section.every
        await ToldProcess("opcua_server", module, service, controls, setup.task(), every).run()


async def _store(service: ObservedService, controls: Controls) -> None:
    """Keep the process that uploads running, where the configuration names a plant's store."""
    setup = service.configuration.fleet
    if setup is not None:
        # nothing of it is there for those who do not ask for it
        from abbe.daemon.fleet.uploading.supervisor import StoreProcess

        await StoreProcess(service, controls, setup).run()
