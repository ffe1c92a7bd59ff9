"""The documents of ``docs/`` as the service shows them: Markdown made into HTML that the pages' policy allows.

``index.md`` names the sections and their pages, in order. Nothing here comes from a visitor: a name is only looked up
among the files that are there.
"""

from __future__ import annotations

import posixpath
import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.common.utils import escapeHtml
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token
from markdown_it.utils import EnvType, OptionsDict

ADDRESS = "/docs"
INDEX = "index"
_COMMENT = re.compile(r"<!--.*?-->\n?", re.DOTALL)
_OF_THE_SITE = ("_build/", "conf.py", "__pycache__/")
"""What ``make docs`` needs and makes."""
_ELSEWHERE = re.compile(r"https?:|mailto:")


def _folder() -> Path:
    """Where the documents are: inside an installed package (``setup.py`` puts them there), else in the checkout."""
    here = Path(__file__).resolve()
    installed = here.with_name("guides")
    return installed if installed.is_dir() else here.parents[2] / "docs"


FOLDER = _folder()


class Heading(NamedTuple):
    """A heading of the second level."""

    id: str
    text: str


class Guide(NamedTuple):
    """One page. ``html`` is its text, from the title on."""

    name: str
    title: str
    headings: list[Heading]
    html: str


class Section(NamedTuple):
    """A section of the index: its title, and of each page the name and the sentence that the index has for it."""

    title: str
    pages: list[tuple[str, str]]


@lru_cache(maxsize=1)
def files() -> dict[str, Path]:
    """Every file of the documents by its path within the folder."""
    named = {
        path.relative_to(FOLDER).as_posix(): path for path in sorted(FOLDER.rglob("*")) if path.is_file()
    }
    return {name: path for name, path in named.items() if not name.startswith(_OF_THE_SITE)}


@lru_cache(maxsize=256)
def guide(name: str) -> Guide | None:
    """The page of that name, such as ``how-to/record``; None: there is none."""
    path = files().get(f"{name}.md")
    if path is None:
        return None
    parser = _parser()
    tokens = parser.parse(_COMMENT.sub("", path.read_text(encoding="utf-8")))
    headings = _number_headings(tokens)
    for token in tokens:
        _rewrite_links(token.children or (), posixpath.dirname(name))
    title = next((_text(tokens[n + 1]) for n, token in enumerate(tokens) if token.tag == "h1"), name)
    return Guide(name, title, headings, parser.renderer.render(tokens, parser.options, {}))


@lru_cache(maxsize=1)
def sections() -> list[Section]:
    """The sections of the index, in order."""
    path = files().get(f"{INDEX}.md")
    tokens = _parser().parse(path.read_text(encoding="utf-8")) if path else []
    listed: list[Section] = []
    for token, content in pairwise(tokens):
        if token.type == "heading_open" and token.tag == "h2":
            listed.append(Section(_text(content), []))
        elif token.type == "paragraph_open" and token.level == 2 and listed:
            address = str((content.children or [Token("", "", 0)])[0].attrGet("href") or "")
            if address.endswith(".md"):
                sentence = _text(content).partition(": ")[2]
                listed[-1].pages.append((address.removesuffix(".md"), sentence))
    return listed


def slug(text: str) -> str:
    """The name of a heading in addresses, as readers of repositories and of the built site make it."""
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", text.lower()).strip())


def _text(token: Token) -> str:
    parts = (
        " " if one.type == "softbreak" else one.content for one in token.children or () if one.type != "image"
    )
    return "".join(parts)


def _number_headings(tokens: Sequence[Token]) -> list[Heading]:
    """Give each heading its id; those of the second level."""
    times: Counter[str] = Counter()
    second = []
    for token, content in pairwise(tokens):
        if token.type != "heading_open":
            continue
        text = _text(content)
        base = slug(text)
        name = f"{base}-{times[base]}" if times[base] else base
        times[base] += 1
        token.attrSet("id", name)
        if token.tag == "h2":
            second.append(Heading(name, text))
    return second


def _rewrite_links(tokens: Sequence[Token], folder: str) -> None:
    for token in tokens:
        attribute = {"image": "src", "link_open": "href"}.get(token.type)
        if attribute is None:
            continue
        address = str(token.attrGet(attribute) or "")
        if _ELSEWHERE.match(address):
            token.attrSet("rel", "noreferrer")
        elif not address.startswith("#"):
            token.attrSet(attribute, address_of(address, folder))


def address_of(link: str, folder: str) -> str:
    """Where a relative link of a page in ``folder`` leads on the service."""
    path, mark, anchor = link.partition("#")
    name = posixpath.normpath(posixpath.join(folder, path)).removesuffix(".md")
    return (ADDRESS if name == INDEX else f"{ADDRESS}/{name}") + mark + anchor


class _Renderer(RendererHTML):
    """HTML without inline styles; what scrolls sideways can be reached by keyboard, and a heading links to itself."""

    def heading_open(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        token = tokens[idx]
        name = token.attrGet("id")
        opened = f'<{token.tag} id="{name}">'
        return opened if token.tag == "h1" else f'{opened}<a class="self" href="#{name}">'

    def heading_close(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        tag = tokens[idx].tag
        return f"</{tag}>\n" if tag == "h1" else f"</a></{tag}>\n"

    def table_open(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        return '<div class="wide" tabindex="0"><table>\n'

    def table_close(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        return "</table></div>\n"

    def th_open(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        number = ' class="number"' if "right" in str(tokens[idx].attrGet("style")) else ""
        return f"<{tokens[idx].tag}{number}>"

    td_open = th_open

    def fence(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        return f'<pre tabindex="0"><code>{escapeHtml(tokens[idx].content)}</code></pre>\n'

    code_block = fence


def _parser() -> MarkdownIt:
    return MarkdownIt("commonmark", {"html": True}, renderer_cls=_Renderer).enable("table")
