"""Which version of the code this is. Imports nothing heavy, so that ``versant --version`` answers at once."""

from __future__ import annotations

from fusion import __version__


def code_version() -> str:
    """The version of the code that runs, as ``fusion/__init__.py`` states it."""
    return __version__
