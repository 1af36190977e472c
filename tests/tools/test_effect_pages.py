"""docs/effects/ is what the docstrings say, with a picture for each effect."""

from __future__ import annotations

import re
from functools import cache
from xml.etree import ElementTree

import pytest

from tools.effect_pages import FOLDER, built_in, files
from tools.effect_scenes import SCENES

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
KEPT = sorted(path.name for path in FOLDER.iterdir())


@cache
def made() -> dict[str, str]:
    return files()


def test_every_effect_has_a_picture_and_every_picture_an_effect():
    assert set(SCENES) == set(built_in())


def test_nothing_else_lies_there():
    assert {path.name for path in FOLDER.iterdir()} == set(made())


@pytest.mark.parametrize("name", [n for n in KEPT if n.endswith(".md")])
def test_pages_are_up_to_date(name):
    """Otherwise run ``python -m tools.effect_pages``."""
    assert (FOLDER / name).read_text(encoding="utf-8") == made()[name]


@pytest.mark.parametrize("name", [n for n in KEPT if n.endswith(".svg")])
def test_pictures_are_up_to_date(name):
    """The same shapes; coordinates to the rounding of their last digit."""
    kept, new = (FOLDER / name).read_text(encoding="utf-8"), made()[name]
    assert NUMBER.sub("0", kept) == NUMBER.sub("0", new)
    for one, two in zip(NUMBER.findall(kept), NUMBER.findall(new), strict=True):
        assert abs(float(one) - float(two)) < 0.11


@pytest.mark.parametrize("name", [n for n in KEPT if n.endswith(".svg")])
def test_pictures_can_be_drawn_and_stay_small(name):
    svg = ElementTree.fromstring(made()[name])
    assert svg.tag.endswith("svg")
    assert len(made()[name]) < 12_000
    assert "nan" not in made()[name]
    width, height = (float(svg.get(k)) for k in ("width", "height"))
    for path in svg.iter("{http://www.w3.org/2000/svg}path"):
        points = [float(n) for n in NUMBER.findall(path.get("d"))]
        assert all(-1 <= x <= width + 1 for x in points[::2])
        assert all(-1 <= y <= height + 1 for y in points[1::2])
    looks = {p.get("class") for p in svg.iter("{http://www.w3.org/2000/svg}path")}
    assert {"before", "after"} <= looks


@pytest.mark.parametrize("name", [n for n in KEPT if n.endswith(".md")])
def test_links_between_pages_lead_somewhere(name):
    found = re.findall(r"\]\(([^)#]+)", made()[name])
    assert found
    assert {target for target in found if "/" not in target} <= set(made())
