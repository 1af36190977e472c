"""Where the proofs take place: a virtual machine with a package on a stick, and two controllers."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from abbe.daemon.demo.configuration import demo_configuration
from abbe.daemon.demo.simulator import simulated_bridge
from tests.support.daemon.live_run import MODEL
from tests.support.systemd import image
from tests.support.systemd.container import check, contained
from tests.support.systemd.machine import (
    HOST,
    PATIENCE,
    Machine,
    fill,
    media,
    running,
    spare_disk,
)
from tests.support.systemd.package import built, later
from tests.support.systemd.page import commands
from tests.support.systemd.witness import Seen, Witness, witness

RATE = 0.5
"""mm/s by which the correction may change."""
_PLACES = {"mill-7": "350,450,-180", "mill-8": "50,850,-350"}
"""Machine → where it stands, mm: somewhere with some 10 µm of error."""
_SLOW = (
    ("timeout = 0.3 ", "timeout = 3.0 "),
    ("stale_after = 0.3 ", "stale_after = 3.0 "),
    ("signals_stale_after = 5.0 ", "signals_stale_after = 30.0 "),
)
"""An emulated processor is some twenty times slower than a real one."""
# no part of the product: patience with an emulated processor
_PATIENCE = "[Service]\nTimeoutStartSec=900s\n"
_FULL = 2


@dataclass
class Stage:
    """The machine, its controllers, and what was typed so far.

    Attributes
    ----------
    machine
        The virtual machine.
    controllers
        Machine tool's name → who looks at its controller's registers.
    typed
        Commands of the page that were carried out.
    """

    machine: Machine
    controllers: dict[str, Witness]
    configurations: dict[str, str]
    typed: set[str] = field(default_factory=set)

    def page(self, command: str, status: int = 0) -> str:
        """Carry out a command that stands on the page; what it said."""
        assert command in commands(), f"docs/install.md does not have: {command}"
        self.typed.add(command)
        found, out = self.machine.run(f"cd /root && {command}")
        assert found == status, f"{command}: status {found}: {out[-1500:]}"
        return out.rstrip("\n")

    def show(self, name: str, what: str) -> str:
        """A property of a service."""
        return self.machine.do(f"systemctl show abbe@{name} -p {what} --value")

    def journal(self, name: str, boot: str = "-b") -> str:
        """What the service and its manager said."""
        return self.machine.do(f"journalctl -u abbe@{name} {boot} --no-pager -o cat")

    def until_full(self, name: str, since: int | None = None) -> Seen:
        """Wait until the controller has the whole correction; how it looked then.

        By a heart that beats: what one that was killed left behind looks the same but for that.
        """
        beats: set[int] = set()

        def full(look: Seen) -> bool:
            beats.add(look.heartbeat)
            return bool(look.status & _FULL and look.size > 5.0 and len(beats) > 1)

        return self.controllers[name].until(full, PATIENCE, since)

    def mark(self, name: str) -> int:
        """Index of the look that comes next."""
        return len(self.controllers[name].seen)

    def status(self, name: str) -> dict[str, Any]:
        """What ``abbe status --json`` says."""
        out = self.machine.do(f"abbe status /etc/abbe/{name}/config.toml --json")
        found: dict[str, Any] = json.loads(out)
        return found

    def until_restarted(self, name: str, before: str) -> str:
        """Wait until another process runs and is ready; how long it took, s."""
        began = time.monotonic()
        shown = f"systemctl show abbe@{name} -p MainPID -p ActiveState -p SubState"
        self.machine.until(
            shown,
            lambda out: (
                "SubState=running" in out
                and f"MainPID={before}\n" not in out
                and "MainPID=0" not in out
            ),
        )
        return f"{time.monotonic() - began:.0f}"

    def unplug_and_boot(self) -> None:
        """Restart the computer as ``systemctl reboot`` does; wait until it is back."""
        self.machine.tell("systemctl reboot")
        self.machine.booted()
        self.machine.do(self.machine.plug_in)


@contextmanager
def stage(folder: Path, *, container: bool = False) -> Iterator[Stage]:
    """Everything that the proofs need; over when the context is.

    Parameters
    ----------
    folder
        For the stick, the console's text and sockets.
    container
        A container in place of the virtual machine.

    Raises
    ------
    CannotPrepareError
        Where no virtual machine can be made.
    """
    if container:
        check()
        tree = image.debian()
    else:
        made = image.prepare()
    first = built()
    files = {"first.deb": first, "later.deb": later(first), "model.toml": MODEL}
    with ExitStack() as stack:
        controllers, configurations, ports = {}, {}, []
        for name, place in _PLACES.items():
            simulator = stack.enter_context(
                simulated_bridge(1, 1.0, ["--noise", "0", "--stand-at", place])
            )
            ports.append(simulator.port)
            controllers[name] = stack.enter_context(witness(simulator.port))
            text = demo_configuration({**simulator.ready, "host": HOST}, "model.toml", 0.1)
            for old, new in _SLOW:
                assert old in text, old
                text = text.replace(old, new)
            configurations[name] = text + '\n[records]\nfile = "records.sqlite"\n'
        if container:
            stick = folder / "outside" / "stick"
            stick.mkdir(parents=True)
            fill(stick, files)
            machine = contained(tree, ports, folder, spare_disk(folder))
        else:
            machine = running(made, media(folder, files), folder)
        found = Stage(stack.enter_context(machine), controllers, configurations)
        _furnish(found)
        yield found
    shutil.rmtree(folder / "media", ignore_errors=True)


def _furnish(stage: Stage) -> None:
    """Put on the computer what its owner has there before Abbe comes."""
    machine = stage.machine
    machine.do(machine.plug_in)
    machine.put("/usr/local/bin/sudo", '#!/bin/sh\nexec "$@"\n')
    machine.do("chmod 755 /usr/local/bin/sudo")
    # what a person answers
    machine.put("/etc/apt/apt.conf.d/90answer", 'APT::Get::Assume-Yes "true";\n')
    for number, file in (("0.1.0", "first"), ("0.2.0", "later")):
        machine.do(f"ln -s /media/stick/{file}.deb /root/abbe_{number}_amd64.deb")
    for name, text in stage.configurations.items():
        machine.do(f"mkdir -p /root/{name} && cp /media/stick/model.toml /root/{name}/")
        machine.put(f"/root/{name}/config.toml", text)
        machine.do(f"mkdir -p /etc/systemd/system/abbe@{name}.service.d")
        machine.put(f"/etc/systemd/system/abbe@{name}.service.d/90-patience.conf", _PATIENCE)
    machine.do("useradd --create-home quality")
