"""Drives that contribute factors, made up from what they are to say, and what the network makes of them."""

from __future__ import annotations

import hashlib
import uuid
import zlib
from collections.abc import Mapping, Sequence

import numpy as np
from sqlalchemy import text

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.drives import claims
from app.drives import store as drives
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.network.rejections import Rejections, rejections_of
from app.network.swap import solve_all_marked
from app.roads import store as roads
from dense_adjustment import slope_row
from fusion.network.curve import knot_length
from fusion.network.pass_factor import NUISANCES, PassFactor
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints, SegmentSlope
from processing_support import remove_drive

T0_S = 1_700_000_000.0
HEIGHT_SIGMA_M = 1000.0
"""Of what a made pass knows of its height: next to nothing, so that it contradicts no height that is measured."""
Said = Mapping[int, tuple[float, float]]
"""Slope and sigma by row of the table, percent."""
Made = tuple[PassFactor, SegmentSlope]
"""A pass, and what the drive shows as its own estimate of the segment."""
Rows = dict[int, tuple[float, float, int, int]]
"""Slope, sigma, drives, observations by segment."""


def pass_over(
    table: RoadTable,
    row: int,
    slope_percent: float,
    sigma_percent: float,
    *,
    begin_s: float = T0_S,
    sequence: int = 0,
    rows: int = 5,
    roughness: float = 3e-5,
) -> Made:
    """A pass that knows the slope of its segment, its height very roughly, and nothing of the drive's own errors."""
    length = float(knot_length(table.length_m[row]))
    slope = np.concatenate([slope_row(0.0, length, length), np.zeros(NUISANCES)])
    height = np.zeros(len(slope))
    height[0] = 1.0
    weight, value = (sigma_percent / 100) ** -2, slope_percent / 100
    first = begin_s + 10.0 * sequence
    factor = PassFactor(
        segment=row,
        sequence=sequence,
        mount=0,
        information=weight * np.outer(slope, slope) + HEIGHT_SIGMA_M**-2 * np.outer(height, height),
        vector=weight * value * slope,
        square=weight * value**2,
        rows=rows,
        walk_m2_per_s=(0.1, 0.001),
        start_m=0.0,
        end_m=length,
        roughness=roughness,
        observations=5,
        first_time_s=first,
        last_time_s=first + 5.0,
    )
    return factor, SegmentSlope(row, slope_percent, sigma_percent, 5, 1, first, first + 5.0)


def passes_of(table: RoadTable, said: Said, begin_s: float | None = None, **more: float) -> list[Made]:
    """One pass over each row. What is said decides when it was, unless ``begin_s`` does: no two drives are alike."""
    if begin_s is None:
        begin_s = T0_S + 10_000.0 * (zlib.crc32(repr(sorted(said.items())).encode()) % 10_000)
    return [
        pass_over(table, row, *values, begin_s=begin_s, sequence=k, **more)  # type: ignore[arg-type]
        for k, (row, values) in enumerate(said.items())
    ]


def new_drive(sessions: Sessions, name: str | None = None, method: str = "profile") -> uuid.UUID:
    """A drive that a worker has begun."""
    content = name or uuid.uuid4().hex
    with sessions.begin() as session:
        drive, _ = drives.create_drive(
            session,
            sha256=hashlib.sha256(content.encode()).hexdigest(),
            filename=f"{content}.csv",
            size_bytes=10,
            blob_key=f"drives/{content}",
            method=method,
            options={},
        )
        claims.mark_running(session, drive.id, drive.generation)
    return drive.id


def append(
    sessions: Sessions, drive: uuid.UUID, ids: Ints, made: Sequence[Made], epoch_s: Sequence[float] = ()
) -> None:
    """Store what the drive says, as the worker does; segments are rows of the table behind ``ids``."""
    factors = [factor for factor, _ in made]
    with sessions.begin() as session:
        slopes.begin_change(session, drive, slopes.in_database(factors, ids))
        version = roads.current_road_version(session)
        assert version is not None
        provenance = slopes.RunProvenance("profile", {}, "1.0", version.id, None)
        own = list({estimate.segment: estimate for _, estimate in made}.values())
        epochs = np.array(epoch_s, float)
        slopes.append_result(session, MarkedBy(drive, 1), ids, own, provenance, factors, epochs)


def publish(
    sessions: Sessions, drive: uuid.UUID, ids: Ints, made: Sequence[Made], epoch_s: Sequence[float] = ()
) -> Rejections:
    """``append`` and solve."""
    append(sessions, drive, ids, made, epoch_s)
    solve_all_marked(sessions)
    segments = len({factor.segment for factor, _ in made})
    with sessions() as session:
        found = rejections_of(session, [drive]).get(drive, Rejections(segments, 0))
    assert found.segments == segments
    return found


