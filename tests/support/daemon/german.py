"""English on a German page: every text that is seen, without what people and files are called."""

from __future__ import annotations

import re
from collections.abc import Iterator

from playwright.sync_api import Page

SEEN = """() => {
  const found = [];
  const own = "code, pre, .sha, #version, #machine, option[lang], [data-name]";
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const parent = texts.currentNode.parentElement;
    if (!parent.closest(`${own}, script, style`)) found.push(texts.currentNode.data);
  }
  for (const node of document.querySelectorAll("[aria-label], [placeholder], [title]"))
    if (!node.closest(own)) for (const name of ["aria-label", "placeholder", "title"])
      if (node.hasAttribute(name)) found.push(node.getAttribute(name));
  return [...new Set(found.map((text) => text.trim().replace(/\\s+/g, " ")))].filter(Boolean);
}"""
"""Every text and label of a page; codes, commands, hashes and names of files' makers left out."""

_WORDS = """
    the of and is are not with which from to by it its this that these those what where when
    has have had been be being for as than then there each no any only every either both more
    most can cannot could should would may might must does did done measured measure
    measurement error errors axis axes residual residuals row rows value values file files
    table tables machine model campaign date time left right held out fitted noise floor
    largest worst first at or if nothing something somebody who whose written begun ended
    begins ends asked asks yet still again read reads wrote uncertainty correction corrections
    corrected indicated temperature temperatures length lengths angles growth
    """
ENGLISH = frozenset(re.findall(r"\w+", _WORDS))
"""Words that no German sentence has."""
_SPEC = re.compile(r"\b\w+(?: \w+=[^\s;]+)+|\b(?:Form|misst) [\w:]+")
"""A cause as it is typed, and its keys' values."""
_NAME = re.compile(r"\S*[_=/.\\]\S*|--[\w-]+|\b[A-Z]{2,}\b")
"""A name of a file, a set-up, a signal, an option; letters that stand for something."""


def english_of(text: str) -> list[str]:
    """Words of a text that are English."""
    bare = _NAME.sub(" ", _SPEC.sub(" ", text))
    return [
        word
        for word in re.findall(r"(?<![\w-])[A-Za-z]+(?![\w-])", bare)
        if word.lower() in ENGLISH
    ]


def english_on(page: Page, own: frozenset[str] = frozenset()) -> Iterator[str]:
    """Texts of a page that are English; `own` are texts that people wrote, as they stand."""
    for text in page.evaluate(SEEN):
        for name in own:
            text = text.replace(name, " ")
        if english_of(text):
            yield text


def as_pattern(text: str) -> re.Pattern[str]:
    """What a text with places for values looks like when they are there."""
    return re.compile(re.sub(r"\\{\w+\\}", ".+?", re.escape(text.strip())))
