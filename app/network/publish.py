"""What is published of a segment: the network's slope and the estimates of slope-only drives, made into one.

``network_slopes`` and ``drive_segments`` -> ``segment_slopes``, the one table of slopes that the map is read from. How
the parts are put together is the library's business.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from fusion.network.combine import SlopePart, published_slope

# The network's own slope first, then each drive in order, so that the same parts always combine to the same
# bits. The drives of the network are in its slope already.
_PARTS = text(
    """
    SELECT segment_id, slope_percent, slope_sigma_percent, drives, observations, drive_id IS NULL AS network
    FROM (
        SELECT segment_id, slope_percent, slope_sigma_percent, drives, observations, NULL AS drive_id
        FROM network_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[]))
        UNION ALL
        SELECT segment_id, slope_percent, slope_sigma_percent, 1, observations, drive_id
        FROM drive_segments WHERE segment_id = ANY(CAST(:ids AS bigint[])) AND NOT in_network
    ) AS part
    ORDER BY segment_id, drive_id NULLS FIRST
    """
)

_CLEAR_AGGREGATES = text("DELETE FROM segment_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[]))")

# Only rows that differ are written.
_WRITE_AGGREGATES = text(
    """
    INSERT INTO segment_slopes AS a (segment_id, slope_percent, slope_sigma_percent, drives, observations)
    SELECT * FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope AS float8[]), CAST(:sigma AS float8[]),
                         CAST(:drives AS integer[]), CAST(:observations AS integer[]))
    ON CONFLICT (segment_id) DO UPDATE SET
        slope_percent = excluded.slope_percent, slope_sigma_percent = excluded.slope_sigma_percent,
        drives = excluded.drives, observations = excluded.observations, updated_at = now()
    WHERE (a.slope_percent, a.slope_sigma_percent, a.drives, a.observations) IS DISTINCT FROM
        (excluded.slope_percent, excluded.slope_sigma_percent, excluded.drives, excluded.observations)
    """
)


def refresh_aggregates(session: Session, segment_ids: Iterable[int]) -> None:
    """Recompute what is published of these segments from all that is stored; nothing known: no row.

    The caller owns the network (``app.network.versions``).
    """
    ids = sorted({int(i) for i in segment_ids})
    if not ids:
        return
    columns: dict[str, list[Any]] = {
        "segment_id": [], "slope": [], "sigma": [], "drives": [], "observations": []
    }  # fmt: skip
    for segment_id, group in groupby(session.execute(_PARTS, {"ids": ids}), key=lambda row: row.segment_id):
        whole = published_slope([SlopePart(*row[1:]) for row in group])
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
