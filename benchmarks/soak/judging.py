"""What is to be right once a disturbed service has come to rest, each as a figure that is to be 0."""

from __future__ import annotations

import gzip
import hashlib
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import httpx
import numpy as np
import psycopg

from app.core.blobs import BlobStore
from app.map.tiles.store import mvt
from fusion.formats.container import GZIP_MAGIC
from service.databases import sessions_of
from soak.acts import TILE_PATH, Ledger
from soak.disturbed import Disturbed
from soak.material import Material

REST_S = 300.0
"""After the last disturbance all is done in this time, or stuck."""
AT_ONCE_SIGMAS, AT_ONCE_SHARE, SETTLED_SIGMAS = 0.1, 0.99, 0.01
LACKING_SIGMAS = 1e6
"""Of a driven segment without a slope."""

# What is left to be done, by its name.
_LEFT = """
    SELECT 'drives ' || status || coalesce(', ' || stage, ''), count(*) FROM drives
    WHERE status NOT IN ('done', 'failed') GROUP BY status, stage
    UNION ALL SELECT 'marks', count(*) FROM network_marks HAVING count(*) > 0
    UNION ALL SELECT 'jobs ' || task_name || ' ' || status, count(*) FROM procrastinate_jobs
    WHERE status IN ('todo', 'doing') GROUP BY task_name, status
    UNION ALL SELECT 'drives whose roads changed', count(*) FROM touched_drives HAVING count(*) > 0
    UNION ALL SELECT 'batches', count(*) FROM batches WHERE state = 'enqueuing' HAVING count(*) > 0
"""
# Of drives that were computed on other roads than those that stay.
_STALE = """
    SELECT CAST(d.id AS text) FROM drives AS d JOIN provenances AS p ON p.drive_id = d.id
    WHERE d.status IN ('done', 'failed') AND (
        d.id IN (SELECT drive_id FROM touched_drives) OR EXISTS (
            SELECT FROM drive_segments AS e JOIN segments AS s ON s.id = e.segment_id JOIN cells AS c ON c.id = s.cell
            WHERE e.drive_id = d.id AND c.course_state > p.road_state))
"""
_DRIVES = "SELECT CAST(id AS text), status, blob_key, method, failure_reason FROM drives"
_SLOPES = """
    SELECT s.osm_way_id, s.from_node, s.to_node, a.slope_percent, a.slope_sigma_percent, a.drives
    FROM segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id
"""
# The sums that are kept, and what they are the sums of.
_MISCOUNTED = """
    SELECT count(*)
    FROM (SELECT status, sum(drives) AS n FROM drive_counts GROUP BY status HAVING sum(drives) <> 0) AS k
    FULL JOIN (SELECT status, count(*) AS n FROM drives GROUP BY status) AS d USING (status)
    WHERE k.n IS DISTINCT FROM d.n
"""


_FAILED_JOBS = "SELECT count(*) FROM procrastinate_jobs WHERE status = 'failed'"


class Slope(NamedTuple):
    """What is published of a segment."""

    percent: float
    sigma_percent: float
    drives: int


Slopes = Mapping[tuple[int, int, int], Slope]
"""By way and nodes."""


class Surviving(NamedTuple):
    """A drive that is there at the end."""

    log: int
    method: str


@dataclass(frozen=True)
class Far:
    """How far published slopes are from those of a computation from scratch."""

    segments: int
    at_once_sigmas: float
    """``AT_ONCE_SHARE`` of the driven segments are within it before settling."""
    at_once_all_sigmas: float
    """All of them are."""
    settled_sigmas: float
    """All, after settling."""
    other_segments: int
    """Published here or there alone, or of another number of drives."""


def left(service: Disturbed) -> dict[str, int]:
    """What is still to be done."""
    return {str(name): int(count) for name, count in service.ask(_LEFT)}


def await_rest(service: Disturbed) -> dict[str, int]:
    """Until nothing is left to be done; what is left after all."""
    ends, pending = time.monotonic() + REST_S, {"?": 1}
    while pending and time.monotonic() < ends:
        time.sleep(0.3)
        try:
            pending = left(service)
        except psycopg.Error:  # it is started again
            pending = {"no database": 1}
    return pending


