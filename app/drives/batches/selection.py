"""Which drives a batch means, as conditions on their rows; part of the statements in ``app.drives.batches.store``."""

from __future__ import annotations

import json
from typing import Any

from app.core.db import plain_json
from app.core.version import code_version
from app.drives.batches.documents import HOPELESS, Selection, Which
from fusion.registry import METHOD_NAMES

# In the cells of the roads that it measured, roads have come, gone or moved since its run (p) took them.
_OTHER_ROADS = """
    EXISTS (
        SELECT FROM drive_segments AS e JOIN segments AS s ON s.id = e.segment_id JOIN cells AS c ON c.id = s.cell
        WHERE e.drive_id = d.id AND c.course_state > coalesce(p.road_state, (p.road_version_id + 1) << 20))
"""

# Rasters that came, went, or have another priority since. One elsewhere changes nothing of a drive; one whose bounds
# are not known may be anywhere.
_OTHER_ELEVATION = """
            p.dem_version_id IS DISTINCT FROM (SELECT id FROM dem_versions WHERE active) AND EXISTS (
                SELECT FROM (SELECT s FROM dem_versions AS v, jsonb_array_elements(v.sources) AS s
                             WHERE v.id = p.dem_version_id) AS former (s)
                FULL JOIN (SELECT s FROM dem_versions AS v, jsonb_array_elements(v.sources) AS s
                           WHERE v.active) AS present (s)
                ON former.s ->> 'uri' = present.s ->> 'uri'
                    AND coalesce(former.s ->> 'priority', '0') = coalesce(present.s ->> 'priority', '0'),
                LATERAL (SELECT coalesce(present.s, former.s) -> 'bounds_deg' AS corner) AS raster
                WHERE (former.s IS NULL OR present.s IS NULL) AND (
                    d.bounds IS NULL OR coalesce(jsonb_typeof(corner), 'null') = 'null'
                    OR d.bounds && ST_MakeEnvelope(
                        CAST(corner ->> 0 AS float8), CAST(corner ->> 1 AS float8), CAST(corner ->> 2 AS float8),
                        CAST(corner ->> 3 AS float8), 4326)))
"""

# Options that the drive names itself are its own affair: however they were written, they are the same now.
_STALE = f"""
    EXISTS (
        SELECT FROM provenances AS p, CAST(:defaults AS jsonb) AS now_default,
            LATERAL (SELECT ARRAY(SELECT jsonb_object_keys(d.options))) AS own (names)
        WHERE p.drive_id = d.id AND (
            p.code_version <> :present_version
            OR p.options - own.names IS DISTINCT FROM (now_default -> d.method) - own.names
            OR {_OTHER_ROADS}
            OR {_OTHER_ELEVATION}))
"""  # noqa: S608 - constants

# What failed by code that did not note its version is tried once more.
_HOPELESS = """
    d.status = 'failed' AND d.failure_kind = ANY(:hopeless) AND d.failure_version IS NOT DISTINCT FROM :present_version
"""

_WHICH = {
    Which.OTHER: "d.method <> :method",
    Which.STALE: _STALE,
    Which.FAILED: "d.status = 'failed'",
    Which.ALL: "true",
}

# Drives that measured roads of the region, and failed ones that were there.
_REGION = """
    EXISTS (
        SELECT FROM regions AS r JOIN segments AS s ON r.id = ANY(s.regions) JOIN drive_segments AS e
            ON e.segment_id = s.id
        WHERE r.name = :region AND e.drive_id = d.id)
    OR d.status = 'failed' AND EXISTS (
        SELECT FROM regions AS r JOIN segments AS s ON r.id = ANY(s.regions)
        WHERE r.name = :region AND s.geom && d.bounds)
"""

# Each for what is asked; what is not asked for is left out.
_FILTERS = {
    "from_method": "d.method = :from_method",
    "code_version": "EXISTS (SELECT FROM provenances AS p WHERE p.drive_id = d.id AND p.code_version = :code_version)",
    "failure": "d.status = 'failed' AND d.failure_kind = :failure",
    "created_after": "d.created_at >= :created_after",
    "created_before": "d.created_at < :created_before",
    "driven_after": "d.drive_time >= :driven_after",
    "driven_before": "d.drive_time < :driven_before",
    "region": _REGION,
    "imported": "d.import_id = :imported",
}
_BOX = "d.bounds && ST_MakeEnvelope({west}, :south, {east}, :north, 4326)"


def conditions(
    selection: Selection, method: str | None, *, skipped: bool = False
) -> tuple[str, dict[str, Any]]:
    """What follows ``WHERE ...`` of the drives ``d``, each part with its AND, and the values in it.

    ``method`` is the one that they are to be processed by; only drives ``other`` than of it need one. ``skipped``: of
    those that are left out although they fit, since their logs cannot be used.
    """
    filters = {name: value for name in _FILTERS if (value := getattr(selection, name)) is not None}
    parts = [_WHICH[selection.which], *(_FILTERS[name] for name in filters)]
    values: dict[str, Any] = {**filters, "method": method}
    if selection.which is Which.STALE:
        values |= {"present_version": code_version(), "defaults": json.dumps(_defaults())}
    if skipped or not includes_hopeless(selection):
        parts.append(_HOPELESS if skipped else f"NOT ({_HOPELESS})")
        values |= {"present_version": code_version(), "hopeless": list(HOPELESS)}
    if selection.bbox is not None:
        west, south, east, north = selection.bbox
        parts.append(_boxes(west, east))
        values |= {"west": west, "south": south, "east": east, "north": north}
    return "".join(f" AND ({part})" for part in parts), values


def includes_hopeless(selection: Selection) -> bool:
    """Whether no drive is left out for its log's sake: that was asked for, or a kind of failure was named."""
    return bool(selection.force) or selection.failure is not None


def _boxes(west: float, east: float) -> str:
    """A box whose west is east of its east crosses the antimeridian."""
    if west <= east:
        return _BOX.format(west=":west", east=":east")
    return f"{_BOX.format(west=':west', east='180')} OR {_BOX.format(west='-180', east=':east')}"


def _defaults() -> dict[str, Any]:
    """The options of every method as they are when none is given, as runs note them."""
    from fusion.pipeline import parse_options  # noqa: PLC0415 - see app.drives.method_choice

    return {name: plain_json(parse_options(name, {}).model_dump(mode="json")) for name in METHOD_NAMES}
