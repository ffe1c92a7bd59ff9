"""Migration 0028 gives tables and columns plain names: every row is as it was, there and back."""

from __future__ import annotations

from sqlalchemy import Engine, create_engine, text

from app.core import migrate
from app.core.tables.network import PARTITION_PREFIX

_DATA_OF_0027 = """
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added)
        VALUES ('x', 'y', 1, 0, 0, 0, 1);
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge,
                          tunnel, layer, road_version_id)
        SELECT 1, 2, 3, ST_Transform(line, 4326), line, 73, 'track', 0, false, false, 0, 1
        FROM ST_GeomFromText('LINESTRING(0 0, 1 1)', 3857) AS line;
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options, same_as)
        VALUES ('00000000-0000-0000-0000-000000000001', 'a', 'f', 1, 'k', 'done', 'profile', '{}', NULL),
               ('00000000-0000-0000-0000-000000000002', 'b', 'f', 1, 'k', 'done', 'profile', '{}',
                '00000000-0000-0000-0000-000000000001');
    INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, region, summed_weight)
        SELECT d.id, s.id, k, 1.7e9 + k, decode('00ff', 'hex'), versant_region(s.cell), nullif(k, 2) / 2.0
        FROM drives AS d, segments AS s, generate_series(1, 3) AS k ORDER BY d.id, k;
    INSERT INTO drive_constants (drive_id, passes, said, measurements, epoch_s, regions)
        SELECT id, 3, decode('00fe', 'hex'), 7, decode('00ff', 'hex'), '{2079}' FROM drives;
    INSERT INTO pass_sums (segment_id, said) SELECT 1, decode('01ff', 'hex') FROM generate_series(1, 2);
    INSERT INTO attic_segments (segment_id, osm_way_id, from_node, to_node, geom, length_m, kept_at)
        SELECT 7, 8, 9, 10, geom, 73, '2026-11-20T12:00:00Z' FROM segments;
    INSERT INTO attic_passes (attic_id, drive_id, run, sequence, entered_s, factor)
        SELECT 1, id, 5, 6, 1.7e9, decode('02ff', 'hex') FROM drives;
    INSERT INTO attic_estimates (attic_id, drive_id, run, slope_percent, slope_sigma_percent, observations, passes,
                                 first_at, last_at, in_network)
        SELECT 1, id, 5, 2.5, 0.5, 7, 1, '2026-11-20T12:00:00Z', '2026-11-20T12:00:01Z', true FROM drives;
    INSERT INTO drawn_pieces (level, square, segment_id, rank, highway, oneway, slope_percent, drives, length_m,
                              geom_3857)
        SELECT 12, cell, id, 3, highway, 0, 2.5, 1, 73, geom_3857 FROM segments;
    DELETE FROM squares_to_draw;
    INSERT INTO squares_to_draw (level, square, since) VALUES (12, 5, '2026-11-20T12:00:00Z');
    INSERT INTO webhooks (id, url, secret, events, told)
        VALUES ('00000000-0000-0000-0000-000000000003', 'https://example.org', 's', '{segments.changed}', 'v.7');
"""
_TABLES = {
    "drives": "drives",
    "drive_passes": "drive_passes",
    "drive_constants": "drive_constants",
    "pass_sums": "condensed_passes",
    "attic_segments": "retired_segments",
    "attic_passes": "retired_passes",
    "attic_estimates": "retired_estimates",
    "drawn_pieces": "drawn_pieces",
    "squares_to_draw": "cells_to_draw",
    "webhooks": "webhooks",
}
_FORMER = r"(attic|pass_sums|summed|same_as|square|said|told|kept_at|versant_region)"
_FORMER_NAMES = f"""
    SELECT relname FROM pg_class WHERE relnamespace = 'public'::regnamespace AND relname ~ '{_FORMER}'
    UNION ALL SELECT conname FROM pg_constraint WHERE conname ~ '{_FORMER}'
    UNION ALL SELECT proname FROM pg_proc WHERE proname LIKE 'versant%' AND proname ~ '{_FORMER}'
    UNION ALL SELECT p.proname FROM pg_proc AS p WHERE p.proname LIKE 'versant%' AND p.prosrc ~ '{_FORMER}'
    UNION ALL SELECT attname FROM pg_attribute JOIN pg_class AS c ON c.oid = attrelid
        WHERE relnamespace = 'public'::regnamespace AND relkind IN ('r', 'p') AND NOT attisdropped
            AND relname NOT LIKE '{PARTITION_PREFIX}%' AND attname ~ '^{_FORMER}$'
"""


def rows_of(engine: Engine, query: str) -> list[tuple[object, ...]]:
    with engine.connect() as connection:
        return [tuple(row) for row in connection.execute(text(query))]


def content(engine: Engine, tables: object) -> list[list[tuple[object, ...]]]:
    """All rows of these tables, by value: names of columns do not count, their order does."""
    return [rows_of(engine, f"SELECT * FROM {name} ORDER BY 1, 2") for name in tables]  # type: ignore[attr-defined]


def test_every_row_keeps_its_values_under_the_new_names_and_comes_back(blank_database_url: str) -> None:
    migrate.upgrade(blank_database_url, "0027")
    engine = create_engine(blank_database_url)
    with engine.begin() as connection:
        connection.execute(text(_DATA_OF_0027.replace(":00Z", r"\:00Z").replace(":01Z", r"\:01Z")))
    before = content(engine, _TABLES)
    assert all(before)

    migrate.upgrade(blank_database_url, "0028")
    assert content(engine, _TABLES.values()) == before
    assert rows_of(engine, _FORMER_NAMES) == []
    assert rows_of(
        engine, "SELECT DISTINCT partition = versant_partition(8192 << 14 | 8191) FROM drive_passes"
    ) == [(True,)]
    with engine.begin() as connection:  # numbers go on, and rows go with what they are of
        connection.execute(text("INSERT INTO condensed_passes (segment_id, evidence) VALUES (1, '')"))
        connection.execute(text("DELETE FROM retired_segments"))
    assert rows_of(engine, "SELECT max(id) FROM condensed_passes") == [(3,)]
    assert rows_of(engine, "SELECT FROM retired_passes UNION ALL SELECT FROM retired_estimates") == []
    engine.dispose()


def test_the_way_back_keeps_every_row(blank_database_url: str) -> None:
    migrate.upgrade(blank_database_url, "0027")
    engine = create_engine(blank_database_url)
    with engine.begin() as connection:
        connection.execute(text(_DATA_OF_0027.replace(":00Z", r"\:00Z").replace(":01Z", r"\:01Z")))
    before, names = content(engine, _TABLES), rows_of(engine, _FORMER_NAMES)
    migrate.upgrade(blank_database_url, "0028")
    migrate.downgrade(blank_database_url, "0027")
    assert content(engine, _TABLES) == before
    assert sorted(rows_of(engine, _FORMER_NAMES), key=str) == sorted(names, key=str)
    engine.dispose()


def test_programs_of_before_are_told_that_they_are_too_old(blank_database_url: str) -> None:
    migrate.upgrade(blank_database_url, "0028")
    engine = create_engine(blank_database_url)
    assert rows_of(engine, "SELECT oldest_program FROM schema_support") == [("0028",)]
    engine.dispose()
