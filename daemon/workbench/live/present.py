"""The run that is shown at present, with its files: model, stream, records."""

from __future__ import annotations

import threading
from pathlib import Path

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.workbench.live.places import file_of, records_of, stream_of
from abbe.daemon.workbench.live.sought import SoughtRun
from abbe.daemon.workbench.versions.seen_file import SeenFile


class PresentRun:
    """A run and what its files say; may be asked from any thread.

    Parameters
    ----------
    config
        Its configuration; None: whichever runs on this computer.
    """

    def __init__(self, config: Path | None) -> None:
        self.config = config
        self._sought = SoughtRun(config)
        self._lock = threading.Lock()
        self._latest: RunStatus | None = None
        self._model: tuple[Path, str, Model] | None = None
        self.stream: Path | None = None
        """The socket of its stream; None: it has none, or nothing runs."""

    def status(self) -> RunStatus:
        """Its status now; raises `AbbeError` as `SoughtRun.status`."""
        with self._lock:
            before, found = self._latest, self._sought.status()
            self._latest = found
            if before is None or before.owner != found.owner:
                config = file_of(found, "configuration")
                self.stream = None if config is None else stream_of(config)
            return found

    @property
    def model(self) -> Model:
        """The model that corrects, or corrected last.

        Raises
        ------
        InputError
            When it cannot be read, and where another one lies on the disk now.
        """
        files = () if self._latest is None else self._latest.files
        running = next((f for f in files if f.role == "model"), None)
        if running is None:
            raise InputError("no run was seen yet, so no model is known")
        path, known = Path(running.path), self._model
        if known is None or known[:2] != (path, running.sha256):
            seen = SeenFile(path)
            model = load_model(path)
            if seen.sha256 != running.sha256:
                raise InputError("the file on the disk is another one than what runs", file=path)
            self._model = known = (path, running.sha256, model)
        return known[2]

    @property
    def model_or_none(self) -> Model | None:
        """The same; None where it cannot be read."""
        try:
            return self.model
        except AbbeError:
            return None

    @property
    def records(self) -> Path | None:
        """The database of its records; None where it keeps none.

        Raises
        ------
        InputError
            When nothing is known of the run, or its configuration is not in order.
        """
        config = self.config
        if config is None and self._latest is not None:
            config = file_of(self._latest, "configuration")
        if config is None:
            raise InputError("no run was seen yet, so its records are not known")
        return records_of(config)
