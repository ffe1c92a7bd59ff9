"""Tiles that wait to be drawn anew: any number of lanes draw them, each another one, and none is left out.

A tile of the finest level waits together with its block, for the two are drawn as one. Whoever draws claims the tile,
reads a snapshot, and takes the rows of what it draws away when it writes: they must be those that it read. Asking for
a tile that waits already writes its row anew, so that a drawing from before the question comes to nothing, and the tile
waits on. So what is written does not depend on the claim, which only spares work. Rows are written and held by
descending level and ascending tile: nobody waits for somebody who waits for him.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.map.derived.drawing import BLOCK, FINEST, children, parent

_ASK = text("""
    INSERT INTO cells_to_draw (level, cell, since)
    SELECT level, cell, clock_timestamp()
    FROM unnest(CAST(:levels AS smallint[]), CAST(:tiles AS integer[])) AS asked (level, cell)
    ORDER BY level DESC, cell
    ON CONFLICT (level, cell) DO UPDATE SET since = cells_to_draw.since
""")

# The finest first, for others are made of them, and none of whose sixteen tiles of the level below any waits; but none
# waits for ever while changes come. The tile of another level that a tile lies in: ``drawing.parent``.
_NEXT = text("""
    SELECT level, cell FROM (
        SELECT level, cell, since,
               level < :block AND since < clock_timestamp() - make_interval(secs => :long_s) AS long
        FROM cells_to_draw) AS t
    WHERE level >= :block OR long OR NOT EXISTS (
        SELECT FROM cells_to_draw AS b
        WHERE b.level = t.level + 2
            AND (((b.cell >> (b.level + 4)) << b.level) | ((b.cell & ((1 << (b.level + 2)) - 1)) >> 2)) = t.cell)
    ORDER BY long DESC, level DESC, since, cell LIMIT :most
""")
_ASKED = text("""
    SELECT level, cell, CAST(CAST(xmin AS text) AS bigint) FROM cells_to_draw
    WHERE level = :level AND cell = :tile OR level = :below AND cell = ANY(CAST(:tiles AS integer[]))
    ORDER BY level DESC, cell
""")
_READ = """
    unnest(CAST(:levels AS smallint[]), CAST(:tiles AS integer[]), CAST(:written AS bigint[])) AS r (level, cell, xid)
"""
_HOLD = text(f"""
    SELECT c.cell FROM cells_to_draw AS c JOIN {_READ} USING (level, cell)
    WHERE CAST(CAST(c.xmin AS text) AS bigint) = r.xid ORDER BY c.level DESC, c.cell FOR UPDATE OF c
""")  # noqa: S608 - constants
_TAKE_OFF = text(f"""
    DELETE FROM cells_to_draw AS c USING {_READ} WHERE c.level = r.level AND c.cell = r.cell
""")  # noqa: S608 - constants


class Asked(NamedTuple):
    """A tile that waits, and the transaction that asked for it last."""

    level: int
    tile: int
    xid: int


class Unit(NamedTuple):
    """What is drawn at once: a block with the tiles of the finest level inside it, or a tile of a level above."""

    level: int
    tile: int

    @property
    def key(self) -> int:
        """Its claim."""
        return self.level << 32 | self.tile


def ask_to_draw(session: Session, level: int, tiles: Collection[int]) -> None:
    """Let these tiles be drawn anew, whoever may be drawing them just now."""
    asked = {(level, tile) for tile in tiles}
    if level == FINEST:
        asked |= {(BLOCK, parent(FINEST, tile)) for tile in tiles}
    if asked:
        levels, cells = zip(*sorted(asked), strict=True)
        session.execute(_ASK, {"levels": list(levels), "tiles": list(cells)})


def next_units(session: Session, long_s: float, most: int) -> list[Unit]:
    """What is to be drawn next, in this order, of the first ``most`` tiles that wait."""
    rows = session.execute(_NEXT, {"block": BLOCK, "long_s": long_s, "most": most})
    units = (
        Unit(BLOCK, parent(FINEST, tile)) if level == FINEST else Unit(level, tile) for level, tile in rows
    )
    return list(dict.fromkeys(units))


def asked_of(session: Session, unit: Unit) -> list[Asked]:
    """The tiles of it that wait."""
    inside = sorted(children(BLOCK, unit.tile)) if unit.level == BLOCK else []
    values = {"level": unit.level, "tile": unit.tile, "below": FINEST, "tiles": inside}
    return [Asked(*row) for row in session.execute(_ASKED, values)]


def take_off(session: Session, asked: Sequence[Asked]) -> bool:
    """They wait no more from the end of the transaction on; False, and nothing is changed, where one was drawn by
    somebody else or asked for anew."""
    levels, tiles, written = (list(column) for column in zip(*asked, strict=True))
    values = {"levels": levels, "tiles": tiles, "written": written}
    if len(session.execute(_HOLD, values).all()) < len(asked):
        return False
    session.execute(_TAKE_OFF, values)
    return True
