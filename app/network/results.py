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
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_json
from app.network.passes import Hearing, hearing, replace_passes
from app.network.publish import refresh_aggregates
from app.network.solve import refresh_network
from app.network.twins import choose_witnesses, drives_that_name
from app.network.versions import bump_data_version
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


# The published slopes of these segments may rest on the drive: on its own estimates or, until it is computed again, on
# what it said in a former model. What it says to the network is heard by its passes.
_DELETE_ESTIMATES = text("DELETE FROM drive_segments WHERE drive_id = :drive_id RETURNING segment_id")
_DELETE_PROVENANCE = text("DELETE FROM provenances WHERE drive_id = :drive_id")
_IS_HEARD = text("SELECT same_as IS NULL FROM drives WHERE id = :drive_id")

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
    epoch_s: Floats = _NO_EPOCHS,
) -> Hearing:
    """Replace what the drive says and renew all that is published on account of it.

    ``segment_ids`` maps the segments of estimates and factors (indices into the network of the run) to the
    database's ids. ``epoch_s`` are the times of the log's positions (e,): without them two logs of one drive are
    told by their entries into segments alone. An estimate whose slope or sigma is not finite says nothing and is left
    out. The caller owns the network and holds the drive's row. Returns how far the other drives agree.
    """
    known = [e for e in estimates if np.isfinite(e.slope_percent) and np.isfinite(e.slope_sigma_percent)]
    ids = [int(segment_ids[e.segment]) for e in known]
    former = _forget_estimates(session, drive_id)
    provenance_id = _insert_provenance(session, drive_id, provenance)
    if known:
        _insert_estimates(session, drive_id, provenance_id, ids, known, bool(factors))
    heard = _exchange(session, drive_id, in_database(factors, segment_ids), epoch_s)
    refresh_aggregates(session, [*former, *(() if factors else ids)])
    bump_data_version(session)
    return heard


def remove_result(session: Session, drive_id: uuid.UUID) -> None:
    """Take back all that the drive says; the caller owns the network and holds the drive's row."""
    former = _forget_estimates(session, drive_id)
    _exchange(session, drive_id, [], _NO_EPOCHS)
    refresh_aggregates(session, former)
    if former:
        bump_data_version(session)


def in_database(factors: Sequence[PassFactor], segment_ids: Ints) -> list[PassFactor]:
    """Factors of a run with the database's ids of their segments."""
    return [factor.over(int(segment_ids[factor.segment])) for factor in factors]


def _exchange(
    session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor], epoch_s: Floats
) -> Hearing:
    """Exchange the drive's passes and solve anew, with those that were the same drive as it until now."""
    was_heard = session.execute(_IS_HEARD, {"drive_id": drive_id}).scalar_one()
    changed = replace_passes(session, drive_id, factors, epoch_s)
    others = choose_witnesses(session, {drive_id, *drives_that_name(session, drive_id)})
    is_heard = session.execute(_IS_HEARD, {"drive_id": drive_id}).scalar_one()
    refresh_network(session, {*(changed if was_heard or is_heard else ()), *others})
    return hearing(session, drive_id) if is_heard else Hearing(len({f.segment for f in factors}), 0)


def _forget_estimates(session: Session, drive_id: uuid.UUID) -> list[int]:
    """Delete the drive's estimates; their segments."""
    former = list(session.execute(_DELETE_ESTIMATES, {"drive_id": drive_id}).scalars())
    session.execute(_DELETE_PROVENANCE, {"drive_id": drive_id})
    return former


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
