"""Maps as files: of segments at hand among the roads of a file, and of what the database holds in a box.

Importing this imports matplotlib: import it where a picture is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.core.messages import say
from app.map import store
from app.map.picture import slope_map
from app.map.picture.slope_picture import write_map
from app.map.segment import Segment
from app.map.store import all_segments
from fusion.messages import told
from fusion.roads.table import RoadTable

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from app.core.db import Bounds


def map_of_segments(
    path: Path,
    segments: Sequence[Segment],
    roads: RoadTable,
    around: RoadTable,
    *,
    title: str,
    source: str,
    scale: float | None = None,
) -> None:
    """Draw segments of a road file with the other ``roads`` around; without any, only the roads ``around``.

    Where there are too many roads, those without a slope are left out. Raises ``MapError`` and ``OSError``.
    """
    box = slope_map.frame_around(slope_map.extent_of(segments)) if segments else None
    near = roads.within(*box) if box else around
    drawn, notes = slope_map.map_segments(near, segments), list[str]()
    if segments and len(near) > slope_map.MOST_SEGMENTS:
        notes = [say("picture.left_out", count=len(near), most=slope_map.MOST_SEGMENTS)]
        drawn = slope_map.stored_segments(segments)
    write_map(path, drawn, title=title, credit=source, scale_percent=scale, box_deg=box, notes=notes)


def map_of_store(
    session: Session,
    path: Path,
    box: Bounds | None,
    *,
    driven: bool,
    gaps: bool,
    source: str,
    scale: float | None,
) -> tuple[int, list[str]]:
    """Draw what the database holds in the box, by default around all that was driven; returns how many segments are
    drawn, and remarks.

    Where there are too many, undriven roads are left out; raises ``MapError`` where that does not help, where
    nothing is there, and where the box is too large for a map.
    """
    if box is None:
        _refuse_too_many(store.count_segments(session, driven=True))
        box = slope_map.frame_around(slope_map.extent_of(all_segments(session, driven=True)))
    else:
        box = slope_map.no_strip(box)
    notes = list[str]()
    count = store.count_segments(session, bbox=box, driven=True if driven else None)
    if count > slope_map.MOST_SEGMENTS and not driven:
        notes = [say("picture.left_out", count=count, most=slope_map.MOST_SEGMENTS)]
        driven, count = True, store.count_segments(session, bbox=box, driven=True)
    _refuse_too_many(count)
    if not count:
        raise slope_map.MapError(say("picture.no_road"))
    segments = list(all_segments(session, box, driven=driven or None, gaps=gaps))
    drawn, title = slope_map.stored_segments(segments), told("Road slopes")
    write_map(path, drawn, title=title, credit=source, scale_percent=scale, box_deg=box, notes=notes)
    return len(segments), notes


def _refuse_too_many(count: int) -> None:
    if count > slope_map.MOST_SEGMENTS:
        raise slope_map.MapError(say("picture.too_many", n=count, most=slope_map.MOST_SEGMENTS))
