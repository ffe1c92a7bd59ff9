"""Where files that operations import wait until a worker reads them."""

from __future__ import annotations

from app.core.blobs import IMPORTS, BlobStore
from app.core.settings import Settings


def imports_store(settings: Settings) -> BlobStore:
    """The part of the store in which files to be imported wait."""
    return BlobStore(settings.blob_store_url, IMPORTS)
