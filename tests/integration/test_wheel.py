"""The wheel holds all of Abbe, and lives beside python-daemon, which installs `daemon`."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

ROOT = Path(__file__).parents[2]
HOUSES = ("compcore", "drivers", "daemon")
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
SDIST = "import sys; from setuptools import build_meta as b; print(b.build_sdist(sys.argv[1]))"


def run(*command: str | Path, cwd: Path, timeout: float = 300.0) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def wheel_of(source: Path, out: Path) -> Path:
    run(*PIP, "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", out, source, cwd=out)
    (made,) = out.glob("abbe-*.whl")
    return made


def contents(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a fresh checkout has of the package: no leftovers of earlier builds get in."""
    folder = tmp_path_factory.mktemp("checkout")
    waste = shutil.ignore_patterns("__pycache__")
    for name in ("abbe", *HOUSES):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=waste)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return wheel_of(source, tmp_path_factory.mktemp("wheel"))


def test_wheel_holds_every_file_of_the_house_under_one_name(wheel: Path) -> None:
    there = contents(wheel)
    info = f"abbe-{version('abbe')}.dist-info/"
    expected = {
        f"abbe/{path.relative_to(ROOT)}"
        for house in HOUSES
        for path in (ROOT / house).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert len(expected) > 500
    assert {Path(name).suffix for name in expected} >= {".py", ".toml", ".dbc"}
    own = {name for name in there if not name.startswith(info)}
    assert own == expected | {"abbe/__init__.py", "abbe/py.typed"}
    assert f"{info}entry_points.txt" in there


@pytest.mark.thorough
def test_wheel_from_the_source_archive_is_the_same(
    source: Path, wheel: Path, tmp_path: Path
) -> None:
    name = run(sys.executable, "-c", SDIST, tmp_path, cwd=source).splitlines()[-1]
    with tarfile.open(tmp_path / name) as archive:
        assert not [m.name for m in archive.getmembers() if m.issym() or m.islnk()]
        archive.extractall(tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    (tmp_path / "out").mkdir()
    assert contents(wheel_of(unpacked, tmp_path / "out")) == contents(wheel)


STAND_IN = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"
[project]
name = "python-daemon"
version = "0"
[tool.setuptools]
packages = ["daemon"]
"""


def python_daemon(folder: Path) -> list[Path]:
    """The wheels of python-daemon; without an index one that installs the same package."""
    wheels = folder / "wheels"
    asked = subprocess.run(
        [*PIP, "--timeout", "10", "--retries", "1", "download", "--quiet", "--only-binary", ":all:",
         "-d", str(wheels), "python-daemon"],
        cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, timeout=300, check=False,
    )  # fmt: skip
    if asked.returncode == 0:
        return list(wheels.glob("*.whl"))
    package = folder / "stand-in" / "daemon"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("class DaemonContext: ...\n")
    (package.parent / "pyproject.toml").write_text(STAND_IN)
    run(*PIP, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", wheels, package.parent,
        cwd=folder)  # fmt: skip
    return list(wheels.glob("*.whl"))


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with Abbe's wheel and python-daemon, or what stands in for it."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder / "venv", with_pip=False)
    wheels = python_daemon(folder)
    made = folder / "venv"
    run(*PIP, "--python", made / "bin" / "python", "install", "--quiet", "--no-deps",
        "--no-index", wheel, *wheels, cwd=folder)  # fmt: skip
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    # numpy and the rest are those of the tests; their own Abbe is behind a .pth, not read there
    (site / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return made


BESIDE = """
import importlib.metadata as m, json
import abbe, abbe.daemon, daemon
files = {n: {str(f) for f in m.files(n)} for n in ("abbe", "python-daemon")}
print(json.dumps({
    "abbe": abbe.daemon.__file__, "daemon": daemon.__file__,
    "theirs": sorted(d for d in m.packages_distributions()["daemon"]),
    "context": hasattr(daemon, "DaemonContext"),
    "both": sorted(files["abbe"] & files["python-daemon"]),
}))
"""


def test_both_packages_are_whole(environment: Path, tmp_path: Path) -> None:
    found = json.loads(run(environment / "bin" / "python", "-c", BESIDE, cwd=tmp_path))
    assert found["both"] == []
    assert found["theirs"] == ["python-daemon"]
    assert found["context"]
    assert Path(found["abbe"]).is_relative_to(environment)
    assert Path(found["daemon"]).is_relative_to(environment)


@pytest.mark.thorough
def test_demo_runs_beside_python_daemon(environment: Path, tmp_path: Path) -> None:
    abbe = environment / "bin" / "abbe"
    out = run(abbe, "demo", "--duration", "5", "--json", cwd=tmp_path)
    *cycles, summary = (json.loads(line) for line in out.splitlines())
    assert len(cycles) > 10
    assert "summary" in summary
    assert (tmp_path / "demo-out" / "model.toml").is_file()
