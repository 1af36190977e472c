"""Unit files, judged by systemd's own tools, and their installation below a folder."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.daemon.config.sections.http import HttpSetup
from abbe.daemon.config.tokens import add_token, read_tokens
from abbe.daemon.systemd.install import install, machine_name, plan, uninstall
from abbe.daemon.systemd.renewal import renew
from abbe.daemon.systemd.unit import (
    PACKAGE_COMMAND,
    PACKAGE_UNITS,
    Needs,
    check_machine,
    drop_in,
    template,
)

EXAMPLE = Path(__file__).parents[3] / "examples" / "bridge-cmm" / "config.toml"


def unit_of(folder: Path, needs: Needs, command: Path = Path("/bin/true")) -> Path:
    """A template and a machine's drop-in, as installed."""
    (folder / "abbe@.service").write_text(template(command, "root"))
    beside = folder / "abbe@mill-7.service.d"
    beside.mkdir()
    (beside / "50-machine.conf").write_text(drop_in(needs))
    return folder / "abbe@mill-7.service"


def analyze(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run systemd-analyze."""
    program = shutil.which("systemd-analyze")
    assert program, "systemd-analyze is missing: apt install systemd (make test does)"
    return subprocess.run([program, *arguments], capture_output=True, text=True, check=False)


ALL = replace(
    Needs.of_resources(
        ["tcp 10.0.0.5:502", "tcp [fe80::1]:502", "serial /dev/ttyUSB0", "can socketcan can0"],
        [Path("/var/log/my machine")],
    ),
    beside=True,
    clients=("192.168.7.0/24",),
)


def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    done = analyze("verify", str(unit_of(tmp_path, ALL)))
    assert (done.returncode, done.stderr) == (0, "")


def test_systemd_finds_it_well_confined(tmp_path: Path) -> None:
    unit = str(unit_of(tmp_path, ALL))
    done = analyze("security", "--offline=yes", "--threshold=20", unit)
    assert done.returncode == 0, done.stdout[-2000:]
    found = re.search(r"exposure level for .*: ([0-9.]+)", done.stdout)
    assert found
    assert float(found[1]) <= 2.0


def test_it_ends_before_the_network_and_ends_its_own_processes_itself(tmp_path: Path) -> None:
    """As systemd reads the unit: the ramp needs the network, a reading its judge."""
    text = unit_of(tmp_path, ALL).with_name("abbe@.service").read_text()
    found = dict(line.split("=", 1) for line in text.splitlines() if re.match(r"\w+=", line))
    assert {"network.target", "network-online.target"} <= set(found["After"].split())
    assert found["KillMode"] == "mixed"


def test_the_cycle_goes_before_other_services_and_never_takes_it_all(tmp_path: Path) -> None:
    text = unit_of(tmp_path, ALL).with_name("abbe@.service").read_text()
    assert "\nCPUWeight=1000\n" in text
    assert "CPUScheduling" not in text


def test_a_broken_unit_would_be_seen(tmp_path: Path) -> None:
    unit = unit_of(tmp_path, ALL)
    text = (tmp_path / "abbe@.service").read_text()
    (tmp_path / "abbe@.service").write_text(text.replace("ExecStart=", "ExecStrat="))
    assert analyze("verify", str(unit)).returncode != 0


def test_only_what_the_configuration_names_is_open() -> None:
    text = drop_in(Needs.of_resources(["serial /dev/ttyUSB3", "serial /dev/weighing"]))
    assert "DeviceAllow=char-ttyUSB rw" in text
    assert "DeviceAllow=/dev/weighing rw" in text
    assert "RestrictAddressFamilies=AF_UNIX\n" in text
    assert "IPAddressAllow" not in text
    text = drop_in(Needs.of_resources(["tcp 10.0.0.5:502"]))
    assert "IPAddressAllow=10.0.0.5\n" in text
    assert "RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6\n" in text


def test_http_opens_the_network_for_those_who_may_ask() -> None:
    serial = Needs.of_resources(["serial /dev/ttyUSB3"])
    text = drop_in(replace(serial, beside=True))
    assert "IPAddressAllow" not in text
    assert "AF_INET" not in text
    assert "SystemCallFilter=setpriority\n" in text
    assert "setpriority" not in drop_in(serial)
    text = drop_in(replace(serial, beside=True, clients=("localhost",)))
    assert "IPAddressAllow=localhost\n" in text
    assert "RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6\n" in text
    text = drop_in(replace(ALL, clients=("192.168.7.0/24",)))
    assert "IPAddressAllow=10.0.0.5 fe80::1 192.168.7.0/24\n" in text
    assert "IPAddressAllow=any\n" in drop_in(replace(ALL, clients=("any",)))
    at = ("192.168.7.2", 80)
    home = HttpSetup(Path("a"), Path("b"), (("127.0.0.1", 80), ("::1", 80)))
    assert home.networks == ("localhost",)
    assert HttpSetup(Path("a"), Path("b"), (at,)).networks == ("any",)
    assert HttpSetup(Path("a"), Path("b"), (at,), clients=("10.0.0.0/8",)).networks == (
        "10.0.0.0/8",
    )
    assert HttpSetup(Path("a"), Path("b")).networks == ()


def test_a_name_in_place_of_an_address_is_said() -> None:
    text = drop_in(Needs.of_resources(["tcp mill-7.plant:502"]))
    assert "# mill-7.plant: only its name is known" in text
    assert "IPAddressAllow=any" in text


def test_the_manager_waits_for_slow_cycles_and_long_ramps() -> None:
    text = drop_in(Needs(), period=30.0, longest_end=120.0)
    assert "WatchdogSec=120s" in text
    assert "TimeoutStopSec=140s" in text


def test_spaces_and_per_cent_signs_are_quoted() -> None:
    text = drop_in(Needs(folders=(Path("/data/100 %"),)))
    assert 'ReadWritePaths="/data/100 %%"' in text


@pytest.mark.parametrize("name", ["", "a/b", "../x", "mill 7", "-x", "x" * 65, "a@b", "a\nb"])
def test_strange_names_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="cannot name a service"):
        check_machine(name)


def test_installing_copies_what_was_checked_and_can_be_repeated(tmp_path: Path) -> None:
    configuration = load_config(EXAMPLE)
    assert machine_name(configuration) == "bridge-cmm"
    made = plan(configuration, "mill-7", tmp_path, Path("/opt/abbe/bin/abbe"))
    install(made)
    folder = tmp_path / "etc/abbe/mill-7"
    assert (folder / "config.toml").read_bytes() == EXAMPLE.read_bytes()
    copied = load_config(folder / "config.toml")
    assert copied.model.machine == configuration.model.machine
    unit = (tmp_path / "etc/systemd/system/abbe@.service").read_text()
    assert "ExecStart=/opt/abbe/bin/abbe run /etc/abbe/%i/config.toml\n" in unit
    again = plan(configuration, "mill-7", tmp_path, Path("/opt/abbe/bin/abbe"))
    assert {p.name for p in again.kept} == {"config.toml", "model.toml"}
    install(again)


def test_tokens_and_certificates_go_with_it_once(tmp_path: Path) -> None:
    """Later on they are the installed machine's own."""
    here, command = tmp_path / "here", Path("/opt/abbe/bin/abbe")
    shutil.copytree(EXAMPLE.parent, here)
    config = here / "config.toml"
    config.write_text(config.read_text() + '\n[http]\nlisten = ["127.0.0.1:8470"]\n')
    add_token(here / "http-tokens.toml", "one", "view")
    root = tmp_path / "root"
    install(plan(load_config(config), "mill-7", root, command))
    installed = root / "etc/abbe/mill-7/http-tokens.toml"
    assert list(read_tokens(installed)) == ["one"]
    add_token(installed, "two", "view")
    install(plan(load_config(config), "mill-7", root, command))
    assert list(read_tokens(installed)) == ["one", "two"]
    text = (root / "etc/systemd/system/abbe@mill-7.service.d/50-machine.conf").read_text()
    assert "localhost" in text


def test_another_configuration_is_not_overwritten_unasked(tmp_path: Path) -> None:
    configuration = load_config(EXAMPLE)
    command = Path("/opt/abbe/bin/abbe")
    install(plan(configuration, "mill-7", tmp_path, command))
    file = tmp_path / "etc/abbe/mill-7/config.toml"
    file.write_text("# mine\n")
    with pytest.raises(InputError, match="is there already, and is another one"):
        install(plan(configuration, "mill-7", tmp_path, command))
    assert file.read_text() == "# mine\n"
    install(plan(configuration, "mill-7", tmp_path, command), force=True)
    assert file.read_bytes() == EXAMPLE.read_bytes()
    assert file.with_name("config.toml.before").read_text() == "# mine\n"


def test_the_debian_package_has_the_template_itself(tmp_path: Path) -> None:
    configuration = load_config(EXAMPLE)
    units = tmp_path / "etc/systemd/system"
    # a machine that was installed from a virtual environment before
    install(plan(configuration, "mill-7", tmp_path, Path("/opt/abbe/bin/abbe")))
    assert (units / "abbe@.service").exists()
    packaged = tmp_path / PACKAGE_UNITS.relative_to("/")
    packaged.mkdir(parents=True)
    (packaged / "abbe@.service").write_text(template(Path("/usr/bin/abbe")))
    made = plan(configuration, "mill-7", tmp_path, PACKAGE_COMMAND)
    assert made.replaced == (units / "abbe@.service",)
    install(made)
    assert not (units / "abbe@.service").exists()
    assert (units / "abbe@mill-7.service.d/50-machine.conf").exists()
    # what somebody else wrote there stays
    (units / "abbe@.service").write_text("[Service]\n")
    install(plan(configuration, "mill-7", tmp_path, PACKAGE_COMMAND))
    assert (units / "abbe@.service").read_text() == "[Service]\n"


def test_after_an_upgrade_units_are_made_anew_and_configurations_stay(tmp_path: Path) -> None:
    configuration, command = load_config(EXAMPLE), Path("/opt/abbe/bin/abbe")
    for name in ("a", "b", "c"):
        install(plan(configuration, name, tmp_path, command))
    units = tmp_path / "etc/systemd/system"
    good = (units / "abbe@a.service.d/50-machine.conf").read_text()
    for name in ("a", "b"):
        (units / f"abbe@{name}.service.d/50-machine.conf").write_text("# of an old version\n")
    bad = tmp_path / "etc/abbe/b/config.toml"
    bad.write_text(EXAMPLE.read_text().replace("[guard]", "[guard]\nmax_speed = 1"))
    (tmp_path / "etc/abbe/c/config.toml").unlink()
    said: list[str] = []
    complained: list[str] = []
    assert renew(tmp_path, said.append, complained.append) == (["a"], ["b"])
    assert said == ["renewed: abbe@a.service"]
    (complaint,) = complained
    assert "max_speed" in complaint
    assert str(bad) in complaint
    assert (units / "abbe@a.service.d/50-machine.conf").read_text() == good
    assert (units / "abbe@b.service.d/50-machine.conf").read_text() == "# of an old version\n"
    assert (tmp_path / "etc/abbe/a/config.toml").read_bytes() == EXAMPLE.read_bytes()


def test_a_model_elsewhere_is_refused(tmp_path: Path) -> None:
    text = EXAMPLE.read_text().replace('model = "model.toml"', 'model = "../model.toml"')
    assert "../model.toml" in text
    shutil.copy(EXAMPLE.with_name("model.toml"), tmp_path / "model.toml")
    (tmp_path / "sub").mkdir()
    config = tmp_path / "sub" / "config.toml"
    config.write_text(text)
    with pytest.raises(InputError, match="the model must lie beside the configuration"):
        plan(load_config(config), "m", tmp_path / "root", Path("/opt/abbe/bin/abbe"))


def test_an_environment_that_the_service_cannot_see_is_refused() -> None:
    with pytest.raises(InputError, match="a service does not see this folder"):
        plan(load_config(EXAMPLE), "m", Path("/"), Path("/home/me/venv/bin/abbe"))


def test_removing_takes_the_units_and_keeps_the_data(tmp_path: Path) -> None:
    configuration = load_config(EXAMPLE)
    for name in ("a", "b"):
        install(plan(configuration, name, tmp_path, Path("/opt/abbe/bin/abbe")))
    units = tmp_path / "etc/systemd/system"
    uninstall("a", tmp_path)
    assert (units / "abbe@.service").exists()
    uninstall("b", tmp_path)
    assert list(units.iterdir()) == []
    assert (tmp_path / "etc/abbe/a/config.toml").exists()
    with pytest.raises(InputError, match="there is no such service"):
        uninstall("a", tmp_path)
