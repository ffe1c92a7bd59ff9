"""The passes that drives contribute, and the evidence of each segment that is condensed from them.

Passes are the truth; evidence is a cache of their sum, so that a further drive need not read what a thousand
drives said before. A pass that comes is added to it. When a pass leaves, evidence is built anew from those that
stay: nothing of it is left, not even in rounding. Callers own the network (``app.network.versions``).
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from fusion.network.evidence import SegmentEvidence
from fusion.network.pass_factor import PassFactor

Keyed = tuple[int, PassFactor]
"""A pass with its row's id."""
Encoded = tuple[int, tuple[int, ...], bytes]
"""A pass as it is stored: its row's id, its segments, its factor."""
Added = Mapping[int, Sequence[Keyed]]
"""New passes by their own segment."""
Evidence = dict[int, SegmentEvidence | None]
"""By segment; None where no pass is left."""

_SEGMENTS_PER_READ = 50  # a thousand passes each are some 20 MB

# Statements with %(name)s are executed by psycopg itself, which takes and gives bytes as they are (``app.core.db``).

_OWN_SEGMENTS = text("SELECT DISTINCT segment_id FROM drive_passes WHERE drive_id = :drive_id")
_DELETE_PASSES = text("DELETE FROM drive_passes WHERE drive_id = :drive_id")

# Ids before rows: the verdict over a pass, which depends on its id's place among the others, is in its row.
_NEW_KEYS = text(
    "SELECT nextval(pg_get_serial_sequence('drive_passes', 'id')) FROM generate_series(1, :count)"
)

_INSERT_PASSES = """
    INSERT INTO drive_passes (id, drive_id, segment_id, segments, factor, slope_percent, slope_sigma_percent,
                              accepted)
    SELECT t.id, %(drive_id)s, t.segment_id, t.segments::bigint[], t.factor, t.slope, t.sigma, t.accepted
    FROM unnest(%(id)s::bigint[], %(segment_id)s::bigint[], %(segments)s::text[], %(factor)b::bytea[],
                %(slope)s::float8[], %(sigma)s::float8[], %(accepted)s::boolean[])
         AS t (id, segment_id, segments, factor, slope, sigma, accepted)
"""

# Read by segment to build its evidence, or by id where only some factors are wanted.
_PASSES_OVER = """
    SELECT segment_id, id, segments, factor, accepted FROM drive_passes
    WHERE segment_id = ANY(%(ids)s::bigint[])
"""
_PASSES = "SELECT id, segments, factor FROM drive_passes WHERE id = ANY(%(ids)s::bigint[])"

# A pass that comes can turn the verdict over those of other drives.
_SET_VERDICTS = text(
    """
    UPDATE drive_passes AS p SET accepted = t.accepted
    FROM unnest(CAST(:ids AS bigint[]), CAST(:accepted AS boolean[])) AS t (id, accepted) WHERE p.id = t.id
    """
)

_EVIDENCE = """
    SELECT segment_id, evidence FROM segment_evidence WHERE segment_id = ANY(%(ids)s::bigint[])
"""
_WRITE_EVIDENCE = """
    INSERT INTO segment_evidence (segment_id, evidence)
    SELECT * FROM unnest(%(ids)s::bigint[], %(evidence)b::bytea[])
    ON CONFLICT (segment_id) DO UPDATE SET evidence = excluded.evidence
"""
_CLEAR_EVIDENCE = text("DELETE FROM segment_evidence WHERE segment_id = ANY(CAST(:ids AS bigint[]))")

# A segment is heard where any of the drive's passes over it is.
_HEARD = text(
    """
    SELECT count(*) AS segments, count(*) FILTER (WHERE NOT heard) AS rejected
    FROM (SELECT bool_or(accepted) AS heard FROM drive_passes WHERE drive_id = :drive_id
          GROUP BY segment_id) AS one
    """
)

# Answered from the index alone; a drive that passes twice counts once.
_COUNT_DRIVES = text(
    """
    SELECT segment_id, count(DISTINCT drive_id) FROM drive_passes
    WHERE accepted AND segment_id = ANY(CAST(:ids AS bigint[])) GROUP BY segment_id
    """
)


class Hearing(NamedTuple):
    """On how many segments a drive has passes, and on how many of them none is heard."""

    segments: int
    rejected: int


def replace_passes(session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor]) -> Evidence:
    """Exchange the drive's passes for ``factors``, whose segments are database ids.

    Returns the evidence of every segment that lost or gained a pass.
    """
    left = list(session.execute(_OWN_SEGMENTS, {"drive_id": drive_id}).scalars())
    session.execute(_DELETE_PASSES, {"drive_id": drive_id})
    added = _keyed(session, factors)
    cached = read_evidence(session, added.keys() - set(left))
    evidence = rebuild_evidence(session, [*left, *(added.keys() - cached.keys() - set(left))], added)
    evidence |= _extend_evidence(session, cached, added)
    _insert(session, drive_id, added, evidence)
    return evidence