def drive_over(
    sessions: Sessions, table: RoadTable, ids: Ints, said: Said, begin_s: float | None = None, **more: float
) -> uuid.UUID:
    """A drive that passes once over each of these rows."""
    drive = new_drive(sessions)
    publish(sessions, drive, ids, passes_of(table, said, begin_s, **more))
    return drive


def rows_of(sessions: Sessions, relation: str = "segment_slopes") -> Rows:
    """What ``segment_slopes`` or ``network_slopes`` holds."""
    query = f"SELECT segment_id, slope_percent, slope_sigma_percent, drives, observations FROM {relation}"
    with sessions() as session:
        return {row[0]: (row[1], row[2], row[3], row[4]) for row in session.execute(text(query))}


def verdicts_of(sessions: Sessions) -> dict[tuple[uuid.UUID, int], bool]:
    """Whether each pass is heard, by drive and segment (of drives that pass once)."""
    with sessions() as session:
        rows = session.execute(
            text(
                """
            SELECT p.drive_id, p.segment_id, d.duplicate_of IS NULL AND r.pass_id IS NULL
            FROM drive_passes AS p JOIN drives AS d ON d.id = p.drive_id
            LEFT JOIN rejected_passes AS r ON r.pass_id = p.id
            """
            )
        )
        return {(row[0], row[1]): row[2] for row in rows}


def assert_same(left: Rows, right: Rows) -> None:
    """The contract on what order, deletion and rebuilding may change: at most a tenth of a sigma of 99 % of segments,
    and of none a fifth; of sigmas a twentieth."""
    slope, sigma = _differences(left, right)
    assert np.count_nonzero(slope > 0.1) <= max(1, len(left) // 100), sorted(slope)[-5:]
    assert max(slope, default=0.0) <= 0.2
    assert max(sigma, default=0.0) <= 0.05, sorted(sigma)[-8:]


def assert_at_once(found: Rows, settled: Rows) -> None:
    """The contract on what solvers leave that came in any order and at the same time: slopes as in ``assert_same``. A
    solver goes as far as slopes move; sigmas beyond that wait until their square is settled."""
    slope, sigma = _differences(found, settled)
    assert np.count_nonzero(slope > 0.1) <= max(1, len(found) // 100), sorted(slope)[-5:]
    assert max(slope, default=0.0) <= 0.2
    assert max(sigma, default=0.0) <= 0.1, sorted(sigma)[-8:]


def assert_settled(left: Rows, right: Rows) -> None:
    """The contract on two networks that were rebuilt from the same passes: alike to 1e-9 of a sigma."""
    slope, sigma = _differences(left, right)
    assert max([*slope, *sigma], default=0.0) <= 1e-9


def _differences(left: Rows, right: Rows) -> tuple[np.ndarray, np.ndarray]:
    """How far slopes are apart in sigmas, and by what share sigmas; drives and observations are the same."""
    assert {i: row[2:] for i, row in left.items()} == {i: row[2:] for i, row in right.items()}
    pairs = np.array([(*row[:2], *right[i][:2]) for i, row in left.items()]).reshape(-1, 4).T
    return np.abs(pairs[0] - pairs[2]) / pairs[1], np.abs(pairs[1] / pairs[3] - 1)


def walks(town: Town, count: int) -> list[Said]:
    """Drives from node to node with honest noise, many over the same roads."""
    rng = np.random.default_rng(7)
    table = town.roads
    at_node: dict[int, list[int]] = {}
    for row in range(len(table)):
        for node in (int(table.from_node[row]), int(table.to_node[row])):
            at_node.setdefault(node, []).append(row)
    drives: list[Mapping[int, tuple[float, float]]] = []
    for _ in range(count):
        node = int(table.from_node[len(table) // 2])
        slopes: dict[int, tuple[float, float]] = {}
        for _ in range(40):
            row = int(rng.choice(at_node[node]))
            sigma = float(rng.uniform(0.3, 1.5))
            if rng.uniform() < 0.8:  # elsewhere the receiver saw nothing
                slopes[row] = (float(town.true_slope_percent[row] + sigma * rng.normal()), sigma)
            node = int(table.to_node[row] if table.from_node[row] == node else table.from_node[row])
        drives.append(slopes)
    return drives


def delete(sessions: Sessions, drive: uuid.UUID) -> None:
    """Remove the drive, as the API and a worker do."""
    assert remove_drive(sessions, BlobStore("memory://blobs"), drive)


def count_of(sessions: Sessions, relation: str) -> int:
    """Rows of a table."""
    with sessions() as session:
        return int(session.execute(text(f"SELECT count(*) FROM {relation}")).scalar_one())
