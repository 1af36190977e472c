"""``abbe service``: have systemd run ``abbe run`` for a machine, from boot to shutdown."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import ConfigFile, Force

_ROOT = typer.Option(
    help="Write below this folder, and start nothing (for packages, or to look).", metavar="DIR"
)


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    service = typer.Typer(help="Have systemd run `abbe run` for a machine.", no_args_is_help=True)
    service.command("install")(install)
    service.command("remove")(remove)
    service.command("renew")(renew)
    app.add_typer(service, name="service")


def install(
    config: ConfigFile,
    name: Annotated[
        str, typer.Option(help="The machine's name; default by the folder or file.")
    ] = "",
    root: Annotated[Path, _ROOT] = Path("/"),
    start: Annotated[
        bool, typer.Option("--start", help="Start it now, and whenever the computer starts.")
    ] = False,
    force: Force = False,
) -> None:
    """Install a machine's service: checked configuration and model, unit, system user.

    The files are copied to /etc/abbe/NAME; the unit is abbe@NAME.service, confined to the
    addresses and devices that the configuration names. docs/install.md is its page.
    """
    from abbe.daemon.config import load_config
    from abbe.daemon.systemd import install as steps
    from abbe.daemon.systemd.unit import USER

    here = root.resolve() == Path("/")
    if here:
        steps.require_root()
    configuration = load_config(config)
    machine = name or steps.machine_name(configuration)
    done = steps.plan(configuration, machine, root, steps.own_command())
    steps.install(done, force=force)
    for path in done.files:
        typer.echo(f"written: {path}")
    for path in done.kept:
        typer.echo(f"as it was: {path}")
    for path in done.replaced:
        typer.echo(f"removed, as the package has it: {path}")
    if not here:
        return
    steps.run(["systemd-sysusers"])
    for folder in (done.folder,):
        steps.run(["chown", "-R", f"root:{USER}", str(folder)])
        steps.run(["chmod", "-R", "u=rwX,g=rX,o=", str(folder)])
    steps.run(["systemctl", "daemon-reload"])
    if start:
        steps.run(["systemctl", "enable", "--now", done.unit], steps.RAMPS)
        typer.echo(f"running: {done.unit}; look at it with: systemctl status {done.unit}")
    else:
        typer.echo(f"start it, now and with the computer: systemctl enable --now {done.unit}")


def remove(
    name: Annotated[str, typer.Argument(help="The machine's name.", metavar="NAME")],
    root: Annotated[Path, _ROOT] = Path("/"),
) -> None:
    """Stop a machine's service, with its ramp, and take its unit away; files and data stay."""
    from abbe.daemon.systemd import install as steps
    from abbe.daemon.systemd.unit import check_machine

    here = root.resolve() == Path("/")
    check_machine(name)
    if here:
        steps.require_root()
        steps.run(["systemctl", "disable", "--now", f"abbe@{name}.service"], steps.RAMPS)
    for path in steps.uninstall(name, root):
        typer.echo(f"removed: {path}")
    if here:
        steps.run(["systemctl", "daemon-reload"])
    typer.echo(f"kept: /etc/abbe/{name} and /var/lib/abbe/{name}")


def renew(
    root: Annotated[Path, _ROOT] = Path("/"),
    restart: Annotated[
        bool,
        typer.Option("--restart", help="Restart those that run: ramped to zero, and in again."),
    ] = False,
) -> None:
    """Write the units of all installed machines anew, after an upgrade of Abbe.

    Configurations and models stay as they are. A machine whose configuration this version does not
    take is named, and goes on as it runs.
    """
    from abbe.daemon.systemd import install as steps
    from abbe.daemon.systemd import renewal

    here = root.resolve() == Path("/")
    if here:
        steps.require_root()
    say, complain = typer.echo, partial(typer.echo, err=True)
    sound, bad = renewal.renew(root, say, complain)
    well = not bad
    if here:
        steps.run(["systemctl", "daemon-reload"])
        if restart:
            well = renewal.restart(sound, bad, say, complain) and well
    raise typer.Exit(0 if well else 1)
