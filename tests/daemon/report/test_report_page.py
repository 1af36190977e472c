"""Report pages: self-contained, well-formed, and safe with any text."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.figures.figure import band, figure, line, points
from abbe.daemon.report.page import Page, in_words, number
from abbe.daemon.report.pictures.packed import plotly_script
from tests.support.daemon.pages import figures_of, packed

VOID = {"meta", "br", "link", "img"}


class Structure(HTMLParser):
    """Checks that elements nest, and collects what would be fetched."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.counts: dict[str, int] = {}
        self.fetched: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.counts[tag] = self.counts.get(tag, 0) + 1
        if tag not in VOID:
            self.open.append(tag)
        self.fetched += [v for k, v in attrs if k in ("src", "href", "srcset", "action", "data")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("script", "style"):
            self.text.append(data)


def parsed(page: Page) -> Structure:
    structure = Structure()
    structure.feed(page.html())
    structure.close()
    assert structure.open == []
    return structure


def full_page() -> Page:
    page = Page("Positioning of X", "x.csv, 2 of <b>3</b>")
    page.section("Results & more")
    page.key_figures([("A", "9.0", "µm")])
    page.table(["Result", "µm"], [["A", 9.0], ["R", None], ["n", 5]], caption="ISO 230-2")
    page.subsection("Curves")
    page.notes(["3 runs, the standard asks for 5"], warning=True)
    x = np.arange(3.0)
    page.figure(figure([line(x, x**2, "mean")], "X in mm", "error in µm"), "The mean error.")
    page.figure(figure([*band(x, x - 1, x + 1, "#0072b2"), points(x, x)]))
    page.text("The end.")
    return page


def test_a_page_needs_nothing_but_itself():
    structure = parsed(full_page())
    assert structure.fetched == []
    html = full_page().html()
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', html)
    assert policy is not None
    assert "default-src 'none'" in policy[1]
    assert "http" not in policy[1]
    assert "@import" not in html.split("</style>")[0]
    assert "url(" not in html.split("</style>")[0]


def test_plotly_is_embedded_once_and_only_where_it_is_needed():
    with_figures, without = full_page().html(), Page("Text").html()
    assert with_figures.count("* plotly.js v") == 1  # whose it is can be read
    assert packed(with_figures, "plotly").encode() == plotly_script()
    assert "Plotly" not in without
    assert len(without) < 10_000
    assert len(with_figures) < 0.45 * len(plotly_script())


def test_what_stands_on_the_page():
    structure = parsed(full_page())
    text = " ".join(structure.text)
    for words in ("Positioning of X", "2 of <b>3</b>", "Results & more", "9.0", "The mean error."):
        assert words in text
    assert structure.counts["h1"] == 1
    assert structure.counts["figure"] == 2
    assert structure.counts["tr"] == 4
    assert "–" in text  # what is not known


def test_the_numbers_of_a_column_align():
    page = Page("Numbers")
    page.table(
        ["µm", "n", "name"], [[12.345, 3, "a"], [-0.04, 10, "b"], [np.nan, 1, "c"]], digits=3
    )
    html = page.html()
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", html)
    assert cells == ["12.3", "3", "a", "0.0", "10", "b", "–", "1", "c"]
    assert html.count('<th scope="col" class="number">') == 2


def test_figures_hold_their_numbers():
    first, second = figures_of(full_page().html())
    assert first["data"][0]["y"] == [0.0, 1.0, 4.0]
    assert first["layout"]["xaxis"]["title"]["text"] == "X in mm"
    assert [t["y"] for t in second["data"]] == [[-1, 0, 1], [1, 2, 3], [0, 1, 2]]


def test_hostile_text_stays_text():
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(1)>"
    page = Page(evil, evil)
    page.section(evil)
    page.text(evil)
    page.notes([evil])
    page.key_figures([(evil, evil, evil)])
    page.table([evil], [[evil]], caption=evil)
    page.figure(figure([line([0], [0], evil)], evil, evil), evil)
    structure = parsed(page)
    assert "img" not in structure.counts
    # the figures, whose Plotly is, Plotly, how they are opened, how they are drawn
    assert structure.counts["script"] == 5
    assert figures_of(page.html())[0]["data"][0]["name"] == evil


def test_gaps_and_numpy_numbers_become_json():
    page = Page("Gaps")
    page.figure({"data": [{"y": [np.float64(1.5), np.nan, np.inf, np.int64(2)]}], "layout": {}})
    assert figures_of(page.html())[0]["data"][0]["y"] == [1.5, None, None, 2]


def test_layout_adds_to_the_style():
    made = figure([], "a", "b", title="T", yaxis={"range": [0, 1]}, yaxis2={"side": "right"})
    layout = made["layout"]
    assert layout["yaxis"]["range"] == [0, 1]
    assert layout["yaxis"]["title"]["text"] == "b"
    assert layout["yaxis2"]["side"] == "right"
    assert layout["yaxis2"]["gridcolor"] == layout["xaxis"]["gridcolor"]


def test_written_whole_or_not_at_all(tmp_path):
    page = full_page()  # the same one: it says when it was made
    page.write(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == page.html()
    with pytest.raises(InputError, match="cannot be written"):
        full_page().write(tmp_path / "none" / "page.html")


@pytest.mark.parametrize(
    ("value", "text"), [(1234.5678, "1235"), (-0.5, "−0.5"), (1e-9, "1·10⁻⁹"), (3.0, "3")]
)
def test_numbers_for_people(value, text):
    assert number(value) == text


def test_a_column_of_nothing_but_rounding_is_zeros():
    """The means of set-ups whose zeros are fitted stood on the page as 0.000000000."""
    assert in_words([[3e-14], [-2e-12], [0.0]]) == [["0"], ["0"], ["0"]]
    assert in_words([[0.5e-3], [1e-14]], 2) == [["0.00050"], ["0.00000"]]
