"""Installing a machine's service: files in place, a system user, units; and taking it away again.

Configuration and model are copied into ``/etc/abbe/MACHINE``, so that what runs is what was
checked. Nothing that a person wrote is overwritten without being asked for, and data are kept.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.grid_file import grid_files
from abbe.compcore.files.text.atomic import write_together
from abbe.daemon.config import Configuration
from abbe.daemon.config.folders import CONFIGURATIONS
from abbe.daemon.config.sections.http import HttpSetup
from abbe.daemon.config.sections.opcua_server import OpcuaServerSetup
from abbe.daemon.systemd.unit import (
    DROP_IN_NAME,
    MADE,
    PACKAGE_COMMAND,
    PACKAGE_UNITS,
    TEMPLATE_NAME,
    USER,
    Needs,
    check_machine,
    drop_in,
    sysusers,
    template,
)

_UNITS = "/etc/systemd/system"
_SYSUSERS = "/etc/sysusers.d/abbe.conf"
RAMPS = 600.0
"""s that a start, or a ramp down and an end, may take: the unit itself says when it is too long."""
_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")
"""Folders that a confined service does not see."""


@dataclass(frozen=True)
class Installation:
    """What `install` puts where.

    Attributes
    ----------
    machine
        Its name: of the unit ``abbe@MACHINE.service`` and of the folders.
    files
        Path → content.
    kept
        Files that are there already, as they have to be.
    unit
        Name of the unit.
    replaced
        Files that go, because the Debian package has them.
    """

    machine: str
    files: Mapping[Path, str | bytes]
    kept: tuple[Path, ...] = ()
    unit: str = field(default="")
    replaced: tuple[Path, ...] = ()

    @property
    def folder(self) -> Path:
        """Holds configuration and model."""
        return next(p for p in (*self.files, *self.kept) if p.name == "config.toml").parent


def machine_name(configuration: Configuration) -> str:
    """A name for a machine that was given none: by its configuration's folder or file.

    ``mill-7/config.toml`` is ``mill-7``, ``mill-7.toml`` too.
    """
    path = configuration.path.resolve()
    name = path.parent.name if path.stem == "config" else path.stem
    return re.sub(r"[^A-Za-z0-9_.:-]+", "-", name).strip("-.:_")[:64] or "machine"


def plan(
    configuration: Configuration, machine: str, root: Path, command: Path, user: str = USER
) -> Installation:
    """What has to be written for a machine's service.

    Parameters
    ----------
    configuration
        Checked.
    machine
        Name; see `machine_name`.
    root
        Where the system's files begin: ``/``, or a folder for a package or a look.
    command
        The command ``abbe``, absolute.
    user
        That the service runs as.

    Raises
    ------
    InputError
        For a name that cannot be, a model that is not beside the configuration, or a command in a
        folder that a confined service does not see.
    """
    check_machine(machine)
    if str(root) == "/":
        _require_visible(command)
    folder = _under(root, CONFIGURATIONS / machine)
    source = configuration.path
    files: dict[Path, str | bytes] = {}
    wanted: dict[Path, bytes] = {folder / "config.toml": source.read_bytes()}
    model = Path(configuration.file.model)
    if model.is_absolute() or ".." in model.parts:
        raise InputError(
            "the model must lie beside the configuration, to be installed with it",
            file=source,
            field="model",
            found=str(model),
            expected=f"a name in {source.resolve().parent}",
        )
    wanted[folder / model] = configuration.model_path.read_bytes()
    beside = (folder / model).parent
    for name, text in grid_files(configuration.model.effects).items():
        wanted[beside / name] = text.encode()
    kept = []
    for own in _of_http(configuration):
        # of an installed machine they are its own: tokens come and go, certificates are renewed
        if (folder / own).exists():
            kept.append(folder / own)
        else:
            wanted[folder / own] = (source.parent / own).read_bytes()
    for path, content in wanted.items():
        if path.exists() and path.read_bytes() == content:
            kept.append(path)
        else:
            files[path] = content
    units = _under(root, _UNITS)
    replaced = []
    if command == PACKAGE_COMMAND and (_under(root, PACKAGE_UNITS) / TEMPLATE_NAME).exists():
        earlier = units / TEMPLATE_NAME
        if earlier.exists() and earlier.read_text(encoding="utf-8").startswith(MADE):
            replaced.append(earlier)
    else:
        files[units / TEMPLATE_NAME] = template(command, user)
        files[_under(root, _SYSUSERS)] = sysusers(user)
    links = configuration.make_links()
    resources = [resource for link in links.values() for resource in link.owns]
    file, http, opcua = configuration.file, configuration.http, configuration.opcua_server
    reached = [one for one in (configuration.mqtt, configuration.fleet) if one is not None]
    resources += [one.resource for one in reached]
    needs = replace(
        Needs.of_resources(resources, _written_folders(configuration)),
        beside=any(part is not None for part in (http, opcua, *reached)),
        clients=_may_ask(http, opcua),
    )
    longest_end = file.guard.hold + file.guard.ramp
    files[units / f"abbe@{machine}.service.d" / DROP_IN_NAME] = drop_in(
        needs, file.cycle.period, longest_end
    )
    return Installation(machine, files, tuple(kept), f"abbe@{machine}.service", tuple(replaced))


def install(installation: Installation, *, force: bool = False) -> None:
    """Write an installation's files, all or none.

    Raises
    ------
    InputError
        When the machine's folder holds another configuration or model, unless `force`; when a file
        cannot be written.
    """
    folder = installation.folder
    if not force:
        for path in installation.files:
            if path.is_relative_to(folder) and path.exists():
                raise InputError(
                    "is there already, and is another one",
                    file=path,
                    found=f"{path.stat().st_size} bytes, written before",
                    expected="another --name; --force puts it aside as .before and replaces it",
                )
    for path in installation.files:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_relative_to(folder) and path.exists():
            shutil.copy2(path, path.with_name(f"{path.name}.before"))
    write_together(installation.files)
    for path in installation.replaced:
        path.unlink()


def uninstall(machine: str, root: Path) -> list[Path]:
    """Take a machine's units away; configuration and data stay. Returns what was removed.

    Raises
    ------
    InputError
        When there is no such service.
    """
    check_machine(machine)
    units = _under(root, _UNITS)
    folder = units / f"abbe@{machine}.service.d"
    if not (folder / DROP_IN_NAME).exists():
        there = [p.name[len("abbe@") : -len(".service.d")] for p in units.glob("abbe@*.service.d")]
        raise InputError(
            "there is no such service",
            field="NAME",
            found=machine,
            expected=f"one of {', '.join(sorted(there))}" if there else "an installed service",
        )
    removed = [folder / DROP_IN_NAME]
    (folder / DROP_IN_NAME).unlink()
    if not any(folder.iterdir()):
        folder.rmdir()
    if not any(units.glob("abbe@*.service.d")):
        template_file = units / TEMPLATE_NAME
        if template_file.exists():
            template_file.unlink()
            removed.append(template_file)
    return removed


def installed(root: Path) -> list[str]:
    """Names of the machines that are services, sorted."""
    folders = _under(root, _UNITS).glob("abbe@*.service.d")
    names = (folder.name[len("abbe@") : -len(".service.d")] for folder in folders)
    return sorted(
        name for name in names if (_under(root, CONFIGURATIONS) / name / "config.toml").exists()
    )


def run(command: Sequence[str], within: float = 90.0) -> None:
    """One of the system's commands, which may take `within` s.

    Raises
    ------
    AbbeError
        When it is not there, or fails: with what it said.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=within, check=False)
    except FileNotFoundError:
        raise AbbeError(
            f"{command[0]} is not on this computer: services need systemd; 'abbe run' works without"
        ) from None
    except subprocess.TimeoutExpired:
        raise AbbeError(f"{' '.join(command)} did not end within {within:g} s") from None
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise AbbeError(f"{' '.join(command)} failed: {said[-1] if said else done.returncode}")


