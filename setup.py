"""Puts the documents of ``docs/`` into the package, where ``app/web/guides.py`` finds them.

Everything else is in pyproject.toml.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

DOCUMENTS = Path("docs")
PLACE = Path("app", "web", "guides")
SHOWN = {".md", ".png", ".json", ".ipynb", ".py"}


def documents() -> list[Path]:
    """What the service shows of ``docs/``: no settings of the site, nothing built."""
    names = (path for path in sorted(DOCUMENTS.rglob("*")) if path.suffix in SHOWN)
    return [path for path in names if "_build" not in path.parts and path.name != "conf.py"]


class BuildWithDocuments(build_py):
    """The packages, and the documents beside them; a development install finds these in the checkout."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        for path in documents():
            target = Path(self.build_lib, PLACE, path.relative_to(DOCUMENTS))
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)

    def get_source_files(self) -> list[str]:
        """For the source archive."""
        return [*super().get_source_files(), *map(str, documents())]


setup(cmdclass={"build_py": BuildWithDocuments})
