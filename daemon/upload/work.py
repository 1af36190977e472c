"""The work of an upload: one configuration, its store, its journal and its operator."""

from __future__ import annotations

import getpass
import os
import secrets
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from abbe.compcore.model.model import Model
from abbe.daemon.answers.inputs import abbe_version
from abbe.daemon.config.upload import UploadSetup
from abbe.daemon.upload.history.content import Content
from abbe.daemon.upload.history.upload_log import Journal
from abbe.daemon.upload.shown_correction import Expectation
from abbe.daemon.upload.steps import Allowed, Changeover, Ledger
from abbe.drivers.controllers import Controller
from abbe.drivers.stores.base import Identity, Store


@dataclass(frozen=True)
class OperatorPort:
    """The port to the operator: messages, progress, questions.

    Attributes
    ----------
    tell
        A line for people.
    progress
        Part of a transfer that is done, 0 to 1.
    ask
        Whether to go on; is given what would change.
    restarted
        Asks for a restart of the controller; True once it was done, False when nobody is there.
    """

    tell: Callable[[str], None]
    progress: Callable[[float], None]
    ask: Callable[[list[str]], bool]
    restarted: Callable[[], Awaitable[bool]]


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
        identity: Identity,
        ledger: Ledger,
        old: Content,
        new: Content,
        expected: Expectation,
        back_up: Callable[[], Path],
    ) -> Changeover:
        """The sequence from one set to another."""
        return Changeover(
            self.store, identity, self.controller, ledger, old, new, expected, self.allowed,
            back_up, self.tell, self.operator.progress, self.operator.restarted,
        )  # fmt: skip


def user() -> str:
    """Who is logged in."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""
