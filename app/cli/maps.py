"""The maps that commands draw: of what ``fuse`` made of files, and of what the database holds in a box."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fusion.errors import UnknownNameError

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from app.cli.fuse_files import Fusion
    from app.core.db import Bounds
    from app.map.segment import Segment

LEFT_OUT = "Undriven roads are left out: with them there are {count} segments, and a map shows {most}."
PAGE = 5000
"""Segments that are read from the database at once."""


def usable_map(path: Path | None, scale: float | None) -> None:
    """Refuse, before any work, a suffix that no picture has, and a scale without a map."""
    from app.map.slope_map import picture_format

    if path is None and scale is not None:
        raise typer.BadParameter("it is the scale of a map, and no --map is asked for.", param_hint="--scale")
    if path is not None:
        try:
            picture_format(path)
        except UnknownNameError as error:
            raise typer.BadParameter(str(error), param_hint="--map") from error


def map_of_logs(
    fusion: Fusion, features: Sequence[Segment], path: Path, source: str, scale: float | None
) -> None:
    """Draw the slopes of the logs that were fused, with the other roads around; raises ``MapError``, ``OSError``."""
    from app.map.slope_map import MOST_SEGMENTS, extent_of, frame_around, map_segments, stored_segments
    from app.map.slope_picture import slope_map

    count = len(fusion.fused)
    name = fusion.fused[0].source.short_name if count == 1 else f"{count} drives"
    box = frame_around(extent_of(features)) if features else None
    roads = fusion.roads.within(*box) if box else fusion.surroundings()
    drawn, notes = map_segments(roads, features), list[str]()
    if features and len(roads) > MOST_SEGMENTS:
        notes = [LEFT_OUT.format(count=len(roads), most=MOST_SEGMENTS)]
        drawn = stored_segments(features)
    slope_map(
        path, drawn, title=f"Slopes from {name}", credit=source, scale_percent=scale, box_deg=box, notes=notes
    )


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
    from app.map import store
    from app.map.slope_map import MOST_SEGMENTS, MapError, extent_of, frame_around, no_strip, stored_segments
    from app.map.slope_picture import slope_map

    if box is None:
        _refuse_too_many(store.count_segments(session, driven=True))
        box = frame_around(extent_of(stored(session, None, driven=True)))
    else:
        box = no_strip(box)
    notes = list[str]()
    count = store.count_segments(session, bbox=box, driven=True if driven else None)
    if count > MOST_SEGMENTS and not driven:
        notes = [LEFT_OUT.format(count=count, most=MOST_SEGMENTS)]
        driven, count = True, store.count_segments(session, bbox=box, driven=True)
    _refuse_too_many(count)
    if not count:
        raise MapError("There is no road in that box. Import the roads there, or name another --bbox.")
    segments = list(stored(session, box, driven=driven, gaps=gaps))
    slope_map(
        path,
        stored_segments(segments),
        title="Road slopes",
        credit=source,
        scale_percent=scale,
        box_deg=box,
        notes=notes,
    )
    return len(segments), notes


def _refuse_too_many(count: int) -> None:
    from app.map.slope_map import MOST_SEGMENTS, MapError

    if count > MOST_SEGMENTS:
        raise MapError(
            f"{count} driven segments are to be drawn, and a map shows {MOST_SEGMENTS} at most. Name a smaller box, "
            "such as --bbox 8.46,48.95,8.50,48.99."
        )


def stored(
    session: Session, box: Bounds | None, *, driven: bool = False, gaps: bool = False
) -> Iterator[Segment]:
    """Every segment of the database that meets the box, read page by page; ``gaps`` as in ``segment_items``."""
    from app.map import store

    after = 0
    while rows := store.segment_items(
        session, bbox=box, after_id=after, limit=PAGE, driven=True if driven else None, gaps=gaps
    ):
        yield from rows
        after = rows[-1].stored_id
