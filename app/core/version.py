"""Which version of the code this is. Imports nothing heavy, so that ``versant --version`` answers at once."""

from __future__ import annotations

from importlib import metadata


def code_version() -> str:
    """The version as installed; ``unknown`` where the code runs from a tree that was never installed."""
    try:
        return metadata.version("versant")
    except metadata.PackageNotFoundError:
        return "unknown"
