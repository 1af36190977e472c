"""A configuration that is read anew when it, or the model that it names, has changed."""

from __future__ import annotations

import threading
from pathlib import Path

from abbe.daemon.config import Configuration, load_config


class FreshConfiguration:
    """A configuration that pages ask for again and again; may be asked from any thread.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    InputError
        For a configuration that is not in order; so does `now`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._known: tuple[tuple[tuple[int, int], ...], Configuration] | None = None
        self.now()

    def now(self) -> Configuration:
        """The configuration as its file is now."""
        with self._lock:
            if self._known is not None and self._known[0] == self._stamp(self._known[1]):
                return self._known[1]
            self._known = None
            found = load_config(self.path)
            self._known = (self._stamp(found), found)
            return found

    def _stamp(self, found: Configuration) -> tuple[tuple[int, int], ...]:
        stamps = []
        for path in (self.path, found.model_path):
            try:
                about = path.stat()
            except OSError:
                stamps.append((0, 0))
            else:
                stamps.append((about.st_mtime_ns, about.st_size))
        return tuple(stamps)
