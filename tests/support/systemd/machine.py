"""A virtual machine that tests can talk to; slow where the processor has to be emulated."""

from __future__ import annotations

import base64
import itertools
import json
import os
import select
import shlex
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tests.support.systemd.image import Image

PATIENCE = 900.0
"""s that anything may take: the machine may be emulated, beside other tests."""
_FIRST_WORDS = 10.0
HOST = "10.0.2.2"
"""This computer, as the machine sees it."""
_PLUG_IN = "mkdir -p /media/stick && mount -o ro /dev/vdb /media/stick"
_DISK_MB = 32
_AT_ONCE = "lazy_itable_init=0,lazy_journal_init=0"
"""Nothing of the file system is left to be written while a proof measures."""


class Machine:
    """A running machine.

    Parameters
    ----------
    port
        The socket of its second serial port.
    console
        File with what it prints.
    plug_in
        Command there that makes the stick ``/media/stick``.
    disk
        A disk of its own, with a small empty file system.
    throttle
        Lets the disk take so many bytes a second; 0: as many as it can.

    Attributes
    ----------
    plug_in, disk, throttle
        As given.
    """

    def __init__(
        self,
        port: socket.socket,
        console: Path,
        plug_in: str,
        disk: str,
        throttle: Callable[[int], None],
    ) -> None:
        self.plug_in = plug_in
        self.disk = disk
        self.throttle = throttle
        self._port = port
        self._console = console
        self._waiting = b""
        self._numbers = itertools.count(1)
        self.boot = ""
        """Which boot this is."""

    def booted(self) -> None:
        """Wait until it has booted, also for another time."""
        before, deadline = self.boot, time.monotonic() + PATIENCE
        while True:
            message = self._receive(deadline, "does not boot")
            if message.get("boot") not in (None, before):
                self.boot = str(message["boot"])
                return

    def run(self, command: str, within: float = PATIENCE) -> tuple[int, str]:
        """A shell command's exit status and what it said."""
        number = next(self._numbers)
        request = {"id": number, "command": command, "within": within}
        self._port.sendall(json.dumps(request).encode("ascii") + b"\n")
        deadline = time.monotonic() + within + 30.0
        while True:
            message = self._receive(deadline, f"does not come back: {command}")
            if message.get("id") == number:
                return int(str(message["status"])), str(message["out"])

    def do(self, command: str) -> str:
        """A command that has to work; what it said, without the last line's end."""
        status, out = self.run(command)
        assert status == 0, f"{command}: {status}: {out}\n{self.console}"
        return out.rstrip("\n")

    def tell(self, command: str) -> None:
        """A command that has no answer, because it ends the machine."""
        request = {"id": next(self._numbers), "command": command, "within": PATIENCE}
        self._port.sendall(json.dumps(request).encode("ascii") + b"\n")

    def put(self, path: str, text: str) -> None:
        """Write a file, as an editor does."""
        data = base64.b64encode(text.encode()).decode()
        name = shlex.quote(path)
        self.do(f"echo {data} | base64 -d > {name}.new && mv {name}.new {name}")

    def until(self, command: str, what: Callable[[str], bool]) -> str:
        """What a command says, once `what` holds of it."""
        deadline = time.monotonic() + PATIENCE
        while True:
            _, out = self.run(command)
            if what(out):
                return out
            assert time.monotonic() < deadline, f"not seen: {command}: {out}"
            time.sleep(0.2)

    @property
    def console(self) -> str:
        """The end of what it printed."""
        return self._console.read_text(errors="replace")[-3000:]

    def _receive(self, deadline: float, problem: str) -> dict[str, object]:
        while b"\n" not in self._waiting:
            left = deadline - time.monotonic()
            ready, _, _ = select.select([self._port], [], [], max(0.0, left))
            data = self._port.recv(65536) if ready else b""
            assert data, f"the machine {problem}\n{self.console}"
            self._waiting += data
        line, _, self._waiting = self._waiting.partition(b"\n")
        try:
            found = json.loads(line)
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}


def media(folder: Path, files: Mapping[str, Path]) -> Path:
    """A disk with files, name → which, as a stick would bring them."""
    content = folder / "media"
    content.mkdir()
    fill(content, files)
    size = sum(file.stat().st_size for file in files.values()) // 2**20 + 64
    disk = folder / "media.ext4"
    subprocess.run(
        ["mke2fs", "-q", "-t", "ext4", "-d", content, disk, f"{size}M"],
        check=True,
        capture_output=True,
    )
    return disk


