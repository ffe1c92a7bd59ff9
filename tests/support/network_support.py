"""Drives that contribute factors, made up from what they are to say, and what the network makes of them."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping, Sequence

import numpy as np
from sqlalchemy import text

from app.core.db import Sessions
from app.drives import store as drives
from app.network import passes
from app.network import results as slopes
from app.network import versions as locks
from app.roads import store as roads
from fusion.network.curve import slope_row, variable_count
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints, SegmentSlope

T0_S = 1_700_000_000.0
Said = Mapping[int, tuple[float, float]]
"""Slope and sigma by row of the table, percent."""
Rows = dict[int, tuple[float, float, int, int]]
"""Slope, sigma, drives, observations by segment."""


def factor_of(
    table: RoadTable, row: int, slope_percent: float, sigma_percent: float, before: Sequence[int] = ()
) -> PassFactor:
    """The factor of a pass that knows nothing but the slope of its segment; ``before``: its history."""
    length = float(table.length_m[row])
    design = slope_row(0.0, length, length)
    history = sum(int(variable_count(table.length_m[k])) for k in before)
    design = np.concatenate([np.zeros(history), design])
    weight = (sigma_percent / 100) ** -2
    return PassFactor(
        segments=(*before, row),
        information=weight * np.outer(design, design),
        vector=weight * slope_percent / 100 * design,
        slope_percent=slope_percent,
        slope_sigma_percent=sigma_percent,
        start_m=0.0,
        end_m=length,
        roughness=3e-5,
        observations=5,
        first_time_s=T0_S + row,
        last_time_s=T0_S + row + 0.5,
    )


def estimates_of(factors: Sequence[PassFactor]) -> list[SegmentSlope]:
    """What a drive shows as its own, one estimate a segment."""
    last = {factor.segments[-1]: factor for factor in factors}
    return [
        SegmentSlope(row, f.slope_percent, f.slope_sigma_percent, 5, 1, f.first_time_s, f.last_time_s)
        for row, f in last.items()
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
        drives.mark_running(session, drive.id, drive.generation)
    return drive.id


def publish(sessions: Sessions, drive: uuid.UUID, ids: Ints, factors: Sequence[PassFactor]) -> passes.Hearing:
    """Store what the drive says, as the worker does; segments of factors are rows of the table behind ``ids``."""
    with sessions.begin() as session:
        locks.own_network(session)
        version = roads.current_road_version(session)
        assert version is not None
        provenance = slopes.RunProvenance("profile", {}, "1.0", version.id, None)
        estimates = estimates_of(factors)
        return slopes.save_result(session, drive, ids, estimates, provenance, factors)


def drive_over(sessions: Sessions, table: RoadTable, ids: Ints, said: Said) -> uuid.UUID:
    """A drive that passes once over each of these rows."""
    drive = new_drive(sessions)
    publish(sessions, drive, ids, [factor_of(table, row, *values) for row, values in said.items()])
    return drive


def rows_of(sessions: Sessions, relation: str = "segment_slopes") -> Rows:
    """What ``segment_slopes`` or ``network_slopes`` holds."""
    query = f"SELECT segment_id, slope_percent, slope_sigma_percent, drives, observations FROM {relation}"
    with sessions() as session:
        return {row[0]: (row[1], row[2], row[3], row[4]) for row in session.execute(text(query))}


def evidence_of(sessions: Sessions) -> dict[int, bytes]:
    """The cached evidence, byte by byte."""
    with sessions() as session:
        rows = session.execute(text("SELECT segment_id, evidence FROM segment_evidence"))
        return {row[0]: bytes(row[1]) for row in rows}


def verdicts_of(sessions: Sessions) -> dict[tuple[uuid.UUID, int], bool]:
    """Whether each pass is heard, by drive and segment (of drives that pass once)."""
    with sessions() as session:
        rows = session.execute(text("SELECT drive_id, segment_id, accepted FROM drive_passes"))
        return {(row[0], row[1]): row[2] for row in rows}


def assert_same(left: Rows, right: Rows) -> None:
    """The contract on what order, deletion and rebuilding may change: 0.005 % of slope, 2 % of sigma.

    Only the slope of a gap, whose sigma is several percent, depends on how far around it is solved: the roads
    that join its ends elsewhere may be long.
    """
    assert left.keys() == right.keys()
    for segment, (slope, sigma, *counts) in left.items():
        other, gap = right[segment], not counts[0]
        said = (segment, left[segment], other)
        assert abs(slope - other[0]) <= (0.05 * sigma if gap else 0.005), said
        assert abs(sigma / other[1] - 1) <= (0.1 if gap else 0.02), said
        assert tuple(counts) == other[2:], said


def walks(town: Town, count: int) -> list[Said]:
    """Drives from node to node with honest noise, many over the same roads."""
    rng = np.random.default_rng(7)
    table = town.roads
    at_node: dict[int, list[int]] = {}
    for row in range(len(table)):
        for node in (int(table.from_node[row]), int(table.to_node[row])):
            at_node.setdefault(node, []).append(row)
    found = []
    for _ in range(count):
        node, said = int(table.from_node[len(table) // 2]), {}
        for _ in range(40):
            row = int(rng.choice(at_node[node]))
            sigma = float(rng.uniform(0.3, 1.5))
            if rng.uniform() < 0.8:  # elsewhere the receiver saw nothing
                said[row] = (float(town.true_slope_percent[row] + sigma * rng.normal()), sigma)
            node = int(table.to_node[row] if table.from_node[row] == node else table.from_node[row])
        found.append(said)
    return found


def delete(sessions: Sessions, drive: uuid.UUID) -> None:
    """Remove the drive, as the API does."""
    with sessions.begin() as session:
        assert drives.delete_drive(session, drive)


def count_of(sessions: Sessions, relation: str) -> int:
    """Rows of a table."""
    with sessions() as session:
        return int(session.execute(text(f"SELECT count(*) FROM {relation}")).scalar_one())
