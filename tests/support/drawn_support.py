# mypy: disable-error-code="arg-type"
"""What low zooms draw, in the simplest form: each segment is a piece of its own on every level.

Says which cells changed as the worker that derives it does: in the transaction that writes it.
"""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.tables.served import DRAWN_LEVELS
from app.network.cells import cells_over

_DRAWN = text("SELECT segment_id, highway, oneway, slope_percent, drives FROM drawn_pieces WHERE level = 12")
_DRAW = text(
    """
    INSERT INTO drawn_pieces (level, cell, segment_id, rank, highway, oneway, slope_percent, slope_sigma_percent,
        drives, length_m, geom_3857)
    SELECT level, (s.cell >> 14 >> 12 - level) << level + 2 | (s.cell & 16383) >> 12 - level, s.id,
        CASE WHEN s.highway LIKE 'motorway%' THEN 0 WHEN s.highway LIKE 'primary%' THEN 2 ELSE 5 END, s.highway,
        s.oneway, a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0), s.length_m, s.geom_3857
    FROM unnest(CAST(:levels AS integer[])) AS level, segments AS s
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
    """
)
_RAISE = text("UPDATE cells SET drawn_version = drawn_version + 1 WHERE id = ANY(CAST(:ids AS integer[]))")


def draw(sessions: Sessions) -> None:
    """Derive all pieces anew, and raise the versions of what is drawn where that changes them."""
    with sessions.begin() as session:
        before = _drawn(session)
        session.execute(text("DELETE FROM drawn_pieces"))
        session.execute(_DRAW, {"levels": list(DRAWN_LEVELS)})
        after = _drawn(session)
        changed = {row[0] for row in before ^ after}
        session.execute(_RAISE, {"ids": cells_over(session, changed)})


def _drawn(session: Session) -> set[tuple[object, ...]]:
    return {tuple(row) for row in session.execute(_DRAWN)}
