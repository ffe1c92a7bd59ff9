"""What every job is given to work with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings import Settings
from app.core.settings.places import FilePlace


@dataclass(frozen=True)
class JobContext:
    """The settings, the database, and the places of files that follow from the settings."""

    settings: Settings
    sessions: Sessions
    roads_changed: Callable[[Sessions], object] = lambda _: None
    """Called when an operation has changed roads: drives that lost something are to be computed again."""

    @cached_property
    def blobs(self) -> BlobStore:
        """The uploaded logs."""
        return BlobStore(self.settings.blob_store_url)

    @property
    def dem_dir(self) -> FilePlace:
        """The elevation rasters."""
        return self.settings.dem_dir

    def part(self, name: str) -> BlobStore:
        """The part of the blob store with this name."""
        return BlobStore(self.settings.blob_store_url, name)

    def scratch(self, name: str) -> Path:
        """The folder below which each run of a kind of request has a folder of its own."""
        return self.settings.data_dir / name
