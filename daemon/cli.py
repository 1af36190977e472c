"""The command line from its first moment to its last: what ends it is one line and a status.

Exit status: 0 done; 1 could not be done (one message on standard error); 2 wrong usage; 130
interrupted. Nothing is imported here before interruptions are caught.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

INTERRUPTED = 130
"""128 and the number of SIGINT, as shells have it."""


def main() -> None:
    """Run the command line; a user's mistake is one message, never a traceback."""
    caught = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if caught:
        # while modules are imported nothing is under way that would have to be ended
        _on_interruption(_end_at_once)
    # what is done is done: a late Ctrl-C would only tear the interpreter's end
    atexit.register(_ignore_interruptions)
    try:
        status = _run(caught)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        _tell("interrupted")
    sys.exit(status)


def _end_at_once(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b"abbe: interrupted\n")
    os._exit(INTERRUPTED)


def _ignore_interruptions() -> None:
    _on_interruption(signal.SIG_IGN)


def _on_interruption(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    try:
        signal.signal(signal.SIGINT, handler)
    except ValueError:
        # not the main thread, to which interruptions do not come
        return


def _run(caught: bool) -> int:
    from abbe.daemon.collector import seldom

    seldom()
    from abbe.compcore.errors import AbbeError
    from abbe.daemon.standard_output import finish, install

    reported = ""
    status = 1
    try:
        install()
        from abbe.daemon.application import application

        command = application(sys.argv[1] if len(sys.argv) > 1 else "")
        if caught:
            _on_interruption(signal.default_int_handler)
        command()
        status = 0
    except SystemExit as done:
        status = done.code if isinstance(done.code, int) else int(done.code is not None)
    except AbbeError as error:
        reported = str(error) + _elsewhere(error)
    except BrokenPipeError:
        status = 0
    except OSError as error:
        where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
        reported = f"{where}{error.strerror or error}"
    except MemoryError:
        reported = "not enough memory"
    except Exception as error:
        if not _of_a_link(error):
            raise
        reported = str(error)
    if reported:
        _tell(reported)
    unprinted = finish()
    if unprinted and not reported:
        _tell(unprinted)
    return status or int(bool(unprinted))


def _of_a_link(error: Exception) -> bool:
    """Whether a link raised it; the drivers are not imported for a command that needs none."""
    drivers = sys.modules.get("abbe.drivers.link")
    return drivers is not None and isinstance(error, drivers.LinkError)


def _elsewhere(error: Exception) -> str:
    """The command that reads the file, where it was given to another one."""
    from abbe.compcore.errors import InputError

    if not isinstance(error, InputError) or len(sys.argv) < 2:
        return ""
    from abbe.daemon.answers.other_command import in_words

    other = in_words(error, sys.argv[1:])
    return "" if other is None else f"; {other}"


def _tell(text: str) -> None:
    try:
        sys.stderr.write(f"abbe: {text}\n")
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):
        return
