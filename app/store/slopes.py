"""Estimates per drive, their combination per segment, and the data's version. Reading segments is in
``segments.py``, offered here as well.

The rule that keeps aggregates right whatever runs at the same time: a transaction first locks the rows of all
segments that it touches, in id order, then changes estimates, then recomputes the aggregates of those
segments from everything that is stored. PostgreSQL's READ COMMITTED makes the recomputation see every
estimate that was committed before the lock was granted.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.store.plain import plain_json
from app.store.segments import (
    count_segments,
    drive_segment_rows,
    get_segment,
    segment_items,
    segment_observations,
)
from fusion.combine import combine
from fusion.types import Ints, SegmentSlope

__all__ = [
    "RunProvenance",
    "bump_data_version",
    "count_segments",
    "data_version",
    "drive_segment_rows",
    "estimated_segments",
    "get_segment",
    "lock_segments",
    "refresh_aggregates",
    "save_result",
    "segment_items",
    "segment_observations",
]


@dataclass(frozen=True)
class RunProvenance:
    """How the estimates of one run were made; ``options`` complete, defaults included."""

    method: str
    options: Mapping[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None


# --- estimates ----------------------------------------------------------------------------------------------

_ESTIMATED = text("SELECT segment_id FROM drive_segments WHERE drive_id = :drive_id")

# NO KEY UPDATE is enough: it excludes the other writers of estimates, who take it too, and lets the
# foreign-key checks of inserted estimates pass.
_LOCK_SEGMENTS = text(
    "SELECT id FROM segments WHERE id = ANY(CAST(:ids AS bigint[])) ORDER BY id FOR NO KEY UPDATE"
)

_DELETE_PROVENANCE = text("DELETE FROM provenances WHERE drive_id = :drive_id")
_DELETE_ESTIMATES = text("DELETE FROM drive_segments WHERE drive_id = :drive_id")

_INSERT_PROVENANCE = text(
    """
    INSERT INTO provenances (drive_id, method, options, code_version, road_version_id, dem_version_id)
    VALUES (:drive_id, :method, CAST(:options AS jsonb), :code_version, :road_version_id, :dem_version_id)
    RETURNING id
    """
)

_INSERT_ESTIMATES = text(
    """
    INSERT INTO drive_segments (drive_id, segment_id, slope_percent, slope_sigma_percent, observations,
                                passes, first_at, last_at, provenance_id)
    SELECT :drive_id, t.segment_id, t.slope, t.sigma, t.observations, t.passes, t.first_at, t.last_at,
           :provenance_id
    FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope AS float8[]), CAST(:sigma AS float8[]),
                CAST(:observations AS integer[]), CAST(:passes AS integer[]),
                CAST(:first_at AS timestamptz[]), CAST(:last_at AS timestamptz[]))
         AS t (segment_id, slope, sigma, observations, passes, first_at, last_at)
    """
)


def estimated_segments(session: Session, drive_id: uuid.UUID) -> list[int]:
    """Ids of the segments of which the drive has an estimate."""
    return list(session.execute(_ESTIMATED, {"drive_id": drive_id}).scalars())


def lock_segments(session: Session, segment_ids: Iterable[int]) -> list[int]:
    """Lock the rows of these segments until the transaction ends; the ids that exist, ascending."""
    ids = sorted({int(i) for i in segment_ids})
    return list(session.execute(_LOCK_SEGMENTS, {"ids": ids}).scalars()) if ids else []


def save_result(
    session: Session,
    drive_id: uuid.UUID,
    segment_ids: Ints,
    estimates: Sequence[SegmentSlope],
    provenance: RunProvenance,
) -> int:
    """Replace the drive's estimates and refresh every aggregate that they touch or touched.

    ``segment_ids`` maps an estimate's ``segment`` (index into the network of the run) to the database's id.
    An estimate whose slope or sigma is not finite says nothing and is left out. The caller holds the network
    lock and the drive's row. Returns the number of estimates stored.
    """
    known = [e for e in estimates if np.isfinite(e.slope_percent) and np.isfinite(e.slope_sigma_percent)]
    ids = [int(segment_ids[e.segment]) for e in known]
    touched = lock_segments(session, [*estimated_segments(session, drive_id), *ids])
    session.execute(_DELETE_ESTIMATES, {"drive_id": drive_id})
    session.execute(_DELETE_PROVENANCE, {"drive_id": drive_id})
    provenance_id = _insert_provenance(session, drive_id, provenance)
    if known:
        _insert_estimates(session, drive_id, provenance_id, ids, known)
    refresh_aggregates(session, touched)
    bump_data_version(session)
    return len(known)


def _insert_provenance(session: Session, drive_id: uuid.UUID, provenance: RunProvenance) -> int:
    values = {
        "drive_id": drive_id,
        "method": provenance.method,
        "options": json.dumps(plain_json(provenance.options)),
        "code_version": provenance.code_version,
        "road_version_id": provenance.road_version_id,
        "dem_version_id": provenance.dem_version_id,
    }
    return int(session.execute(_INSERT_PROVENANCE, values).scalar_one())


def _insert_estimates(
    session: Session, drive_id: uuid.UUID, provenance_id: int, ids: list[int], known: Sequence[SegmentSlope]
) -> None:
    session.execute(
        _INSERT_ESTIMATES,
        {
            "drive_id": drive_id,
            "provenance_id": provenance_id,
            "segment_id": ids,
            "slope": [float(e.slope_percent) for e in known],
            "sigma": [float(e.slope_sigma_percent) for e in known],
            "observations": [int(e.observations) for e in known],
            "passes": [int(e.passes) for e in known],
            "first_at": [datetime.fromtimestamp(e.first_time_s, UTC) for e in known],
            "last_at": [datetime.fromtimestamp(e.last_time_s, UTC) for e in known],
        },
    )


# --- aggregates ---------------------------------------------------------------------------------------------

# Ordered by drive as well, so that the same estimates always combine to the same bits.
_ESTIMATES_OF = text(
    """
    SELECT segment_id, slope_percent, slope_sigma_percent, observations
    FROM drive_segments WHERE segment_id = ANY(CAST(:ids AS bigint[]))
    ORDER BY segment_id, drive_id
    """
)

_CLEAR_AGGREGATES = text("DELETE FROM segment_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[]))")

_WRITE_AGGREGATES = text(
    """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations)
    SELECT * FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope AS float8[]), CAST(:sigma AS float8[]),
                         CAST(:drives AS integer[]), CAST(:observations AS integer[]))
    ON CONFLICT (segment_id) DO UPDATE SET
        slope_percent = excluded.slope_percent, slope_sigma_percent = excluded.slope_sigma_percent,
        drives = excluded.drives, observations = excluded.observations, updated_at = now()
    """
)


def refresh_aggregates(session: Session, segment_ids: Iterable[int]) -> None:
    """Recompute the combined slope of these segments from all stored estimates; none left: no row.

    The caller holds the rows of the segments (``lock_segments``) or the network alone.
    """
    ids = sorted({int(i) for i in segment_ids})
    if not ids:
        return
    columns: dict[str, list[Any]] = {
        "segment_id": [], "slope": [], "sigma": [], "drives": [], "observations": []
    }  # fmt: skip
    rows = session.execute(_ESTIMATES_OF, {"ids": ids})
    for segment_id, group in groupby(rows, key=lambda row: row.segment_id):
        slope, sigma, observations = zip(*((g[1], g[2], g[3]) for g in group), strict=True)
        whole = combine(np.array(slope), np.array(sigma), np.array(observations))
        columns["segment_id"].append(segment_id)
        columns["slope"].append(float(whole.slope_percent))
        columns["sigma"].append(float(whole.slope_sigma_percent))
        columns["drives"].append(int(whole.drives))
        columns["observations"].append(int(whole.observations))
    emptied = sorted(set(ids) - set(columns["segment_id"]))
    if emptied:
        session.execute(_CLEAR_AGGREGATES, {"ids": emptied})
    if columns["segment_id"]:
        session.execute(_WRITE_AGGREGATES, columns)


# --- the data's version -------------------------------------------------------------------------------------

_VERSION = text("SELECT version FROM data_version")
_BUMP = text("UPDATE data_version SET version = version + 1, updated_at = now() RETURNING version")


def data_version(session: Session) -> int:
    """The number of the published data; equal numbers mean equal tiles and items."""
    return int(session.execute(_VERSION).scalar_one())


def bump_data_version(session: Session) -> int:
    """Raise the number; last in every transaction that changes published data, as it orders the writers."""
    return int(session.execute(_BUMP).scalar_one())
