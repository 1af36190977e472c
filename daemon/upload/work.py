"""The work of an upload: one configuration, its store, its journal and its operator."""

from __future__ import annotations

import getpass
import os
import secrets
import socket
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from abbe.compcore.model.model import Model
from abbe.daemon.config.sections.upload import UploadSetup
from abbe.daemon.installed import abbe_version
from abbe.daemon.upload.changeover import Changeover
from abbe.daemon.upload.history.content import Content
from abbe.daemon.upload.history.upload_log import Journal
from abbe.daemon.upload.ledger import Ledger
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.steps import Allowed, ContentChange, Steps
from abbe.drivers.controllers import Controller
from abbe.drivers.stores.base import Identity, Store


@dataclass(frozen=True, eq=False)
class Work:
    """One configuration, its controller and its journal, while the lock is held."""

    setup: UploadSetup
    model: Model
    controller: Controller
    store: Store
    journal: Journal
    operator: OperatorPort
    who: str

    @property
    def tell(self) -> Callable[[str], None]:
        """A line for people."""
        return self.operator.tell

    @property
    def allowed(self) -> Allowed:
        """Times and tolerances of the configuration."""
        section = self.setup.section
        return Allowed(
            section.step_timeout,
            section.patience,
            section.effect_tolerance_um,
            section.effect_looks,
            section.effect_every,
        )

    def context(self, identity: Identity, old: Content, new: Content, model: Any) -> dict[str, Any]:
        """What every line of one upload carries."""
        moment = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
        return {
            "upload": f"{moment}-{secrets.token_hex(3)}",
            "who": self.who,
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "abbe": abbe_version(),
            "controller": {"name": identity.name, "serial": identity.serial},
            "dialect": self.controller.name,
            "model": model,
            "old": old.sha256,
            "new": new.sha256,
        }

    def changeover(
        self,
        change: ContentChange,
        ledger: Ledger,
        back_up: Callable[[], Path],
        backup: Path | None = None,
    ) -> Changeover:
        """The sequence of a change; `backup` is where the old set is kept already."""
        steps = Steps(
            self.store, self.controller, change, self.allowed, self.operator, back_up, backup
        )
        return Changeover(steps, ledger)


def user() -> str:
    """Who is logged in."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""