def own_command() -> Path:
    """The command ``abbe`` of the environment that this is run from, absolute."""
    return Path(sys.executable).parent.absolute() / "abbe"


def require_root() -> None:
    """Refuse what only the system's administrator can do.

    Raises
    ------
    AbbeError
        With how to do it.
    """
    if os.geteuid():
        words = " ".join(["sudo", str(own_command()), *sys.argv[1:]])
        raise AbbeError(f"only the administrator can install services: {words}")


def _written_folders(configuration: Configuration) -> list[Path]:
    """Folders of journals and backups that are not the service's own: those with a whole path."""
    file, upload = configuration.file, configuration.upload
    names = [file.journal.file and Path(file.journal.file).parent]
    if file.control is not None:
        names.append(Path(file.control.socket).parent)
    if file.http is not None:
        names.append(Path(file.http.socket).parent)
    if file.mqtt is not None:
        names.append(Path(file.mqtt.buffer).parent)
    if upload is not None:
        names += [Path(upload.section.journal).parent, Path(upload.section.backups)]
    return [folder for folder in names if folder and folder.is_absolute()]


def _may_ask(http: HttpSetup | None, opcua: OpcuaServerSetup | None) -> tuple[str, ...]:
    """Networks that can reach what listens; empty: nothing listens."""
    found = [name for setup in (http, opcua) if setup is not None for name in setup.networks]
    return ("any",) if "any" in found else tuple(dict.fromkeys(found))


def _of_http(configuration: Configuration) -> list[Path]:
    """Files of ``[http]`` that lie beside the configuration, as it names them."""
    section = configuration.file.http
    if section is None:
        return []
    names = (Path(name) for name in (section.tokens, section.certificate, section.key) if name)
    beside = [name for name in names if not name.is_absolute() and ".." not in name.parts]
    return [name for name in beside if (configuration.path.parent / name).is_file()]


def _require_visible(command: Path) -> None:
    real = command.resolve()
    interpreter = Path(sys.executable).resolve()
    for path in (command, real, interpreter):
        if any(path.is_relative_to(folder) for folder in _HIDDEN):
            raise InputError(
                "a service does not see this folder",
                field="environment",
                found=str(path),
                expected="an environment outside /home, /root and /tmp: "
                "python3 -m venv /opt/abbe && /opt/abbe/bin/pip install abbe",
            )


def _under(root: Path, path: str | Path) -> Path:
    return root / Path(path).relative_to("/")
