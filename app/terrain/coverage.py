"""Which elevation rasters lie under which roads: for attributions, and for what the removal of a raster changes.

The rasters' bounds in the database decide: a void inside counts as covered, and a raster of unknown bounds covers
everything. No raster is opened here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.terrain.store import DemSet, DemSource

_WORLD: Bounds = (-180.0, -90.0, 180.0, 90.0)

# A box for each of some rasters; ``left_`` in front of the names of the parameters: of other ones.
_BOXES = """
    (SELECT number, ST_MakeEnvelope(w, s, e, n, 4326) AS box
     FROM unnest(CAST(:{0}west AS float8[]), CAST(:{0}south AS float8[]), CAST(:{0}east AS float8[]),
                 CAST(:{0}north AS float8[])) WITH ORDINALITY AS g (w, s, e, n, number))
"""
# Those in which there are segments.
_WITH_SEGMENTS = f"""
    SELECT number FROM {_BOXES.format("")} AS raster
    WHERE EXISTS (SELECT FROM segments AS s WHERE s.geom && raster.box {{and_within}})
"""  # noqa: S608 - constants
_WITHIN = "AND ST_Intersects(s.geom, ST_MakeEnvelope(:w, :s, :e, :n, 4326))"
_DRIVEN = "AND EXISTS (SELECT FROM segment_slopes AS a WHERE a.segment_id = s.id AND a.drives > 0)"
_COUNT = text(f"""
    SELECT count(s.id) FROM {_BOXES.format("")} AS raster LEFT JOIN segments AS s ON s.geom && raster.box
    GROUP BY number ORDER BY number
""")  # noqa: S608 - constants

# Of the segments in some boxes: how many are measured, and how many of these lie in no other box.
_EFFECT = text(f"""
    WITH gone AS {_BOXES.format("")}, others AS {_BOXES.format("left_")}, under AS (
        SELECT DISTINCT s.id, s.geom FROM gone JOIN segments AS s ON s.geom && gone.box
    )
    SELECT count(*) AS segments, count(a.segment_id) AS measured,
           count(a.segment_id) FILTER (WHERE NOT EXISTS (SELECT FROM others WHERE u.geom && others.box)) AS bare,
           (SELECT count(*) FROM drives AS d WHERE d.status = 'done'
                AND EXISTS (SELECT FROM gone WHERE d.bounds && gone.box)) AS drives
    FROM under AS u LEFT JOIN segment_slopes AS a ON a.segment_id = u.id AND a.drives > 0
""")  # noqa: S608 - constants


def rasters_over(
    session: Session, active: DemSet | None, *, bbox: Bounds | None = None, driven: bool = False
) -> tuple[str, ...]:
    """Names of ``sources_over``."""
    return tuple(source.name for source in sources_over(session, active, bbox=bbox, driven=driven))


def sources_over(
    session: Session, active: DemSet | None, *, bbox: Bounds | None = None, driven: bool = False
) -> tuple[DemSource, ...]:
    """The rasters that cover a segment: one that meets the box, and was driven, where that is asked."""
    if active is None:
        return ()
    within = f"{_WITHIN if bbox else ''} {_DRIVEN if driven else ''}"
    corners = dict(zip("wsen", bbox, strict=True)) if bbox else {}
    query = text(_WITH_SEGMENTS.format(and_within=within))
    numbers = session.execute(query, {**_columns(active.sources), **corners}).scalars()
    return tuple(active.sources[number - 1] for number in sorted(numbers))


def segments_under(session: Session, sources: Sequence[DemSource]) -> list[int]:
    """How many segments meet the box of each raster."""
    return [int(count) for count in session.execute(_COUNT, _columns(sources)).scalars()]


@dataclass(frozen=True)
class Effect:
    """What goes with some rasters: segments under them, how many of these are measured, how many of those no other
    raster covers, and how many drives were computed there.
    """

    segments: int
    measured: int
    bare: int
    drives: int


def effect_of_removal(session: Session, gone: Sequence[DemSource], left: Sequence[DemSource]) -> Effect:
    """What the removal of some rasters changes where others are left."""
    others = {f"left_{name}": values for name, values in _columns(left).items()}
    return Effect(**session.execute(_EFFECT, {**_columns(gone), **others}).one()._mapping)


def names_over(active: DemSet | None, boxes_deg: Sequence[Bounds]) -> tuple[str, ...]:
    """Credits, or else names, of the rasters that meet one of the boxes (west, south, east, north)."""
    sources = () if active is None else active.sources
    return tuple(source.credit for source in sources if any(map(source.may_meet, boxes_deg)))


def _columns(sources: Sequence[DemSource]) -> dict[str, list[float]]:
    bounds = [source.bounds_deg or _WORLD for source in sources]
    return {name: [box[k] for box in bounds] for k, name in enumerate(("west", "south", "east", "north"))}
