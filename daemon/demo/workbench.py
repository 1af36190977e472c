"""The workbench of a demo: in a process of its own, which ends with the demo however that ends.

The demo listens and makes the key, so that the address is known at once; the browser waits until
the process has begun. ``python -m abbe.daemon.demo.workbench FD`` is that process: FD is the
listening socket, its standard input one line of JSON, and its end the sign to end.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from abbe.daemon.demo.prepare import Workshop
from abbe.daemon.workbench.entrance.address import address_of, listening, new_key

_NICER = 10
"""By how much it steps back behind the correction."""


@contextmanager
def demo_workbench(shop: Workshop) -> Iterator[str]:
    """Serve the workbench while the context lasts; gives the address for one browser.

    Further addresses, one for each browser, are written to `Workshop.address`.
    """
    key = new_key()
    with listening(0) as made:
        port = made.getsockname()[1]
        process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon.demo.workbench", str(made.fileno())],
            pass_fds=(made.fileno(),),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C is for the demo
        )
    try:
        if process.stdin is not None:
            task = {"folder": str(shop.folder), "key": key}
            process.stdin.write(json.dumps(task) + "\n")
            process.stdin.flush()
        yield address_of(port, key)
    finally:
        if process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()
        # it writes nothing of its own: the demo need not wait for its browsers
        process.kill()
        process.wait()
        shop.forget_address()


def main() -> None:
    """Serve until standard input ends."""
    from abbe.daemon.workbench.live.view import LiveView
    from abbe.daemon.workbench.serve import serve
    from abbe.daemon.workbench.session.workbench import Workbench
    from abbe.daemon.workbench.views import WorkbenchViews

    with contextlib.suppress(OSError, AttributeError):
        os.nice(_NICER)
    task = json.loads(sys.stdin.readline())
    shop = Workshop(Path(task["folder"]))

    def invite(further: str) -> None:
        # who can read the folder could start a demo of his own; who else uses the computer, not
        descriptor = os.open(shop.address, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(f"{further}\n")

    def until_the_demo_ends() -> None:
        sys.stdin.read()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=until_the_demo_ends, daemon=True).start()
    bench = Workbench(shop.model, [shop.campaign], at_once=False)
    with socket.socket(fileno=int(sys.argv[1])) as made:
        live = LiveView(shop.config, first=True)
        serve(WorkbenchViews(live, bench), made, invite, key=task["key"])


if __name__ == "__main__":
    main()
