"""The parts of the Debian package that can be looked at without building it."""

from __future__ import annotations

import gzip
import re
import subprocess
from pathlib import Path

import pytest

from abbe.daemon.systemd.unit import PACKAGE_COMMAND, PACKAGE_UNITS
from tools.deb import layout
from tools.deb.about import changelog, control, copyright_of
from tools.deb.environment import BuildError, Interpreter

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "tools" / "deb" / "files"


def test_the_package_and_the_installed_abbe_agree_on_places() -> None:
    assert layout.ENVIRONMENT / "bin" / "abbe" == PACKAGE_COMMAND
    assert layout.UNITS == PACKAGE_UNITS


def test_control_depends_on_exactly_the_python_that_the_compiled_parts_fit() -> None:
    interpreter = Interpreter(Path("/usr/bin/python3.11"), (3, 11, 2))
    said = control("1.2.3", "amd64", 4711, interpreter, ["libc6 (>= 2.34)"])
    fields = dict(re.findall(r"^(\S+): (.*)$", said, re.MULTILINE))
    assert fields["Version"] == "1.2.3"
    assert fields["Installed-Size"] == "4711"
    assert fields["Depends"].split(", ")[:2] == ["libc6 (>= 2.34)", "python3.11"]
    assert all(line.startswith(" ") for line in said.partition("Description:")[2].splitlines()[1:])


def test_an_interpreter_that_apt_does_not_know_is_refused(tmp_path: Path) -> None:
    own = tmp_path / "python3"
    own.write_text('#!/bin/sh\necho "[[3, 11, 2], \\"x\\"]"\n')
    own.chmod(0o755)
    with pytest.raises(BuildError, match="does not belong to a Debian package"):
        Interpreter.of(own)
    with pytest.raises(BuildError, match="apt install python3"):
        Interpreter.of(tmp_path / "none")


def test_the_changelog_is_debian_s_form() -> None:
    text = gzip.decompress(changelog("1.2.3", 0)).decode()
    assert text.startswith("abbe (1.2.3) unstable; urgency=medium\n")
    assert re.search(r"^ -- .+ <.+>  Thu, 01 Jan 1970 00:00:00 ", text, re.MULTILINE)


def test_every_package_that_comes_along_is_named_with_its_license(tmp_path: Path) -> None:
    info = tmp_path / "foo-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: foo\nVersion: 2.0\nAuthor: A. Foo\nLicense: MIT\n\n")
    said = copyright_of(tmp_path)
    assert "foo 2.0: MIT." in said
    assert "Copyright: A. Foo" in said


def test_links_are_relative_as_debian_wants_them(tmp_path: Path) -> None:
    layout.link(tmp_path, layout.COMMAND, PACKAGE_COMMAND)
    assert (tmp_path / "usr/bin/abbe").readlink() == Path("../lib/abbe/bin/abbe")


@pytest.mark.parametrize("name", ["postinst", "prerm", "postrm"])
def test_scripts_are_shell_and_refuse_what_they_do_not_know(name: str) -> None:
    subprocess.run(["sh", "-n", SCRIPTS / name], check=True)
    done = subprocess.run(
        ["sh", SCRIPTS / name, "rubbish"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "unknown argument 'rubbish'" in done.stderr
