"""Every stored segment, read page by page: for files and pictures of the whole map, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.map.segment import Segment
from app.map.store import segment_items

PAGE = 5000
"""Segments that are read from the database at once."""


def all_segments(
    session: Session,
    bbox: Bounds | None = None,
    *,
    driven: bool = False,
    gaps: bool = False,
    region: int | None = None,
) -> Iterator[Segment]:
    """Every segment that meets the box, or of them those that were driven; ``gaps`` and ``region`` as in
    ``segment_items``."""
    after, only_driven = 0, True if driven else None
    while rows := segment_items(
        session, bbox=bbox, after_id=after, limit=PAGE, driven=only_driven, gaps=gaps, region=region
    ):
        yield from rows
        after = rows[-1].stored_id