def rebuild_evidence(session: Session, segment_ids: Sequence[int], added: Added | None = None) -> Evidence:
    """Condense the stored passes over these segments anew, together with ``added`` ones not stored yet."""
    evidence: Evidence = {}
    verdicts: dict[int, bool] = {}
    for start in range(0, len(segment_ids), _SEGMENTS_PER_READ):
        part = segment_ids[start : start + _SEGMENTS_PER_READ]
        passes: dict[int, list[Encoded]] = {
            s: [(key, f.segments, f.encode()) for key, f in (added or {}).get(s, ())] for s in part
        }
        stored: dict[int, bool] = {}
        for segment_id, key, segments, factor, accepted in fetch_binary(session, _PASSES_OVER, {"ids": part}):
            passes[segment_id].append((key, tuple(segments), factor))
            stored[key] = accepted
        for segment_id, keyed in passes.items():
            built = SegmentEvidence.build_encoded(keyed) if keyed else None
            evidence[segment_id] = built
            verdicts |= _flipped(built, stored)
    _set_verdicts(session, verdicts)
    _write_evidence(session, evidence)
    return evidence


def read_evidence(session: Session, segment_ids: Iterable[int]) -> dict[int, SegmentEvidence]:
    """The evidence of those of the segments that have any."""
    rows = fetch_binary(session, _EVIDENCE, {"ids": list(segment_ids)})
    return {segment_id: SegmentEvidence.decode(data) for segment_id, data in rows}


def hearing(session: Session, drive_id: uuid.UUID) -> Hearing:
    """How far the drive agrees with the others over the same segments."""
    return Hearing(*session.execute(_HEARD, {"drive_id": drive_id}).one())


def count_drives(session: Session, segment_ids: Iterable[int]) -> dict[int, int]:
    """How many drives are heard on each of the segments; those without any are missing."""
    return {row[0]: row[1] for row in session.execute(_COUNT_DRIVES, {"ids": list(segment_ids)})}


def _keyed(session: Session, factors: Sequence[PassFactor]) -> dict[int, list[Keyed]]:
    """The factors with their new keys, by own segment."""
    keys = sorted(session.execute(_NEW_KEYS, {"count": len(factors)}).scalars()) if factors else []
    added: dict[int, list[Keyed]] = {}
    for key, factor in zip(keys, factors, strict=True):
        added.setdefault(factor.segments[-1], []).append((key, factor))
    return added


def _extend_evidence(session: Session, cached: Mapping[int, SegmentEvidence], added: Added) -> Evidence:
    """Add passes to the evidence of segments that lose none."""
    evidence: Evidence = {}
    turned: dict[int, list[int]] = {}
    for segment_id, known in cached.items():
        try:
            evidence[segment_id] = known.with_passes(added[segment_id])
        except KeyError:  # the verdict over passes of other drives turns: their factors are wanted, too
            turned[segment_id] = known.missing_for(added[segment_id])
    factors = _read_passes(session, [key for keys in turned.values() for key in keys])
    verdicts: dict[int, bool] = {}
    for segment_id, keys in turned.items():
        extended = cached[segment_id].with_passes(added[segment_id], factors)
        evidence[segment_id] = extended
        verdicts |= dict(zip(keys, _heard(extended, keys), strict=True))
    _set_verdicts(session, verdicts)
    _write_evidence(session, evidence)
    return evidence


def _read_passes(session: Session, keys: Sequence[int]) -> dict[int, PassFactor]:
    rows = fetch_binary(session, _PASSES, {"ids": list(keys)}) if keys else []
    return {key: PassFactor.decode(factor, tuple(segments)) for key, segments, factor in rows}


def _insert(session: Session, drive_id: uuid.UUID, added: Added, evidence: Evidence) -> None:
    if not added:
        return
    columns: dict[str, list[Any]] = {
        name: [] for name in ("id", "segment_id", "segments", "factor", "slope", "sigma", "accepted")
    }
    for segment_id, passes in added.items():
        known = evidence[segment_id]
        assert known is not None  # noqa: S101 - it holds at least these passes
        columns["accepted"] += _heard(known, [key for key, _ in passes])
        for key, factor in passes:
            columns["id"].append(key)
            columns["segment_id"].append(segment_id)
            columns["segments"].append("{" + ",".join(map(str, factor.segments)) + "}")
            columns["factor"].append(factor.encode())
            columns["slope"].append(float(factor.slope_percent))
            columns["sigma"].append(float(factor.slope_sigma_percent))
    send_binary(session, _INSERT_PASSES, {"drive_id": drive_id, **columns})


def _heard(evidence: SegmentEvidence, keys: Sequence[int]) -> list[bool]:
    """Whether each of the passes, which the evidence holds, is heard."""
    return [bool(heard) for heard in evidence.accepted[np.searchsorted(evidence.keys, keys)]]


def _flipped(evidence: SegmentEvidence | None, stored: Mapping[int, bool]) -> dict[int, bool]:
    """The verdicts that differ from those in the passes' rows."""
    if evidence is None:
        return {}
    verdicts = zip(evidence.keys.tolist(), evidence.accepted.tolist(), strict=True)
    return {key: heard for key, heard in verdicts if stored.get(key, heard) != heard}


def _set_verdicts(session: Session, verdicts: Mapping[int, bool]) -> None:
    if verdicts:
        session.execute(_SET_VERDICTS, {"ids": list(verdicts), "accepted": list(verdicts.values())})


def _write_evidence(session: Session, evidence: Evidence) -> None:
    known = {s: one.encode() for s, one in evidence.items() if one is not None}
    emptied = [s for s, one in evidence.items() if one is None]
    if emptied:
        session.execute(_CLEAR_EVIDENCE, {"ids": emptied})
    if known:
        send_binary(session, _WRITE_EVIDENCE, {"ids": list(known), "evidence": list(known.values())})
