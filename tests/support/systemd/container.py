"""The same Debian as a container: systemd is process 1 there too, on this computer's own kernel.

Nothing is emulated, so that it is some twenty times faster than the virtual machine. Its processes,
mounts, network, control groups and name are its own; its kernel, clock and kernel settings are not,
and it may not touch them. Needs root.
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from tests.support.systemd.image import CannotPrepareError
from tests.support.systemd.machine import HOST, Machine

_TOOLS = ("unshare", "socat", "setpriv", "pivot_root", "losetup", "ip")
_OUTSIDE = "/dev/outside"
"""Folder of this computer's, as the container sees it."""
_GONE = 10.0
_PLUG_IN = "mkdir -p /media/stick && mount --bind /dev/outside/stick /media/stick"
# own processes, mounts and control groups, again for each boot
_BOOT = f"""\
set -e
R=$1
mount -t proc proc $R/proc
mount --bind $R/proc/sys $R/proc/sys
mount -o remount,bind,ro $R/proc/sys
mount -t sysfs -o ro sysfs $R/sys
mount -t cgroup2 cgroup2 $R/sys/fs/cgroup
mount -t tmpfs -o mode=755 run $R/run
mount -t tmpfs -o mode=755 dev $R/dev
mkdir $R/dev/pts $R/dev/shm $R{_OUTSIDE}
mount -t devpts -o newinstance,ptmxmode=0666,mode=620,gid=5 pts $R/dev/pts
mount -t tmpfs shm $R/dev/shm
mount --bind $2 $R{_OUTSIDE}
ln -s pts/ptmx $R/dev/ptmx
for link in fd:/proc/self/fd stdin:fd/0 stdout:fd/1 stderr:fd/2; do
  ln -s "${{link#*:}}" "$R/dev/${{link%%:*}}"; done
for node in null:1:3 zero:1:5 full:1:7 random:1:8 urandom:1:9 tty:5:0 $3; do
  IFS=: read -r name major minor <<<"$node"
  kind=c; [ "$name" != disk ] || kind=b
  mknod -m 666 "$R/dev/$name" $kind "$major" "$minor"; done
cd $R
mkdir -p before
pivot_root . before
umount -l /before
mount --make-rshared /
exec env -i container=abbe PATH=/usr/sbin:/usr/bin:/sbin:/bin setpriv \
  --bounding-set=-sys_time,-sys_module,-sys_rawio,-syslog /lib/systemd/systemd </dev/null
"""
# own network and name, which outlive a boot; the controllers are reached as in the virtual machine
_OUTER = f"""\
set -e
R=$1; O=$2; G=$3; DISK=$4; shift 4
ip link set lo up
ip addr add 10.0.2.15/24 dev lo
ip addr add {HOST}/24 dev lo
for port in "$@"; do
  socat TCP-LISTEN:$port,bind={HOST},fork,reuseaddr UNIX-CONNECT:$O/$port & done
hostname shop-floor
echo $$ > "$G/cgroup.procs"
while :; do
  set +e
  unshare --pid --fork --kill-child --cgroup --mount bash "$O/boot" "$R" "$O" "$DISK"
  status=$?
  set -e
  [ $status = 129 ] || exit $status # a container that restarts ends by SIGHUP
done
"""


def check() -> None:
    """See that a container can be made here.

    Raises
    ------
    CannotPrepareError
        With what is missing.
    """
    if os.geteuid():
        raise CannotPrepareError("a container is made by root only")
    missing = [tool for tool in _TOOLS if shutil.which(tool) is None]
    if missing:
        raise CannotPrepareError(
            f"{', '.join(missing)} not found: apt install socat util-linux mount iproute2"
        )
    # what a container within a container is often denied
    _do("unshare", "--net", "--uts", "--ipc", "--mount", "--pid", "--fork", "--cgroup", "true")
    if not os.access(_group_tree(), os.W_OK):
        raise CannotPrepareError("the control groups of this computer are read-only")
    _do("losetup", "--find")


