"""Repeats: drives over one segment, paired with those before them (``fusion.network.repeats``).

Each drive's own slope and sigma are read as it stated them (``drive_segments``), never as they are widened
(``app.network.widenings``): what is learned from repeats has no part in what it is learned from.
"""

from __future__ import annotations

import uuid
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.core.tables import IS_SHOWN
from fusion.network.pass_factor import DRIVEN_BYTES, PassFactor
from fusion.network.repeats import OwnSlopes, RepeatPairs
from fusion.types import Floats

DEVICE_CLASS = """
    CASE WHEN jsonb_exists({0}.report -> 'sensors', 'doppler') THEN 'doppler'
         WHEN jsonb_exists({0}.report -> 'sensors', 'barometer') THEN 'barometer'
         WHEN jsonb_exists({0}.report -> 'sensors', 'altitude')
             THEN CASE WHEN CAST({0}.report ->> 'altimeter' AS boolean) THEN 'altimeter' ELSE 'altitude' END
         WHEN jsonb_exists_any({0}.report -> 'sensors', ARRAY['pitch', 'specific force']) THEN 'inertial'
         ELSE 'elevation model' END || ', ' || CAST({0}.report ->> 'format' AS text)
"""
"""``fusion.network.repeats.device_class`` as SQL on a row of ``drives`` under that name; NULL without a report."""

MOST_ESTIMATES = 100_000
"""Of more drives' estimates of segments, those in an equal part of all cells are read: a few seconds' work."""
PARTS = 1024

_SHARE = text("SELECT reltuples FROM pg_class WHERE oid = CAST('drive_segments' AS regclass)")

# The next pass, or the one before, tells the direction: by which node it meets this one's segment.
_MEETS = """
    CASE WHEN {step}(p.sequence) OVER drive = p.sequence {sign} 1 THEN
        CAST({near} IN ({step}(s.from_node) OVER drive, {step}(s.to_node) OVER drive) AS integer)
        - CAST({far} IN ({step}(s.from_node) OVER drive, {step}(s.to_node) OVER drive) AS integer) ELSE 0 END
"""
# The planner takes a third of all cells for chosen, and would read everything: OFFSET 0 has it look up what is theirs.
_SINGLE = f"""
    WITH chosen AS MATERIALIZED (
        SELECT s.* FROM cells AS c, LATERAL (
            SELECT id, cell, from_node, to_node, length_m, oneway FROM segments WHERE cell = c.id OFFSET 0) AS s
        WHERE hashint4(c.id) & {PARTS - 1} < %(part)s
    ), every AS MATERIALIZED (
        SELECT p.drive_id, p.segment_id, p.id, p.entered_s, s.length_m, s.oneway,
               substring(p.factor FROM 1 FOR {DRIVEN_BYTES}) AS head,
               sign({_MEETS.format(step="lead", sign="+", near="s.to_node", far="s.from_node")}
                    + {_MEETS.format(step="lag", sign="-", near="s.from_node", far="s.to_node")}) AS way
        FROM chosen AS s, LATERAL (
            SELECT * FROM drive_passes WHERE segment_id = s.id AND partition = versant_partition(s.cell) OFFSET 0) AS p
        WINDOW drive AS (PARTITION BY p.drive_id ORDER BY p.sequence)
    ), known AS MATERIALIZED (
        SELECT d.id, {DEVICE_CLASS.format("d")} AS class,
               coalesce(CAST(extract(month FROM d.drive_time) AS integer) %% 12 / 3, -1) AS season
        FROM drives AS d WHERE d.duplicate_of IS NULL AND {IS_SHOWN.format("d")}
    )
    SELECT o.segment_id, o.drive_id, d.class, e.slope_percent, e.slope_sigma_percent, o.length_m,
           CAST(coalesce(nullif(o.way, 0), o.oneway) AS integer), d.season, o.head
    FROM every AS o
    JOIN known AS d ON d.id = o.drive_id
    CROSS JOIN LATERAL (
        SELECT passes, in_network, slope_percent, slope_sigma_percent FROM drive_segments
        WHERE drive_id = o.drive_id AND segment_id = o.segment_id OFFSET 0) AS e
    WHERE e.passes = 1 AND e.in_network AND d.class IS NOT NULL
        AND NOT EXISTS (SELECT FROM rejected_passes AS r WHERE r.segment_id = o.segment_id AND r.pass_id = o.id)
    ORDER BY o.segment_id, o.entered_s, o.drive_id
"""  # noqa: S608 - constants


def read_repeats(session: Session) -> RepeatPairs:
    """Each drive that passed a segment once, nearly whole and accepted, with the last that did so before it, and with
    the last of its own class."""
    estimates = float(session.execute(_SHARE).scalar_one())
    part = PARTS if estimates <= MOST_ESTIMATES else max(1, int(PARTS * MOST_ESTIMATES / estimates))
    rows = fetch_binary(session, _SINGLE, {"part": part}, prepare=False)
    if not rows:
        return pairs_of([], np.zeros((0, 4)))
    return pairs_of(rows, PassFactor.driven([row[-1] for row in rows]))


def pairs_of(rows: list[tuple[Any, ...]], driven: Floats) -> RepeatPairs:
    """Pairs of rows of ``_SINGLE``; ``driven`` (m, 4) is what the head of each says (``PassFactor.driven``)."""
    start, end, first, last = driven.T
    columns = list(zip(*rows, strict=True)) if rows else [()] * 9
    names = sorted(set(columns[2]))
    number: dict[uuid.UUID, int] = {drive: k for k, drive in enumerate(dict.fromkeys(columns[1]))}
    return RepeatPairs.of_neighbours(
        OwnSlopes(
            names=tuple(names),
            segment=np.array(columns[0], np.int64),
            drive=np.array([number[one] for one in columns[1]], np.int64),
            kind=np.array([names.index(one) for one in columns[2]], np.int64),
            slope_percent=np.array(columns[3], float),
            sigma_percent=np.array(columns[4], float),
            length_m=np.array(columns[5], float),
            driven_m=end - start,
            speed_mps=(end - start) / np.maximum(last - first, 0.1),
            way=np.array(columns[6], np.int64),
            season=np.array(columns[7], np.int64),
        )
    )
