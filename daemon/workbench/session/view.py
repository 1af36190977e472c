"""What a session looks at: a version of a model, the campaigns beside it, what is known of both."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import require_signals
from abbe.daemon.workbench.campaigns.laid import LaidCampaigns
from abbe.daemon.workbench.session.findings import VersionFindings
from abbe.daemon.workbench.versions.folder import ModelVersion
from abbe.daemon.workbench.versions.seen_file import SeenFile


class SessionView:
    """The version and the campaigns that all windows look at; changed under the session's lock.

    Parameters
    ----------
    versions
        All that are known, the one that is looked at first.
    laid
        The campaigns.
    """

    def __init__(self, versions: Sequence[ModelVersion], laid: LaidCampaigns) -> None:
        self.versions = list(versions)
        self.current = self.versions[0]
        """Is looked at."""
        self.laid = laid
        """Lies beside it."""
        self.said: list[str] = list(laid.notes)
        """What making it, or laying the campaigns, said of itself."""
        self.findings = VersionFindings(self.current, laid)
        """Of the present version."""

    @property
    def empty(self) -> bool:
        """Whether there is no campaign yet that the model is laid beside."""
        return self.laid.campaign is None

    @property
    def seen(self) -> tuple[SeenFile, ...]:
        """All files that are looked at, as they were read."""
        return (self.current.seen, *self.laid.seen)

    @property
    def stands_on(self) -> str:
        """Says whether two windows show the same: version and campaigns by their content."""
        known = [self.current.path.name, *(seen.sha256 for seen in self.seen)]
        return hashlib.sha256(" ".join(known).encode()).hexdigest()[:16]

    def require_seen(self, on: str) -> None:
        """Refuse what was clicked on another state of things, or on files that are no more so.

        Raises
        ------
        InputError
            That says what has changed.
        """
        if on and on != self.stands_on:
            raise InputError(
                "this was changed in another window meanwhile: nothing was done; look at what "
                "stands here now, then click again",
                found=self.current.path.name,
            )
        for seen in self.seen:
            if seen.differs:
                raise InputError(
                    "is another file on the disk than was read: nothing was done",
                    file=seen.path.name,
                    expected="that it is read again",
                )

    def version(self, number: int) -> ModelVersion:
        """The version of that number.

        Raises
        ------
        InputError
            For one that is not there.
        """
        if not 0 <= number < len(self.versions):
            raise InputError("no such version", field="version", found=number)
        return self.versions[number]

    def show(self, version: ModelVersion, said: Sequence[str]) -> None:
        """Make a version the present one: nothing of the one before counts any more.

        Raises
        ------
        InputError
            Where the campaigns lack a signal that it needs.
        """
        if not self.empty:
            require_signals(self.laid.rows, version.model)
        self.current, self.said = version, list(said)
        self.findings = VersionFindings(version, self.laid)
