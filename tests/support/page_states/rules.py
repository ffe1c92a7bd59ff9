"""What every state of every page keeps to."""

from __future__ import annotations

import re
from functools import cache

from browser_fixtures import Tab
from page_states.table import HOLE, Combination, leaves, texts_of

LEAST_PX = 24
SMALL = """(least) => {
  const all = 'button, .button, summary, select, textarea, input:not([type=range], [type=hidden])';
  return [...document.querySelectorAll(all)]
    .filter((one) => one.checkVisibility({ visibilityProperty: true }) && !one.closest('.unseen'))
    .map((one) => ['checkbox', 'radio'].includes(one.type) ? one.closest('label') ?? one : one)
    .map((one) => [one, one.getBoundingClientRect()])
    .filter(([, { width, height }]) => height > 0 && Math.min(width, height) < least)
    .map(([one, { width, height }]) =>
      `${one.tagName} .${one.className} ${one.textContent.slice(0, 40)}: ${width} x ${height}`);
}"""
COVERED = """() => [...document.querySelectorAll('.maplibregl-ctrl-scale, .maplibregl-ctrl-attrib')].flatMap((one) => {
  const { left, right, top, bottom, width } = one.getBoundingClientRect();
  const page = one.closest('.maplibregl-map');
  if (width === 0) return [];
  return [[left + 3, top + 3], [right - 3, top + 3], [left + 3, bottom - 3], [right - 3, bottom - 3],
      [(left + right) / 2, (top + bottom) / 2]]
    .map(([x, y]) => [x, y, document.elementFromPoint(x, y)])
    .filter(([x, y, hit]) => hit ? !page.contains(hit) : document.querySelector('.map-page'))
    .map(([x, y, hit]) => `${one.className} under ${hit?.tagName} .${hit?.className} at ${x}, ${y}`);
})"""
"""On a page that scrolls, what is out of sight is covered by nothing."""
WRITTEN = """() => {
  const found = new Set();
  const foreign = '[lang=en], script, style, code, pre, select[aria-label] option, .settings select';
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode())
    if (!node.parentElement.closest(foreign)) found.add(node.data.trim());
  for (const one of document.body.querySelectorAll('[aria-label], [title], [placeholder], [aria-valuetext], [alt]'))
    if (!one.closest(foreign))
      for (const name of ['aria-label', 'title', 'placeholder', 'aria-valuetext', 'alt'])
        found.add((one.getAttribute(name) ?? '').trim());
  return [...found].filter(Boolean);
}"""

TRANSLATED = """![...document.querySelectorAll('.maplibregl-ctrl-attrib-inner')]
  .some((one) => one.textContent.includes('contributors'))"""


@cache
def patterns_of(language: str) -> tuple[frozenset[str], re.Pattern[str]]:
    """Texts without holes, and what matches those with holes of which two words are known."""
    texts = set(leaves(texts_of(language)))
    holed = {
        one for one in texts if "{" in one and len(re.findall(r"[^\W\d_]{3,}", re.sub(r"{\w+}", "", one))) > 1
    }
    written = "|".join(HOLE.sub(".+", re.escape(one)) for one in sorted(holed))
    return frozenset(one for one in texts if "{" not in one), re.compile(written)


def of_another_language(written: list[str], language: str) -> list[str]:
    """What is a text of another language of the pages, and none of this."""
    own, own_holed = patterns_of(language)
    others, others_holed = patterns_of("en" if language == "de" else "de")
    return [
        one
        for one in written
        if (one in others - own or others_holed.fullmatch(one)) and not own_holed.fullmatch(one)
    ]


def broken(tab: Tab, how: Combination) -> dict[str, list[str]]:
    """Which rules the page breaks that a tab shows, and where."""
    page = tab.page
    assert page.locator("html").get_attribute("data-theme") == how.theme
    assert page.locator("html").get_attribute("lang") == how.language
    if how.language == "de":  # the credit of a map is in its reader's language once the map rests
        tab.await_true(TRANSLATED)
    wide: int = page.evaluate("document.documentElement.scrollWidth - innerWidth")
    found = {
        "wider than the window, px": [str(wide)] if wide > 0 else [],
        "covered": page.evaluate(COVERED),
        "targets too small": page.evaluate(SMALL, LEAST_PX),
        "of another language": of_another_language(page.evaluate(WRITTEN), how.language),
        "nearly white": tab.white_boxes() if how.theme == "dark" else [],
        "axe-core": tab.faults(),
    }
    return {rule: where for rule, where in found.items() if where}
