"""Imports surveyed heights, one at each place, and solves the roads again where a height changes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.telemetry.events import imported
from app.network.extracts import roads_within
from app.network.locks import own_network
from app.network.marks import append_marks
from app.network.settle import settle_about
from app.network.solve import widened
from fusion.network.control import ControlPoint, place
from fusion.types import Progress, no_progress

_ALL = text("SELECT lon_deg, lat_deg, height_m, sigma_m, name FROM control_points ORDER BY lon_deg, lat_deg")
_WRITE = text("""
    INSERT INTO control_points (lon_deg, lat_deg, height_m, sigma_m, name)
    VALUES (:lon_deg, :lat_deg, :height_m, :sigma_m, :name)
    ON CONFLICT (lon_deg, lat_deg) DO UPDATE SET
        height_m = excluded.height_m, sigma_m = excluded.sigma_m, name = excluded.name, imported_at = now()
""")
_DELETE = text("DELETE FROM control_points WHERE lon_deg = :lon_deg AND lat_deg = :lat_deg")
_IN_NETWORK = text(
    "SELECT segment_id FROM network_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[])) ORDER BY segment_id"
)

Place = tuple[float, float]
"""Longitude and latitude: there is one point at a place."""


@dataclass(frozen=True)
class ControlCounts:
    """What an import changed, and how many of its points have no road near them."""

    added: int
    changed: int
    unchanged: int
    removed: int
    without_road: int
    segments: int
    """Of the network, that were solved again for it"""


@imported("control points")
def import_control(
    sessions: Sessions,
    points: Sequence[ControlPoint],
    *,
    replace: bool = False,
    progress: Progress = no_progress,
) -> ControlCounts:
    """Store points, each in the place of what is stored at its place, and solve the roads again where that changes.

    With ``replace`` all other points go: those of a file without any remove them all. Of points at one place the last
    counts. The roads are solved after the points are stored.
    """
    with sessions.begin() as session:
        own_network(session)
        stored = _by_place(ControlPoint(*row) for row in session.execute(_ALL))
        given = _by_place(points)
        added = [one for at, one in given.items() if at not in stored]
        changed = [one for at, one in given.items() if at in stored and _differs(one, stored[at])]
        gone = [one for at, one in stored.items() if replace and at not in given]
        if added or changed:
            session.execute(_WRITE, [vars(one) for one in (*added, *changed)])
        if gone:
            session.execute(_DELETE, [{"lon_deg": p.lon_deg, "lat_deg": p.lat_deg} for p in gone])
        touched = _segments(session, [*added, *changed, *gone])
        append_marks(session, touched)  # in case that settling is cut off
        without = sum(_on_road(session, one) is None for one in given.values())
    if touched:
        settle_about(sessions, touched, progress)  # heights reach farther than slopes
    unchanged = len(given) - len(added) - len(changed)
    return ControlCounts(len(added), len(changed), unchanged, len(gone), without, len(touched))


def _by_place(points: Iterable[ControlPoint]) -> dict[Place, ControlPoint]:
    return {(one.lon_deg, one.lat_deg): one for one in points}


def _differs(one: ControlPoint, other: ControlPoint) -> bool:
    """Its name is not what a point says."""
    return (one.height_m, one.sigma_m) != (other.height_m, other.sigma_m)


def _segments(session: Session, points: Sequence[ControlPoint]) -> list[int]:
    """The segments of the network that the points lie on."""
    on = {segment for one in points if (segment := _on_road(session, one)) is not None}
    return list(session.execute(_IN_NETWORK, {"ids": sorted(on)}).scalars()) if on else []


def _on_road(session: Session, point: ControlPoint) -> int | None:
    lon, lat = point.lon_deg, point.lat_deg
    table, ids = roads_within(session, widened((lon, lat, lon, lat)))
    placed, _ = place([point], table)
    return int(ids[placed.row[0]]) if len(placed) else None
