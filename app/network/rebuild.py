"""The whole network from the stored passes: slopes and aggregates, from nothing else and in no order but the map's.

What it makes is what the drives made one by one, to a tenth of a sigma, and the same whatever came first. It is wanted
after an elevation import, which changes no slope by itself, after a change of the library's adjustment, and to be sure.
No drive is read again: what each says stands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.network.publish import refresh_aggregates
from app.network.regions import regions
from app.network.solve import settle_region
from app.network.versions import bump_data_version, own_network
from fusion.types import Progress, no_progress

_Part = TypeVar("_Part")

_PART = 500  # segments in a transaction: so long do drives that come and go wait

# Each stage is made anew wherever it is or ought to be: what lost its ground must go.
_IN_NETWORK = text(
    "SELECT segment_id FROM drive_passes UNION SELECT segment_id FROM network_slopes ORDER BY segment_id"
)
_PUBLISHED = text(
    """
    SELECT segment_id FROM network_slopes UNION SELECT segment_id FROM drive_segments
    UNION SELECT segment_id FROM segment_slopes ORDER BY segment_id
    """
)


def rebuild_network(sessions: Sessions, progress: Progress = no_progress) -> int:
    """Make slopes and aggregates anew; returns the number of segments of the network.

    In many short transactions, each of which owns the network: drives come and go meanwhile, and a rebuild that
    is cut off leaves a network that is right throughout. Run it again to go on.
    """
    with sessions() as session:
        in_network = list(session.execute(_IN_NETWORK).scalars())
        squares = regions(session, in_network)
    cells = frozenset(square.cell for square in squares)
    _in_parts(
        sessions, squares, lambda session, part: settle_region(session, part, cells), "slopes", progress
    )
    with sessions() as session:
        published = list(session.execute(_PUBLISHED).scalars())
    _in_parts(sessions, _parts(published), refresh_aggregates, "aggregates", progress)
    return len(in_network)


def _parts(ids: Sequence[int]) -> list[Sequence[int]]:
    return [ids[start : start + _PART] for start in range(0, len(ids), _PART)]


def _in_parts(
    sessions: Sessions,
    parts: Sequence[_Part],
    work: Callable[[Session, _Part], object],
    stage: str,
    progress: Progress,
) -> None:
    """Do the work part by part, each in a transaction of its own that owns the network."""
    for done, part in enumerate(parts):
        progress(stage, done / len(parts))
        with sessions.begin() as session:
            own_network(session)
            work(session, part)
            bump_data_version(session)
    progress(stage, 1.0)
