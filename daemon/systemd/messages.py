"""Kinds of events that ``journalctl`` can select by: each has a MESSAGE_ID that never changes.

A part of Abbe that logs one names it: ``logger.info(…, extra={"event": "fault began"})``. The words
here are what ``journalctl -x`` shows below it, where the catalogue is installed
(the Debian package does; systemd's message catalogs, journalctl(1)).
"""

from __future__ import annotations

import uuid

_FAMILY = uuid.UUID("2b1f4c36-8a0e-4d57-9f1c-ab0e00000000")

EVENTS = {
    "began": (
        "The correction of a machine began",
        "Abbe runs with this version, model and configuration, named by their SHA-256. The\n"
        "machine is corrected as soon as positions and signals are believed.",
    ),
    "ended": (
        "The correction of a machine ended",
        "The correction was ramped to zero and the controller was told: it takes its own\n"
        "positions.",
    ),
    "reloaded": (
        "A new model or configuration was taken over",
        "The correction is led from the old to the new one, or ramped out and begun anew where\n"
        "links or sources changed.",
    ),
    "reload refused": (
        "A new model or configuration was not taken over",
        "A file is not in order; the message says where. What ran before goes on. Mend the file\n"
        "and reload again.",
    ),
    "file changed": (
        "A file on disk is not what runs",
        "Reload the service to take it over.",
    ),
    "link lost": (
        "A link to a device was lost",
        "Abbe goes on trying; what rests on it is held, then ramped to zero. Look at cable,\n"
        "address and power.",
    ),
    "link back": ("A link to a device is back", "Nothing has to be done."),
    "subscription lost": (
        "An OPC UA server does not notify",
        "Abbe asks it at each cycle instead, and subscribes again. Nothing has to be done where\n"
        "it comes back; otherwise the message says what the server refuses.",
    ),
    "subscription made": ("An OPC UA server notifies", "Nothing has to be done."),
    "fault began": (
        "Something is wrong",
        "What, and why, is in the message; what to do is in the table 'What to do when' of\n"
        "docs/daemon.md.",
    ),
    "fault over": ("Something is sound again", "Nothing has to be done."),
    "check recorded": (
        "A check measurement was recorded",
        "It is in the file of checks; `abbe check-point` shows the charts.",
    ),
    "check refused": (
        "A check measurement was not recorded",
        "The message says why. Have the controller measure it once more.",
    ),
    "machine changed": (
        "The machine is not the one any more that its model describes",
        "Since when, in what component, and growing with what is in the message, with the\n"
        "commands that hand the readings to a diagnosis.",
    ),
    "machine sound": (
        "No check measurement accuses the machine any more",
        "Nothing has to be done.",
    ),
    "no processor": (
        "The computer gives the correction too little processor time",
        "Cycles do not come, so that the controller falls back by the heartbeat. Look for what\n"
        "else runs on this computer ('systemd-cgtop', 'top'), and have it run elsewhere, or later.",
    ),
    "cycle hangs": (
        "The correction's cycle does not come to its end",
        "It had a processor: something that it waits for does not come back. The service manager\n"
        "ends it and begins it anew; where each thread was stands in the journal then.",
    ),
    "correction changed": (
        "The correction's state changed",
        "Which axes, and whether they are corrected in full, held, ramped or not corrected.",
    ),
}
"""Event → its subject and its explanation."""


def message_id(event: str) -> str:
    """The MESSAGE_ID of a kind of event: 32 hexadecimal digits.

    >>> message_id("began") == message_id("began") != message_id("ended")
    True
    """
    return uuid.uuid5(_FAMILY, event).hex


def catalogue() -> str:
    """The explanations as systemd's catalogue file."""
    entries = []
    for event, (subject, words) in EVENTS.items():
        entries.append(
            f"-- {message_id(event)}\nSubject: {subject}\nDefined-By: Abbe\n"
            f"Documentation: https://github.com/abbe-metrology/abbe\n\n@MESSAGE@\n\n{words}\n"
        )
    return "\n".join(entries)
