"""The run that is shown: that of a configuration, or the only one of this computer."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.errors import AbbeError
from abbe.daemon.answers.status import made_from, the_run
from abbe.daemon.control.runs import Found, found_runs
from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.status.text import summary


class SoughtRun:
    """A run that is asked, and sought again when it has ended.

    Parameters
    ----------
    config
        Its configuration; None: whichever runs on this computer, if it is the only one.
    """

    def __init__(self, config: Path | None) -> None:
        self._config = config
        self._found: Found | None = None

    def status(self) -> RunStatus:
        """Its status now.

        Raises
        ------
        AbbeError
            When nothing runs, several do, or it does not answer.
        """
        found, self._found = self._found, None
        if found is not None:
            try:
                status = found.ask_again()
            except AbbeError:
                pass  # it has ended; perhaps another one has begun
            else:
                self._found = found
                return status
        return self._seek()

    def _seek(self) -> RunStatus:
        runs = found_runs()
        known = [(run, run.status) for run in runs if run.status is not None]
        if self._config is not None:
            known = [(run, status) for run, status in known if made_from(status, self._config)]
            if not known:
                return the_run(self._config)
        if len(known) == 1:
            self._found, status = known[0]
            return status
        if known:
            which = "; ".join(summary(status) for _, status in known)
            raise AbbeError(
                f"several corrections run on this computer: abbe open CONFIG.toml says which "
                f"({which})"
            )
        silent = "; ".join(f"{run.peer}: {run.reason}" for run in runs)
        more = f"; what runs cannot be asked: {silent}" if silent else ""
        raise AbbeError(f"no correction runs on this computer{more}")
