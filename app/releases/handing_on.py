"""What is left of one drive where its owner hands it on without the ends of the trip: cut as editions cut.

A row of its track goes that lies in a circle, or belongs to a pass that editions tell to nobody; an estimate goes with
any such pass over its segment. Reads alone.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy.orm import Session

from app.releases import store
from app.releases.ends import (
    ON_FROM_THERE_M,
    Circle,
    Driven,
    Timed,
    ends_of_drive,
    hidden,
    near,
)
from app.releases.places import Places
from fusion.types import Bools, Track


@dataclass(frozen=True, eq=False)
class Left:
    """What is left of a drive."""

    rows: Bools
    """Whether each row of its track is."""
    segments: frozenset[int]
    """Those of which an estimate is."""


def left_of(session: Session, drive_id: uuid.UUID, owner_id: int, track: Track) -> Left:
    """What is left of that owner's drive with this track, whose segments are the database's."""
    drive = store.driven(session, [drive_id]).get(drive_id) or _driven_by_rows(session, track)
    ends = ends_of_drive(Timed(track.time_s, track.lon_deg, track.lat_deg), drive)
    circles = Places(session).around(owner_id, ends)
    if drive is None:
        return Left(rows_left(track, None, np.zeros(0, bool), circles), frozenset())
    roads_at = store.roads_at(session, sorted(near(drive, circles)))
    out = np.isin(drive.sequence, hidden(drive, circles, roads_at))
    told = set(drive.segment.tolist()) - set(drive.segment[out].tolist())
    return Left(rows_left(track, drive, out, circles), frozenset(told))


def _driven_by_rows(session: Session, track: Track) -> Driven | None:
    """The passes of a drive whose method leaves none: the roads that the rows of its track are on; None: on none."""
    begins = np.flatnonzero(
        (track.segment >= 0) & np.isfinite(track.time_s) & (np.diff(track.segment, prepend=-1) != 0)
    )
    segments = track.segment[begins]
    roads = store.roads(session, np.unique(segments).tolist())
    stays = [
        (k, segment, *roads[segment], entered_s)
        for k, (segment, entered_s) in enumerate(
            zip(segments.tolist(), track.time_s[begins].tolist(), strict=True)
        )
        if segment in roads
    ]
    return store.driven_of(stays) if stays else None


def rows_left(track: Track, drive: Driven | None, out: Bools, circles: Sequence[Circle]) -> Bools:
    """Which rows of the track are left; ``out``: which passes of the drive, if it has any, are told to nobody."""
    beyond_m = np.full(len(track), np.inf)
    for circle in circles:
        beyond_m = np.fmin(beyond_m, circle.beyond_m(track.lon_deg, track.lat_deg))
    placed = np.isfinite(track.lon_deg) & np.isfinite(track.lat_deg) & np.isfinite(track.time_s)
    gone = beyond_m <= 0
    on_pass = np.zeros(len(track), bool)
    if drive is not None:
        on_pass, of_hidden = _by_pass(track, drive, out)
        on_pass &= placed
        gone |= on_pass & of_hidden
    # Rows on no road, and without a place, would tell where the cut is and when the drive began: near a place they go
    # together, where one of them goes or what is before or behind them.
    loose = ~on_pass & (~placed | (beyond_m <= ON_FROM_THERE_M))
    borders = np.flatnonzero(np.diff(np.concatenate([[False], loose, [False]])))
    with_neighbours = np.concatenate([[True], gone, [True]])
    for begin, end in borders.reshape(-1, 2).tolist():
        gone[begin:end] |= with_neighbours[begin : end + 2].any()
    return ~gone


def _by_pass(track: Track, drive: Driven, out: Bools) -> tuple[Bools, Bools]:
    """Whether each row is on the segment of a pass at about its time, and whether any such is told to nobody."""
    order = np.argsort(drive.entered_s, kind="stable")
    segment, out = drive.segment[order], out[order]
    last = np.searchsorted(drive.entered_s[order], track.time_s, side="right") - 1
    on_pass, of_hidden = np.zeros(len(track), bool), np.zeros(len(track), bool)
    for at in (last - 1, last, last + 1):
        there = (at >= 0) & (at < len(order))
        k = np.where(there, at, 0)
        same = there & (segment[k] == track.segment)
        on_pass |= same
        of_hidden |= same & out[k]
    return on_pass, of_hidden
