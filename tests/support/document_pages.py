"""The pages of the documentation, as the tests of documents read them."""

from __future__ import annotations

import re

from source_tree import REPOSITORY

README = REPOSITORY / "README.md"
DOCS = REPOSITORY / "docs"
PAGES = (
    README,
    REPOSITORY / "CONTRIBUTING.md",
    *(path for path in sorted(DOCS.rglob("*.md")) if "_build" not in path.parts),
)
TABLE = re.compile(r"<!-- table: (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)
"""A generated table: its name and its content."""


def prose() -> str:
    """All pages without their generated tables."""
    return "\n".join(TABLE.sub("", page.read_text()) for page in PAGES)
