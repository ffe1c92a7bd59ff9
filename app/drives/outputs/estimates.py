"""What a drive says of each segment, as features and as a table. Knows no database and no route."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from app.core.text import SLOPE_DIGITS, rounded, utc_text
from app.drives.outputs.columns import csv_chunks
from app.map.store import DriveSegmentRow
from fusion.network.combine import NETWORK_ONLY

_WHOLE = (*NETWORK_ONLY, "drives")
"""Properties that say nothing of one drive."""


def estimate_feature(estimate: DriveSegmentRow) -> dict[str, Any]:
    """One drive's estimate of a segment, beside what all drives together say."""
    combined = estimate.segment
    own = replace(
        combined,
        slope_percent=estimate.slope_percent,
        slope_sigma_percent=estimate.slope_sigma_percent,
        drives=1,
        observations=estimate.observations,
    ).geojson()
    own["properties"] |= {
        **dict.fromkeys(NETWORK_ONLY),
        "passes": estimate.passes,
        "first_at": utc_text(estimate.first_at),
        "last_at": utc_text(estimate.last_at),
        "in_network": estimate.in_network,
        "accepted": estimate.accepted,
        "combined_slope_percent": rounded(combined.slope_percent, SLOPE_DIGITS),
        "combined_slope_sigma_percent": rounded(combined.slope_sigma_percent, SLOPE_DIGITS),
        "combined_drives": combined.drives,
    }
    return own


def estimates_csv(estimates: Sequence[DriveSegmentRow]) -> Iterator[str]:
    """A table of all estimates, an empty cell where something is unknown; the ends of each segment come last."""
    ends = ("from_lon_deg", "from_lat_deg", "to_lon_deg", "to_lat_deg")
    rows = []
    for estimate in estimates:
        feature = estimate_feature(estimate)
        properties = {"id": feature["id"]} | {
            name: value for name, value in feature["properties"].items() if name not in _WHOLE
        }
        (lon0, lat0), (lon1, lat1) = feature["geometry"]["coordinates"]
        rows.append(properties | dict(zip(ends, (lon0, lat0, lon1, lat1), strict=True)))
    names = list(rows[0]) if rows else ["id", *ends]
    return csv_chunks({name: [row[name] for row in rows] for name in names})
