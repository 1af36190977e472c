"""The virtual machine's disk, and a container's tree: a small Debian with systemd, made once.

It is kept below ``build/``, under a name made from all that it depends on. Everything comes from
the distribution by its own tools (mmdebstrap, e2fsprogs, a kernel package that is unpacked and
never installed here).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[3]
KEPT = ROOT / "build" / "machine"
"""Where it is kept."""
_AGENT = Path(__file__).with_name("agent.py")
PACKAGES = (
    "dbus",
    "init-system-helpers",
    "iproute2",
    "libstdc++6",
    "procps",
    "python3",
    "systemd",
    "systemd-sysv",
    "zlib1g",
)
"""What the Debian in the machine has beyond the least: what a shop-floor PC has anyway."""
KERNEL = "linux-image-cloud-amd64"
_MODULES = (
    "virtio", "virtio_ring", "virtio_pci_modern_dev", "virtio_pci_legacy_dev", "virtio_pci",
    "virtio_blk", "failover", "net_failover", "virtio_net", "crc32c-intel", "libcrc32c",
    "crc32c_generic", "crc16", "mbcache", "jbd2", "ext4",
)  # fmt: skip
_MASKED = (
    "apt-daily.timer", "apt-daily-upgrade.timer", "dpkg-db-backup.timer", "e2scrub_all.timer",
    "fstrim.timer", "getty@tty1.service", "serial-getty@ttyS0.service", "systemd-resolved.service",
    "systemd-timesyncd.service", "systemd-networkd.service", "systemd-firstboot.service",
    "motd-news.timer", "man-db.timer", "systemd-pstore.service",
)  # fmt: skip
_AGENT_UNIT = """\
[Unit]
Description=Carries out what the tests ask for
DefaultDependencies=no
After=local-fs.target systemd-journald.service systemd-tmpfiles-setup.service
Conflicts=shutdown.target
Before=shutdown.target
[Service]
ExecStart=/usr/bin/python3 -I /usr/local/lib/agent.py
Restart=always
OOMScoreAdjust=-1000
[Install]
WantedBy=multi-user.target
"""
_INIT = """\
#!/bin/busybox sh
B=/bin/busybox
$B mount -t proc proc /proc; $B mount -t sysfs sys /sys; $B mount -t devtmpfs dev /dev
for round in 1 2 3 4; do for m in /modules/*.ko; do $B insmod $m 2>/dev/null; done; done
while [ ! -b /dev/vda ]; do $B sleep 0.1; done
$B ip link set lo up
$B ip link set eth0 up
$B ip addr add 10.0.2.15/24 dev eth0
$B mount -t ext4 -o rw,noatime /dev/vda /new || exec $B sh
$B mount -t devtmpfs dev /new/dev
$B umount /proc; $B umount /sys
exec $B switch_root /new /lib/systemd/systemd
"""


class CannotPrepareError(Exception):
    """The machine cannot be made here: what is missing."""


@dataclass(frozen=True)
class Image:
    """What the virtual machine is started from.

    Attributes
    ----------
    kernel, initrd, disk
        Files; the disk is never written to.
    """

    kernel: Path
    initrd: Path
    disk: Path


def prepare(folder: Path = KEPT) -> Image:
    """The virtual machine's image, made if it is not there yet.

    Raises
    ------
    CannotPrepareError
        Where something is missing: what.
    """
    made = _place(folder)
    for tool in ("qemu-system-x86_64", "mke2fs"):
        if shutil.which(tool) is None:
            raise CannotPrepareError(f"{tool} is missing: make test-systemd installs it")
    image = Image(made / "vmlinuz", made / "initrd", made / "disk.ext4")
    if (made / "complete").exists():
        return image
    tree = debian(folder)
    for name in ("modules", "busybox-static"):
        shutil.rmtree(made / name, ignore_errors=True)
    _kernel(made)
    _initrd(made)
    _run(["mke2fs", "-q", "-F", "-t", "ext4", "-d", tree, image.disk, "3G"], made, root=True)
    if user := os.geteuid():
        # a tree of root's would be in the way of whoever clears up; only root makes containers
        _run(["chown", str(user), image.disk], made, root=True)
        (made / "tree-complete").unlink()
        _run(["rm", "-rf", "--one-file-system", tree], made, root=True)
    (made / "complete").touch()
    return image


def debian(folder: Path = KEPT) -> Path:
    """The tree of a Debian with systemd, made if it is not there yet.

    Raises
    ------
    CannotPrepareError
        Where something is missing: what.
    """
    made = _place(folder)
    if not (made / "tree-complete").exists():
        if shutil.which("mmdebstrap") is None:
            raise CannotPrepareError("mmdebstrap is missing: make test-systemd installs it")
        if made.exists():
            _run(["rm", "-rf", "--one-file-system", made], folder, root=True)
        made.mkdir(parents=True)
        _tree(made, _release()["VERSION_CODENAME"])
        (made / "tree-complete").touch()
    return made / "tree"


def _place(folder: Path) -> Path:
    """Where the image of this recipe is kept."""
    release = _release()
    if release.get("ID") != "debian":
        raise CannotPrepareError(f"made for Debian, and this is {release.get('ID', 'unknown')}")
    suite = release["VERSION_CODENAME"]
    recipe = Path(__file__).read_bytes() + _AGENT.read_bytes() + suite.encode()
    return folder / hashlib.sha256(recipe).hexdigest()[:12]


def _release() -> dict[str, str]:
    text = Path("/etc/os-release").read_text() if Path("/etc/os-release").exists() else ""
    return {k: v.strip('"') for k, v in re.findall(r"^([A-Z_]+)=(.*)$", text, re.MULTILINE)}


def _run(command: Sequence[str | Path], folder: Path, *, root: bool = False) -> str:
    words = [str(part) for part in command]
    if root and os.geteuid():
        words = ["sudo", "-n", *words]
    done = subprocess.run(
        words, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise CannotPrepareError(f"{' '.join(words[:4])} … failed: {done.stderr[-2000:]}")
    return done.stdout


def _fetch(package: str, made: Path) -> Path:
    """Unpack a Debian package into a folder of its own, without installing it."""
    _run(["apt-get", "download", "-qq", package], made)
    (file,) = made.glob(f"{package}_*.deb")
    target = made / package
    _run(["dpkg-deb", "-x", file, target], made)
    file.unlink()
    return target


def _kernel(made: Path) -> None:
    depends = _run(["apt-cache", "depends", KERNEL], made)
    found = re.search(r"Depends: (linux-image-\S+)", depends)
    if found is None:
        raise CannotPrepareError(f"apt knows no {KERNEL}: apt-get update")
    unpacked = _fetch(found[1], made)
    (kernel,) = (unpacked / "boot").glob("vmlinuz-*")
    shutil.move(kernel, made / "vmlinuz")
    (made / "modules").mkdir()
    for name in _MODULES:
        for module in (unpacked / "lib" / "modules").rglob(f"{name}.ko"):
            shutil.copy(module, made / "modules")
    shutil.rmtree(unpacked)


def _initrd(made: Path) -> None:
    busybox = next((_fetch("busybox-static", made) / "bin").glob("busybox"))
    entries: list[tuple[str, int, bytes]] = [
        (name, 0o040755, b"") for name in ("bin", "proc", "sys", "dev", "new", "modules")
    ]
    entries.append(("init", 0o100755, _INIT.encode()))
    entries.append(("bin/busybox", 0o100755, busybox.read_bytes()))
    modules = sorted((made / "modules").iterdir())
    entries += [(f"modules/{module.name}", 0o100644, module.read_bytes()) for module in modules]
    with (made / "initrd").open("wb") as archive:
        for number, (name, mode, data) in enumerate([*entries, ("TRAILER!!!", 0, b"")], 1):
            archive.write(_cpio(number, name, mode, data))


def _cpio(number: int, name: str, mode: int, data: bytes) -> bytes:
    """One file as the kernel reads it from an initrd (cpio's format newc)."""
    encoded = name.encode() + b"\0"
    fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(encoded), 0)
    head = b"070701" + b"".join(b"%08x" % field for field in fields) + encoded
    return head + b"\0" * (-len(head) % 4) + data + b"\0" * (-len(data) % 4)


def _tree(made: Path, suite: str) -> None:
    tree = made / "tree"
    _run(
        ["mmdebstrap", "--quiet", "--variant=apt", f"--include={','.join(PACKAGES)}",
         "--aptopt=Apt::Install-Recommends false", "--dpkgopt=force-unsafe-io",
         "--dpkgopt=path-exclude=/usr/share/man/*", "--dpkgopt=path-exclude=/usr/share/locale/*",
         "--dpkgopt=path-exclude=/usr/share/doc/*", "--dpkgopt=path-include=/usr/share/doc/abbe*",
         suite, tree, _mirror()],
        made, root=True,
    )  # fmt: skip
    own = made / "own"
    units = own / "etc/systemd/system"
    (units / "multi-user.target.wants").mkdir(parents=True)
    (units / "agent.service").write_text(_AGENT_UNIT)
    (units / "multi-user.target.wants/agent.service").symlink_to("../agent.service")
    for unit in _MASKED:
        (units / unit).symlink_to("/dev/null")
    (own / "usr/local/lib").mkdir(parents=True)
    shutil.copy(_AGENT, own / "usr/local/lib/agent.py")
    (own / "var/log/journal").mkdir(parents=True)
    (own / "etc/hostname").write_text("shop-floor\n")
    (own / "etc/machine-id").write_text("5f0c3a1e9d7b4c28a6e1d2f3b4c5d6e7\n")
    (own / "etc/fstab").write_text("")
    _run(["cp", "-a", "--no-preserve=ownership", f"{own}/.", tree], made, root=True)
    _run(["rm", "-rf", "--one-file-system", own], made, root=True)


def _mirror() -> str:
    """Where this computer has its own packages from."""
    policy = subprocess.run(["apt-cache", "policy", "dpkg"], capture_output=True, text=True,
                            check=False).stdout  # fmt: skip
    found = re.search(r"\d+ (https?://\S+) \S+/main", policy)
    return found[1] if found else "http://deb.debian.org/debian"