@contextmanager
def contained(tree: Path, ports: Sequence[int], folder: Path, disk: Path) -> Iterator[Machine]:
    """A container that is over when the context is; what it writes is forgotten then.

    Parameters
    ----------
    tree
        Its Debian; not written to.
    ports
        Of this computer, which the container can reach.
    folder
        For what it writes, and for sockets; a folder ``stick`` in it can be mounted.
    disk
        A file with a file system, that is its ``/dev/disk``.
    """
    outside, root = folder / "outside", folder / "root"
    for made in (outside, root, folder / "upper", folder / "work"):
        made.mkdir(exist_ok=True)
    (outside / "boot").write_text(_BOOT)
    console = folder / "console.log"
    with ExitStack() as stack:
        layers = f"lowerdir={tree},upperdir={folder / 'upper'},workdir={folder / 'work'}"
        _do("mount", "-t", "overlay", "overlay", "-o", layers, root)
        stack.callback(_do, "umount", "-l", root)
        loop = _do("losetup", "--find", "--show", disk)
        stack.callback(_do, "losetup", "--detach", loop)
        number = Path(loop).stat().st_rdev
        group = _group_tree() / f"abbe-machine-{os.getpid()}"
        group.mkdir()
        stack.callback(_remove_group, group)
        for port in ports:
            stack.enter_context(_reached(outside / str(port), port))
        port_of_agent = stack.enter_context(_agent(outside / "agent"))
        with console.open("wb") as said:
            process = subprocess.Popen(
                ["unshare", "--net", "--uts", "--ipc", "--mount", "--propagation", "private",
                 "bash", "-c", _OUTER, "outer", root, outside, group,
                 f"disk:{os.major(number)}:{os.minor(number)}", *map(str, ports)],
                stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True,
            )  # fmt: skip
        stack.callback(_end, process, group)
        throttle = partial(_throttle, group, f"{os.major(number)}:{os.minor(number)}")
        machine = Machine(port_of_agent, console, _PLUG_IN, "/dev/disk", throttle)
        machine.booted()
        yield machine


def _do(*command: str | Path) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    if done.returncode:
        raise CannotPrepareError(f"{' '.join(map(str, command))}: {done.stderr.strip()}")
    return done.stdout.strip()


def _group_tree() -> Path:
    """Where this computer has the control groups of version 2."""
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        place, _, kind = line.partition(" - ")
        if kind.startswith("cgroup2 "):
            return Path(place.split()[4])
    raise CannotPrepareError("this computer has no control groups of version 2")


def _throttle(group: Path, number: str, rate: int) -> None:
    limit = group / "io.max"
    if limit.exists():
        limit.write_text(f"{number} wbps={rate or 'max'} rbps={rate or 'max'}")
        return
    # of version 1: each group for itself, and what the kernel writes on its own is the root's
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        place, _, kind = line.partition(" - ")
        if kind.startswith("cgroup ") and "blkio" in kind:
            for way in ("read", "write"):
                file = Path(place.split()[4]) / f"blkio.throttle.{way}_bps_device"
                file.write_text(f"{number} {rate}")
            return
    raise CannotPrepareError("this computer's control groups cannot slow down a disk")


def _remove_group(group: Path) -> None:
    for path in sorted([group, *group.rglob("*")], reverse=True):
        if path.is_dir():
            with contextlib.suppress(OSError):
                path.rmdir()


def _end(process: subprocess.Popen[bytes], group: Path) -> None:
    """End all that is in the container; it has no other way out than its group."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    with contextlib.suppress(OSError):
        (group / "cgroup.kill").write_text("1")
    deadline = time.monotonic() + _GONE
    while "populated 1" in (group / "cgroup.events").read_text() and time.monotonic() < deadline:
        time.sleep(0.05)


@contextmanager
def _reached(path: Path, port: int) -> Iterator[None]:
    """A socket in a folder that leads to a port of this computer."""
    process = subprocess.Popen(
        ["socat", f"UNIX-LISTEN:{path},fork", f"TCP:127.0.0.1:{port}"], start_new_session=True
    )
    try:
        yield
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@contextmanager
def _agent(path: Path) -> Iterator[socket.socket]:
    """The line to the agent of each boot, one after the other, as one socket."""
    here, there = socket.socketpair()
    with socket.socket(socket.AF_UNIX) as door, here, there:
        door.bind(str(path))
        door.listen()
        over = threading.Event()
        pump = threading.Thread(target=_pump, args=(door, there, over), daemon=True)
        pump.start()
        try:
            yield here
        finally:
            over.set()
            pump.join()


def _pump(door: socket.socket, there: socket.socket, over: threading.Event) -> None:
    agent: socket.socket | None = None
    while not over.is_set():
        wanted = [door, there] if agent is None else [door, there, agent]
        # what is said while nobody is there waits for the next boot
        ready, _, _ = select.select(wanted if agent else [door], [], [], 0.2)
        if door in ready:
            if agent is not None:
                agent.close()
            agent, _ = door.accept()
            continue
        try:
            if agent is not None and agent in ready:
                data = agent.recv(65536)
                if data:
                    there.sendall(data)
                else:
                    agent.close()
                    agent = None
            if agent is not None and there in ready:
                agent.sendall(there.recv(65536))
        except OSError:
            agent = None
    if agent is not None:
        agent.close()
