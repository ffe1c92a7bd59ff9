"""Stores, replaces and removes what one drive says of segments, and marks the cells that have to be solved for it.

How a drive is computed is not known here, nor what is shown of a segment (``app.map.store``), nor when a cell is
solved (``app.network.swap``).

One rule keeps the map right whatever runs at the same time: what a drive says is always stored together with marks of
the cells that it touches, and a cell is solved from everything that is stored.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_json
from app.network.duplicates import decide_duplicates, duplicates_of
from app.network.locks import own_hours, share_network
from app.network.marks import MarkedBy, append_marks
from app.network.passes import entry_seconds, replace_passes
from fusion.network.duplicates import LONGEST_ENTRY_S
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats, Ints, SegmentSlope

_NO_EPOCHS = np.empty(0)


@dataclass(frozen=True)
class RunProvenance:
    """How the estimates of one run were made; ``options`` complete, defaults included."""

    method: str
    options: Mapping[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None
    road_state: int | None = None
    """The highest state of the cells whose roads were read (``app.network.cells``)"""


# The published slopes of these segments may rest on the drive: on its own estimates or, until it is computed again, on
# estimates of a former model. What it contributes to the network is in its passes.
_DELETE_ESTIMATES = text("DELETE FROM drive_segments WHERE drive_id = :drive_id RETURNING segment_id")
_DELETE_PROVENANCE = text("DELETE FROM provenances WHERE drive_id = :drive_id")
_COUNTS = text("SELECT duplicate_of IS NULL FROM drives WHERE id = :drive_id")

_INSERT_PROVENANCE = text("""
    INSERT INTO provenances (drive_id, method, options, code_version, road_version_id, road_state, dem_version_id)
    VALUES (:drive_id, :method, CAST(:options AS jsonb), :code_version, :road_version_id, :road_state, :dem_version_id)
    RETURNING id
""")

_INSERT_ESTIMATES = text("""
    INSERT INTO drive_segments (drive_id, segment_id, slope_percent, slope_sigma_percent, observations,
                                passes, first_at, last_at, provenance_id, in_network)
    SELECT :drive_id, t.segment_id, t.slope, t.sigma, t.observations, t.passes, to_timestamp(t.first_at),
           to_timestamp(t.last_at), :provenance_id, :in_network
    FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope_percent AS float8[]), CAST(:slope_sigma_percent AS float8[]),
                CAST(:observations AS integer[]), CAST(:passes AS integer[]),
                CAST(:first_time_s AS float8[]), CAST(:last_time_s AS float8[]))
         AS t (segment_id, slope, sigma, observations, passes, first_at, last_at)
""")


def begin_change(session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor] = ()) -> None:
    """Keep out imports, and drives that can be duplicates of this one, before the drive's row is locked.

    ``factors`` are those that the drive is about to store; its stored passes count as well.
    """
    share_network(session)
    own_hours(session, {f.first_time_s for f in factors} | entry_seconds(session, drive_id), LONGEST_ENTRY_S)


def append_result(
    session: Session,
    drive: MarkedBy,
    segment_ids: Ints,
    estimates: Sequence[SegmentSlope],
    provenance: RunProvenance,
    factors: Sequence[PassFactor] = (),
    epoch_s: Floats = _NO_EPOCHS,
    *,
    delay_s: float = 0.0,
) -> list[int]:
    """Replace what the drive says, and mark the cells that have to be solved for it within ``delay_s``; these cells.

    ``segment_ids`` maps the segments of estimates and factors (indices into the network of the run) to the
    database's ids. ``epoch_s`` are the times of the log's positions (e,); without them two logs of one drive are
    recognised by their entries into segments alone. Estimates whose slope or sigma is not finite are left out. The
    caller has begun the change (``begin_change``) and holds the drive's row.
    """
    finite = [e for e in estimates if np.isfinite(e.slope_percent) and np.isfinite(e.slope_sigma_percent)]
    ids = [int(segment_ids[e.segment]) for e in finite]
    former = _delete_estimates(session, drive.drive_id)
    provenance_id = _insert_provenance(session, drive.drive_id, provenance)
    if finite:
        _insert_estimates(session, drive.drive_id, provenance_id, ids, finite, bool(factors))
    touched = _replace_evidence(session, drive.drive_id, in_database(factors, segment_ids), epoch_s)
    return append_marks(session, touched, [*former, *(() if factors else ids)], drive, delay_s)


def append_removal(session: Session, drive: MarkedBy) -> list[int]:
    """Remove all that the drive says, and mark the cells that have to be solved for it; these cells.

    The caller has begun the change (``begin_change``) and holds the drive's row.
    """
    former = _delete_estimates(session, drive.drive_id)
    touched = _replace_evidence(session, drive.drive_id, [], _NO_EPOCHS)
    return append_marks(session, touched, former, drive)


def in_database(factors: Sequence[PassFactor], segment_ids: Ints) -> list[PassFactor]:
    """Factors of a run with the database's ids of their segments."""
    return [factor.over(int(segment_ids[factor.segment])) for factor in factors]


def _replace_evidence(
    session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor], epoch_s: Floats
) -> set[int]:
    """Replace the drive's passes; the segments around which this changes the evidence."""
    counted = session.execute(_COUNTS, {"drive_id": drive_id}).scalar_one()
    changed = replace_passes(session, drive_id, factors, epoch_s)
    others = decide_duplicates(session, {drive_id, *duplicates_of(session, drive_id)})
    counts = session.execute(_COUNTS, {"drive_id": drive_id}).scalar_one()
    return {*(changed if counted or counts else ()), *others}


def _delete_estimates(session: Session, drive_id: uuid.UUID) -> list[int]:
    """Delete the drive's estimates; their segments."""
    former = list(session.execute(_DELETE_ESTIMATES, {"drive_id": drive_id}).scalars())
    session.execute(_DELETE_PROVENANCE, {"drive_id": drive_id})
    return former


def _insert_provenance(session: Session, drive_id: uuid.UUID, provenance: RunProvenance) -> int:
    options = json.dumps(plain_json(provenance.options))
    values = {**vars(provenance), "drive_id": drive_id, "options": options}
    return int(session.execute(_INSERT_PROVENANCE, values).scalar_one())


def _insert_estimates(
    session: Session,
    drive_id: uuid.UUID,
    provenance_id: int,
    ids: list[int],
    estimates: Sequence[SegmentSlope],
    in_network: bool,
) -> None:
    columns = (
        "slope_percent",
        "slope_sigma_percent",
        "observations",
        "passes",
        "first_time_s",
        "last_time_s",
    )
    values = {name: np.array([getattr(e, name) for e in estimates]) for name in columns}
    one = {"drive_id": drive_id, "provenance_id": provenance_id, "in_network": in_network}
    session.execute(_INSERT_ESTIMATES, {**one, **values, "segment_id": np.array(ids)})