def stale_drives(service: Disturbed) -> list[str]:
    """Drives that were computed on roads that have changed since."""
    return [row[0] for row in service.ask(_STALE)]


def slopes_of(url: str) -> Slopes:
    """What is published."""
    with psycopg.connect(url) as connection:
        rows = connection.execute(_SLOPES).fetchall()
    return {(way, begin, end): Slope(*values) for way, begin, end, *values in rows}


def drives_at_the_end(
    service: Disturbed, ledger: Ledger, material: Material
) -> tuple[dict[str, int], list[Surviving], list[str]]:
    """What is wrong with the drives, by name; those that there are; what is said of those that failed."""
    rows = service.ask(_DRIVES)
    blobs = BlobStore(service.settings.blob_store_url)
    contents = {row[0]: _content(blobs, row[2]) for row in rows}
    contents_of = {drive: material.log_of.get(content) for drive, content in contents.items() if content}
    promised = set(ledger.drives())
    failed = [f"{drive}: {reason}" for drive, status, _, _, reason in rows if status == "failed"]
    lost = {
        "lost drives": len(promised - {row[0] for row in rows}),
        "lost logs": len(rows) - len(contents_of),
        "other logs": sum(
            log is None or ledger.promised.get(drive, log) != log for drive, log in contents_of.items()
        ),
        "doubled": sum(n - 1 for n in Counter(contents_of.values()).values()),
        "not removed": len(ledger.going & {row[0] for row in rows}),
        "failed drives": len(failed),
        "failed jobs": int(service.ask(_FAILED_JOBS)[0][0]),
        "miscounted": int(service.ask(_MISCOUNTED)[0][0]),
    }
    methods = {row[0]: row[3] for row in rows}
    there = [Surviving(log, methods[drive]) for drive, log in contents_of.items() if log is not None]
    return lost, there, failed


def other_tiles(service: Disturbed, material: Material) -> int:
    """Tiles that an API shows otherwise than the database has them, or with another ETag than another API."""
    wrong = 0
    with (
        sessions_of(service.url) as sessions,
        sessions() as session,
        httpx.Client(timeout=REST_S, trust_env=False) as client,
    ):
        for at in material.tiles:
            answers = [client.get(one + TILE_PATH.format(at)) for one in service.parts.addresses]
            wrong += sum(one.content != mvt(session, *at) for one in answers)
            wrong += len({one.headers.get("etag") for one in answers}) - 1
    return wrong


def _content(blobs: BlobStore, key: str) -> str | None:
    """SHA-256 of what a blob unpacks to; None: it is not there."""
    if not blobs.exists(key):
        return None
    with blobs.open(key) as file:
        data = file.read()
    return hashlib.sha256(gzip.decompress(data) if data.startswith(GZIP_MAGIC) else data).hexdigest()


def far(at_once: Slopes, settled: Slopes, scratch: Slopes) -> Far:
    """Compare what was published before and after settling with what is settled from scratch."""
    driven = [key for key, slope in scratch.items() if slope.drives]
    off = [_sigmas(at_once[key], scratch[key]) if key in at_once else LACKING_SIGMAS for key in driven] or [
        0.0
    ]
    both = settled.keys() & scratch.keys()
    return Far(
        segments=len(scratch),
        at_once_sigmas=float(np.quantile(off, AT_ONCE_SHARE)),
        at_once_all_sigmas=max(off),
        settled_sigmas=max((_sigmas(settled[key], scratch[key]) for key in both), default=0.0),
        other_segments=len(settled.keys() ^ scratch.keys())
        + sum(settled[key].drives != scratch[key].drives for key in both),
    )


def _sigmas(one: Slope, other: Slope) -> float:
    return abs(one.percent - other.percent) / other.sigma_percent


def orphans(service: Disturbed) -> int:
    """Logs that no drive refers to: of uploads that were cut off; they are swept some day."""
    keys = {row[2] for row in service.ask(_DRIVES)}
    return len(set(BlobStore(service.settings.blob_store_url).keys()) - keys)
