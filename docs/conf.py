"""Settings of the site that ``make docs`` builds of these pages, for Sphinx.

``index.md`` is the one list of pages: what it lists section by section becomes the site's navigation.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fusion import __version__

project = "Versant"
author = "Versant's contributors"
copyright = "Versant's contributors, Apache-2.0"  # noqa: A001 - Sphinx calls it so
release = version = __version__

extensions = ["myst_parser"]
exclude_patterns = ["_build"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"Versant {release}"
html_show_sphinx = False
html_copy_source = False
nitpicky = True
smartquotes = False

_SECTION = re.compile(r"^## (.+)\n((?:(?!^## ).*\n?)*)", re.MULTILINE)
_PAGE = re.compile(r"^- \[[^\]]+\]\((.+?)\.md\)", re.MULTILINE)


def _add_navigation(app: Any, name: str, source: list[str]) -> None:
    """Sphinx takes its navigation from directives, which readers of the repository need not see."""
    if name != "index":
        return
    for title, text in _SECTION.findall(source[0]):
        pages = "\n".join(_PAGE.findall(text))
        source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{pages}\n```\n"


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _add_navigation)
