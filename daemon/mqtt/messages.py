"""What is published: a run's status in parts, each below a topic of its own, and its events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

ONLINE = "online"
"""Topic of birth and death."""
EVENTS = "events"

PARTS: Mapping[str, tuple[str, ...]] = {
    "state": (
        "state",
        "in_full",
        "computed_in_full",
        "writes",
        "alive",
        "ending",
        "status_word",
        "faults",
        "beyond",
        "switches",
    ),
    "corrections": ("axes", "tool_mm"),
    "temperatures": ("signals",),
    "health": ("cycle", "links", "checks", "files", "event_counts"),
}
"""Topic → which parts of a `RunStatus` are published there."""


class Message(NamedTuple):
    """One message, not yet numbered.

    Attributes
    ----------
    topic
        Its last level.
    body
        Its content, as JSON takes it.
    retain
        Whether the broker hands it to those who come later.
    """

    topic: str
    body: dict[str, Any]
    retain: bool


def of_status(status: Mapping[str, Any]) -> Iterator[Message]:
    """The messages of a run's status, as its JSON gives it."""
    for topic, keys in PARTS.items():
        body = {key: status[key] for key in keys if key in status}
        yield Message(topic, {"at": status["at"], **body}, retain=True)


def of_event(event: Mapping[str, Any]) -> Message:
    """The message of one event of the journal: ``at``, ``level``, ``part``, ``text``."""
    return Message(EVENTS, dict(event), retain=False)
