"""The built package, looked into: nothing of the build is left in it, and it runs where it lies."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.support.systemd.package import ROOT, built

pytestmark = [pytest.mark.systemd, pytest.mark.integration, pytest.mark.timeout(1800)]


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package, unpacked in a folder that it was not built in."""
    folder = tmp_path_factory.mktemp("unpacked")
    subprocess.run(["dpkg-deb", "-x", built(), folder], check=True)
    return folder


def packages(tree: Path) -> Path:
    (found,) = (tree / "usr/lib/abbe/lib").glob("python3.*/site-packages")
    return found


def test_no_file_names_a_folder_of_the_build(tree: Path) -> None:
    for place in (str(ROOT), "/abbe-deb-"):
        found = subprocess.run(
            ["grep", "-rlF", "-e", place, tree], capture_output=True, text=True, check=False
        )
        assert found.stdout == ""


def test_abbe_is_byte_compiled_for_the_place_where_it_will_lie(tree: Path) -> None:
    own = packages(tree) / "abbe"
    sources = {path.with_suffix("") for path in own.rglob("*.py")}
    compiled = {
        path.parents[1] / path.name.partition(".")[0] for path in own.rglob("__pycache__/*.pyc")
    }
    assert sources
    assert sources == compiled
    code = (own / "daemon" / "__pycache__" / "cli.cpython-311.pyc").read_bytes()
    assert f"/usr/lib/abbe/lib/{packages(tree).parent.name}/site-packages".encode() in code


def test_it_runs_from_any_folder_without_writing_there(tree: Path) -> None:
    before = set(tree.rglob("*"))
    program = (
        f"import sys; sys.path.insert(0, {str(packages(tree))!r}); sys.argv = ['abbe', 'check', "
        f"{str(tree / 'usr/share/doc/abbe/examples/bridge-cmm/config.toml')!r}]; "
        "from abbe.daemon.cli import main; sys.exit(main())"
    )
    done = subprocess.run(
        ["/usr/bin/python3", "-I", "-S", "-c", program],
        cwd="/", capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert set(tree.rglob("*")) == before


def test_root_owns_everything_and_nobody_else_writes(tree: Path) -> None:
    listed = subprocess.run(
        ["dpkg-deb", "-c", built()], capture_output=True, text=True, check=True
    ).stdout
    bad = [
        line for line in listed.splitlines()
        if " root/root " not in line or (line[0] != "l" and "w" in (line[5], line[8]))
    ]  # fmt: skip
    assert bad == []
