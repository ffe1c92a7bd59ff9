"""A drive's parts without the ends of the trip, for whom its owner hands them on to. Knows no SQL.

Where they are cut is said by ``app.releases.handing_on``, as it is for editions.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Annotated, Literal

import numpy as np
from fastapi import Query
from sqlalchemy.orm import Session

from app.drives import tracks
from app.drives.documents import Drive
from app.map.store import DriveSegmentRow
from app.releases.handing_on import left_of
from fusion.types import Bools, DrawnMeasurements, Floats, Track

Ends = Literal["hidden"] | None
EndsQuery = Annotated[
    Ends,
    Query(
        description="Without the ends of the trip, its stops and its owner's zones, each as far as editions of the "
        "public map leave it out. What is left is interrupted there, and its distance begins at 0. Unset: all of it."
    ),
]


def shown_track(session: Session, drive: Drive, track: Track, ends: Ends) -> Track:
    """The drive's track as it is, or what is left of it without the ends of the trip, interrupted at each cut."""
    if ends is None:
        return track
    return rows_of_track(track, left_of(session, drive.id, drive.owner_id, track).rows)


def rows_of_track(track: Track, stays: Bools) -> Track:
    """These rows of a track alone; behind those that are left out it begins anew."""
    after_cut = stays & ~np.concatenate([[True], stays[:-1]])
    whole = replace(track, after_outage=track.after_outage | after_cut)
    return Track(**{spec.name: getattr(whole, spec.name)[stays] for spec in fields(Track)})


def shown_measurements(
    measurements: DrawnMeasurements | None, track: Track, ends: Ends
) -> DrawnMeasurements | None:
    """The measurements as they are, or those alone that fall between rows of what is left of the track."""
    if measurements is None or ends is None:
        return measurements
    stays = _within(track, measurements.time_s)
    columns = [spec.name for spec in fields(DrawnMeasurements) if spec.name != "names"]
    return replace(measurements, **{name: getattr(measurements, name)[stays] for name in columns})


def _within(track: Track, time_s: Floats) -> Bools:
    timed = np.isfinite(track.time_s)
    own, begins = track.time_s[timed], track.after_outage[timed]
    if not len(own):
        return np.zeros(len(time_s), bool)
    behind = np.searchsorted(own, time_s)
    row = np.minimum(behind, len(own) - 1)
    between = (behind > 0) & (behind < len(own)) & ~begins[row]
    return np.asarray(between | (own[row] == time_s), bool)


def shown_estimates(
    session: Session, drive: Drive, estimates: list[DriveSegmentRow], ends: Ends
) -> list[DriveSegmentRow]:
    """The estimates as they are, or those of segments over which no pass is left out."""
    track = None if ends is None else tracks.read_track(session, drive.id)
    if ends is None or track is None:
        return estimates if ends is None else []
    told = left_of(session, drive.id, drive.owner_id, track).segments
    return [estimate for estimate in estimates if estimate.segment.stored_id in told]
