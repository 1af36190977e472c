"""What a Debian package says of itself: control, changelog, copyright, dependencies."""

from __future__ import annotations

import gzip
import re
import subprocess
from collections.abc import Iterable
from email.parser import HeaderParser
from email.utils import formatdate
from pathlib import Path

from tools.deb.environment import BuildError, Interpreter

MAINTAINER = "Abbe developers <abbe@localhost>"
_SYNOPSIS = "live and tabulated error compensation for machine tools and CMMs"
_DESCRIPTION = """\
 Abbe links a computer on the shop floor to the controller of a CNC machine
 tool or a coordinate measuring machine, and makes the machine more accurate
 than its mechanics: as corrected positions, live, or as compensation tables.
 .
 The package holds Python packages of its own and needs no network. Each
 machine is a service, abbe@MACHINE, made by 'abbe service install'.
"""
_CONTROL = """\
Package: abbe
Version: {version}
Architecture: {architecture}
Maintainer: {maintainer}
Installed-Size: {size}
Depends: {depends}
Suggests: can-utils, sqlite3
Section: science
Priority: optional
Homepage: https://github.com/abbe-metrology/abbe
Description: {synopsis}
{description}"""
_STUB = "Source: abbe\nMaintainer: {0}\n\nPackage: abbe\nArchitecture: any\nDescription: -\n"
_APACHE = "/usr/share/common-licenses/Apache-2.0"


def control(
    version: str, architecture: str, size: int, interpreter: Interpreter, libraries: Iterable[str]
) -> str:
    """The control file.

    Parameters
    ----------
    version, architecture
        Of the package.
    size
        Of what is installed, KiB.
    interpreter
        That it runs on: exactly this version, as compiled parts fit no other one.
    libraries
        Packages of shared libraries, as ``dpkg-shlibdeps`` names them.
    """
    python = f"python{interpreter.short}"
    depends = [
        *libraries,
        python,
        "init-system-helpers",
        "systemd | systemd-standalone-sysusers | systemd-sysusers",
    ]
    return _CONTROL.format(
        version=version,
        architecture=architecture,
        maintainer=MAINTAINER,
        size=size,
        depends=", ".join(depends),
        synopsis=_SYNOPSIS,
        description=_DESCRIPTION,
    )


def shared_libraries(packages: Path, work: Path) -> list[str]:
    """Debian packages of the libraries that compiled parts need and do not bring along.

    Raises
    ------
    BuildError
        When dpkg-shlibdeps fails.
    """
    (work / "debian").mkdir(exist_ok=True)
    (work / "debian" / "control").write_text(_STUB.format(MAINTAINER))
    compiled = sorted(path for path in packages.rglob("*.so*") if path.is_file())
    brought = sorted({path.parent for path in compiled if path.parent.name.endswith(".libs")})
    done = subprocess.run(
        ["dpkg-shlibdeps", "-O", "--ignore-missing-info", "--warnings=0",
         *(f"-l{folder}" for folder in brought), *(f"-e{path}" for path in compiled)],
        cwd=work, capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = re.search(r"^shlibs:Depends=(.*)$", done.stdout, re.MULTILINE)
    if done.returncode or not found:
        raise BuildError(f"dpkg-shlibdeps failed (apt install dpkg-dev):\n{done.stderr}")
    return sorted(part.strip() for part in found[1].split(",") if part.strip())


def changelog(version: str, when: int) -> bytes:
    """Debian's changelog, which leads to Abbe's own; `when` in s since 1970."""
    text = (
        f"abbe ({version}) unstable; urgency=medium\n\n"
        "  * See CHANGELOG.md in this folder.\n\n"
        f" -- {MAINTAINER}  {formatdate(when)}\n"
    )
    return gzip.compress(text.encode(), mtime=0)


def copyright_of(packages: Path) -> str:
    """Whose work is in the package, by what each Python package says of itself."""
    text = (
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n"
        "Upstream-Name: abbe\n"
        "Source: https://github.com/abbe-metrology/abbe\n\n"
        "Files: *\n"
        "Copyright: the authors of Abbe\n"
        "License: Apache-2.0\n"
        f" On Debian systems the license is in {_APACHE}.\n"
        "\nFiles: usr/lib/abbe/lib/*/abbe/daemon/workbench/static/uplot/*\n"
        "Copyright: 2022 Leon Sorokin\n"
        "License: uPlot\n"
        " uPlot 1.6.32: MIT. Its licence is uplot-license.txt beside it.\n"
    )
    for info in sorted(packages.glob("*.dist-info"), key=lambda path: path.name.lower()):
        said = HeaderParser().parsestr((info / "METADATA").read_text(encoding="utf-8"))
        name = str(said["Name"])
        if name == "abbe":
            continue
        author = said["Author-email"] or said["Author"] or said["Maintainer"] or f"{name} authors"
        license_ = (said["License-Expression"] or said["License"] or "").strip().splitlines()
        first = license_[0] if license_ and len(license_[0]) < 80 else "see its licence files"
        text += (
            f"\nFiles: usr/lib/abbe/lib/*/{info.name.split('-')[0]}*\n"
            f"Copyright: {' '.join(str(author).split())}\n"
            f"License: {name}\n"
            f" {name} {said['Version']}: {first}. Its licence files are in\n"
            f" /usr/lib/abbe/lib/python*/site-packages/{info.name}/.\n"
        )
    return text
