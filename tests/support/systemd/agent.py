"""Runs in the virtual machine, on its own Python: carries out the commands that tests send.

One JSON object a line on the second serial port, in a container on a socket, both ways. At its
beginning it says which boot this is, so that a reboot is noticed.
"""

import io
import json
import os
import socket
import subprocess
import tty
from pathlib import Path

PORT = "/dev/ttyS1"
SOCKET = "/dev/outside/agent"


def connected() -> tuple[io.RawIOBase, str]:
    """Where the tests speak, and which boot this is."""
    if Path(SOCKET).exists():
        made = socket.socket(socket.AF_UNIX)
        made.connect(SOCKET)
        # a container's processes begin anew with each boot, its kernel does not
        return made.makefile("rwb", buffering=0), Path("/proc/1/stat").read_text().split()[21]
    port = os.open(PORT, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return os.fdopen(port, "r+b", buffering=0), boot


def main() -> None:
    """Answer for ever."""
    stream, boot = connected()

    def say(message: dict[str, object]) -> None:
        stream.write(json.dumps(message).encode("ascii") + b"\n")

    say({"boot": boot})
    waiting = b""
    while True:
        data = stream.read(4096)
        if data == b"" and Path(SOCKET).exists():
            return
        waiting += data or b""
        *lines, waiting = waiting.split(b"\n")
        for line in lines:
            try:
                request = json.loads(line)
            except ValueError:
                continue
            if "command" not in request:
                say({"boot": boot})
                continue
            try:
                done = subprocess.run(
                    ["/bin/bash", "-c", request["command"]],
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    timeout=request["within"],
                    check=False,
                )
                out, status = done.stdout + done.stderr, done.returncode
            except subprocess.TimeoutExpired as error:
                out, status = (error.stdout or b"") + (error.stderr or b""), -1
            text = out.decode("utf-8", "replace")
            say({"id": request["id"], "status": status, "out": text})


if __name__ == "__main__":
    main()