def fill(stick: Path, files: Mapping[str, Path]) -> None:
    """Put files into a folder, name → which."""
    for name, file in files.items():
        shutil.copy(file, stick / name)


def spare_disk(folder: Path) -> Path:
    """A small disk with an empty file system."""
    disk = folder / "spare.ext4"
    subprocess.run(
        ["mke2fs", "-q", "-t", "ext4", "-E", _AT_ONCE, disk, f"{_DISK_MB}M"],
        check=True,
        capture_output=True,
    )
    return disk


@contextmanager
def running(image: Image, stick: Path, folder: Path) -> Iterator[Machine]:
    """A machine that is over when the context is; what it writes is forgotten then.

    Parameters
    ----------
    image
        What it boots from.
    stick
        A second disk, read-only: ``/dev/vdb``.
    folder
        For the console's text and the socket.
    """
    problem = ""
    for name, accelerator in _accelerators():
        with _started(image, stick, folder, accelerator) as (port, console, process):
            if not _prints(console, process):
                problem += f"{name}: {_said(process)}\n"
                continue
            throttle = partial(_throttle, folder / "monitor")
            machine = Machine(port, console, _PLUG_IN, "/dev/vdc", throttle)
            machine.booted()
            yield machine
            return
    raise AssertionError(f"no machine starts: {problem}")


def _accelerators() -> Iterator[tuple[str, list[str]]]:
    if os.access("/dev/kvm", os.R_OK | os.W_OK):
        # one that is itself in a machine may have it and not be able to use it
        yield "kvm", ["-accel", "kvm", "-cpu", "host,-arch-capabilities"]
    yield "tcg", ["-accel", "tcg,thread=multi", "-cpu", "max"]


def _prints(console: Path, process: subprocess.Popen[bytes]) -> bool:
    """Whether the kernel says anything soon: it does within a second, or never."""
    deadline = time.monotonic() + _FIRST_WORDS
    while time.monotonic() < deadline and process.poll() is None:
        if console.stat().st_size:
            return True
        time.sleep(0.05)
    return False


@contextmanager
def _started(
    image: Image, stick: Path, folder: Path, accelerator: Sequence[str]
) -> Iterator[tuple[socket.socket, Path, subprocess.Popen[bytes]]]:
    path, console = folder / "agent", folder / "console.log"
    for left in (path, folder / "monitor", folder / "spare.ext4"):
        left.unlink(missing_ok=True)
    console.write_bytes(b"")
    command = [
        "qemu-system-x86_64", *accelerator, "-smp", "2", "-m", "1536",
        "-nodefaults", "-display", "none", "-no-user-config",
        "-kernel", image.kernel, "-initrd", image.initrd,
        "-append", "console=ttyS0 panic=-1 audit=0 mitigations=off systemd.show_status=0",
        "-drive", f"file={image.disk},if=virtio,format=raw,snapshot=on",
        "-drive", f"file={stick},if=virtio,format=raw,readonly=on",
        "-drive", f"id=spare,file={spare_disk(folder)},if=virtio,format=raw",
        "-monitor", f"unix:{folder / 'monitor'},server=on,wait=off",
        "-netdev", "user,id=n", "-device", "virtio-net-pci,netdev=n,romfile=",
        "-serial", f"file:{console}", "-chardev", f"socket,id=agent,path={path},server=on,wait=on",
        "-serial", "chardev:agent",
    ]  # fmt: skip
    process = subprocess.Popen(
        [str(part) for part in command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        with socket.socket(socket.AF_UNIX) as port:
            deadline = time.monotonic() + PATIENCE
            while process.poll() is None:
                try:
                    port.connect(str(path))
                    break
                except (FileNotFoundError, ConnectionRefusedError):
                    assert time.monotonic() < deadline
                    time.sleep(0.05)
            yield port, console, process
    finally:
        process.kill()
        process.wait()
        if process.stderr is not None:
            process.stderr.close()


def _throttle(monitor: Path, rate: int) -> None:
    with socket.socket(socket.AF_UNIX) as line:
        line.connect(str(monitor))
        line.sendall(f"block_set_io_throttle spare {rate} 0 0 0 0 0\n".encode())
        # it is done when it asks for the next command
        said = b""
        while said.count(b"(qemu)") < 2:
            said += line.recv(4096)


def _said(process: subprocess.Popen[bytes]) -> str:
    process.kill()
    return "" if process.stderr is None else process.stderr.read().decode(errors="replace")
