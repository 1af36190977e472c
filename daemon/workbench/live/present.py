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
        self._model: tuple[Path, int, Model] | None = None
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
            When it cannot be read.
        """
        path = None if self._latest is None else file_of(self._latest, "model")
        if path is None:
            raise InputError("no run was seen yet, so no model is known")
        try:
            stamp = path.stat().st_mtime_ns
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", file=path) from None
        known = self._model
        if known is None or known[:2] != (path, stamp):
            self._model = known = (path, stamp, load_model(path))
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
