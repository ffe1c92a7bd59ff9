"""What one drive says of the segments: stored, replaced, taken back, with all that follows from it.

How a drive comes to say so is not known here, nor what is shown of a segment (``app.map.store``).

The rule that keeps aggregates right whatever runs at the same time: whoever changes what drives say owns the
network (``app.network.versions``), and recomputes from everything that is stored. PostgreSQL's READ COMMITTED makes
the recomputation see all that was committed before the lock was granted.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_json
from app.network.passes import Hearing, hearing, replace_passes
from app.network.publish import refresh_aggregates
from app.network.solve import refresh_network
from app.network.versions import bump_data_version
from fusion.network.pass_factor import PassFactor
from fusion.types import Ints, SegmentSlope


@dataclass(frozen=True)
class RunProvenance:
    """How the estimates of one run were made; ``options`` complete, defaults included."""

    method: str
    options: Mapping[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None


# The segments whose published slope holds the drive's own estimate; what a drive of the network says is heard by
# its passes.
_SLOPE_ONLY = text("SELECT segment_id FROM drive_segments WHERE drive_id = :drive_id AND NOT in_network")

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
                                passes, first_at, last_at, provenance_id, in_network)
    SELECT :drive_id, t.segment_id, t.slope, t.sigma, t.observations, t.passes, t.first_at, t.last_at,
           :provenance_id, :in_network
    FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope AS float8[]), CAST(:sigma AS float8[]),
                CAST(:observations AS integer[]), CAST(:passes AS integer[]),
                CAST(:first_at AS timestamptz[]), CAST(:last_at AS timestamptz[]))
         AS t (segment_id, slope, sigma, observations, passes, first_at, last_at)
    """
)


def save_result(
    session: Session,
    drive_id: uuid.UUID,
    segment_ids: Ints,
    estimates: Sequence[SegmentSlope],
    provenance: RunProvenance,
    factors: Sequence[PassFactor] = (),
) -> Hearing:
    """Replace what the drive says and renew all that is published on account of it.

    ``segment_ids`` maps the segments of estimates and factors (indices into the network of the run) to the
    database's ids. An estimate whose slope or sigma is not finite says nothing and is left out. The caller owns
    the network and holds the drive's row. Returns how far the other drives agree.
    """
    known = [e for e in estimates if np.isfinite(e.slope_percent) and np.isfinite(e.slope_sigma_percent)]
    ids = [int(segment_ids[e.segment]) for e in known]
    former = _forget_estimates(session, drive_id)
    provenance_id = _insert_provenance(session, drive_id, provenance)
    if known:
        _insert_estimates(session, drive_id, provenance_id, ids, known, bool(factors))
    evidence = replace_passes(session, drive_id, [_stored(factor, segment_ids) for factor in factors])
    refresh_network(session, evidence.keys(), evidence)
    refresh_aggregates(session, [*former, *(() if factors else ids)])
    bump_data_version(session)
    return hearing(session, drive_id)


def remove_result(session: Session, drive_id: uuid.UUID) -> None:
    """Take back all that the drive says; the caller owns the network and holds the drive's row."""
    former = _forget_estimates(session, drive_id)
    evidence = replace_passes(session, drive_id, [])
    refresh_network(session, evidence.keys(), evidence)
    refresh_aggregates(session, former)
    if former or evidence:
        bump_data_version(session)


def _forget_estimates(session: Session, drive_id: uuid.UUID) -> list[int]:
    """Delete the drive's estimates; the segments whose aggregates they were part of."""
    former = list(session.execute(_SLOPE_ONLY, {"drive_id": drive_id}).scalars())
    session.execute(_DELETE_ESTIMATES, {"drive_id": drive_id})
    session.execute(_DELETE_PROVENANCE, {"drive_id": drive_id})
    return former


def _stored(factor: PassFactor, segment_ids: Ints) -> PassFactor:
    """The factor with the database's ids."""
    return replace(factor, segments=tuple(int(segment_ids[s]) for s in factor.segments))


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
    session: Session,
    drive_id: uuid.UUID,
    provenance_id: int,
    ids: list[int],
    known: Sequence[SegmentSlope],
    in_network: bool,
) -> None:
    session.execute(
        _INSERT_ESTIMATES,
        {
            "drive_id": drive_id,
            "provenance_id": provenance_id,
            "in_network": in_network,
            "segment_id": ids,
            "slope": [float(e.slope_percent) for e in known],
            "sigma": [float(e.slope_sigma_percent) for e in known],
            "observations": [int(e.observations) for e in known],
            "passes": [int(e.passes) for e in known],
            "first_at": [datetime.fromtimestamp(e.first_time_s, UTC) for e in known],
            "last_at": [datetime.fromtimestamp(e.last_time_s, UTC) for e in known],
        },
    )
