"""Every relative link of the project's pages leads somewhere, every module they name exists."""

from __future__ import annotations

import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
    *sorted((ROOT / "tests").rglob("*.md")),
]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)


def links(text: str) -> list[str]:
    """Where links and pictures lead, those to the world left out."""
    found = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    return [target for target in found if not re.match(r"[a-z]+:", target)]


def anchors(page: Path) -> list[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ +(.*)$", prose(page), re.MULTILINE)
    bare = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings)
    return [re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in bare]


def dead(page: Path, text: str) -> list[str]:
    """The links of a page that lead nowhere."""
    nowhere = []
    for target in links(text):
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            nowhere.append(target)
    return nowhere


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_link_leads_somewhere(page: Path) -> None:
    assert dead(page, prose(page)) == []


def test_a_dead_link_is_seen() -> None:
    text = "[a](docs/no.md) [b](docs/fit.md#no-such) [c](docs/fit.md#the-frame) [d](https://x.org)"
    assert dead(ROOT / "README.md", text) == ["docs/no.md", "docs/fit.md#no-such"]
    assert sum(len(links(prose(page))) for page in PAGES) > 100


CODE = [page for page in PAGES if page.name != "CHANGELOG.md"]
_FILE = re.compile(r"(?<![\w./-])((?:compcore|drivers|daemon|tests|tools|benchmarks)/[\w/.-]*\w/?)")
_DOTTED = re.compile(r"(?<![\w./-])(abbe\.(?:compcore|drivers|daemon)(?:\.[a-zA-Z_]\w*)*)")


@pytest.mark.parametrize("page", CODE, ids=[str(page.relative_to(ROOT)) for page in CODE])
def test_files_and_modules_that_are_named_exist(page: Path) -> None:
    text = page.read_text("utf-8")
    gone = [name for name in _FILE.findall(text) if not (ROOT / name).exists()]
    gone += [name for name in _DOTTED.findall(text) if not importable(name)]
    assert gone == []


def test_a_module_that_is_gone_is_seen() -> None:
    assert _FILE.findall("see `compcore/fit.py`, daemon/guard/.") == [
        "compcore/fit.py",
        "daemon/guard/",
    ]
    assert not importable("abbe.compcore.fit")
    assert importable("abbe.compcore.model.sensitivity.prediction_sd")


def importable(name: str) -> bool:
    """Whether a dotted name is a module, or a thing in one."""
    module, _, thing = name.rpartition(".")
    for found in (name, module):
        try:
            if find_spec(found) is not None:
                return found == name or hasattr(import_module(found), thing)
        except ModuleNotFoundError:
            continue
    return False


@pytest.mark.parametrize("folder", ["compcore", "drivers", "daemon"])
def test_contributing_shows_every_room(folder: str) -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    house = page.split("## The house")[1].split("```")[1]
    rooms = [path.parent.name for path in (ROOT / folder).glob("*/__init__.py")]
    assert len(rooms) > 8
    assert [room for room in rooms if not re.search(rf"\b{room}/", house)] == []
