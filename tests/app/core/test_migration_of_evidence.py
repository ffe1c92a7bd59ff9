"""Passes go into parts by tile of zoom 6, rejections beside them, and back; nothing of what drives said is lost."""

from __future__ import annotations

from sqlalchemy import Engine, create_engine, text

from app.core import migrate

_DATA_OF_0011 = """
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added)
        VALUES ('x', 'y', 1, 0, 0, 0, 1);
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge,
                          tunnel, layer, road_version_id)
        SELECT way, 2, 3, ST_Transform(line, 4326), line, 73, 'track', 0, false, false, 0, 1
        FROM (VALUES (1, ST_GeomFromText('LINESTRING(0 0, 1 1)', 3857)),
                     (2, ST_GeomFromText('LINESTRING(-5e6 6e6, -5e6 6000001)', 3857))) AS made (way, line);
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options, same_as)
        VALUES ('00000000-0000-0000-0000-000000000001', 'a', 'f', 1, 'k', 'done', 'profile', '{}', NULL),
               ('00000000-0000-0000-0000-000000000002', 'b', 'f', 1, 'k', 'done', 'profile', '{}',
                '00000000-0000-0000-0000-000000000001');
    INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, accepted)
        SELECT d.id, s.id, s.id, 1.7e9 + s.id, decode('00ff', 'hex'), d.same_as IS NULL AND s.id = 1
        FROM drives AS d, segments AS s ORDER BY d.id, s.id;
    INSERT INTO drive_constants (drive_id, passes, said, measurements, epoch_s)
        SELECT id, 2, decode('00ff', 'hex'), 7, decode('00ff', 'hex') FROM drives;
"""
_COLUMNS = "id, drive_id, segment_id, sequence, entered_s, factor"
_PARTITIONS = {1: 32 << 6 | 31, 2: 24 << 6 | 22}
"""x and y of the tiles of zoom 6 around the two segments."""


def rows_of(engine: Engine, query: str) -> list[tuple[object, ...]]:
    with engine.connect() as connection:
        return [tuple(row) for row in connection.execute(text(query))]


def execute(engine: Engine, statement: str) -> None:
    with engine.begin() as connection:
        connection.execute(text(statement))


def test_passes_are_parted_with_their_rejections_and_come_back(blank_database_url: str) -> None:
    migrate.upgrade(blank_database_url, "0011")
    engine = create_engine(blank_database_url)
    execute(engine, _DATA_OF_0011)
    query = f"SELECT {_COLUMNS}, accepted FROM drive_passes ORDER BY id"
    before = rows_of(engine, query)
    assert [row[-1] for row in before] == [True, False, False, False]

    migrate.upgrade(blank_database_url)
    after = rows_of(engine, f"SELECT {_COLUMNS}, partition, condensed_weight FROM drive_passes ORDER BY id")
    assert after == [(*row[:-1], _PARTITIONS[row[2]], None) for row in before]  # type: ignore[index]
    assert rows_of(engine, "SELECT partitions FROM drive_constants") == 2 * [(sorted(_PARTITIONS.values()),)]
    # None of the drive that is there already: it is rejected for that alone.
    assert rows_of(engine, "SELECT segment_id, pass_id, drive_id FROM rejected_passes") == [
        (2, before[1][0], before[1][1])
    ]

    execute(
        engine,
        "UPDATE drive_passes SET condensed_weight = 1; "
        "INSERT INTO condensed_passes (segment_id, evidence) VALUES (1, '')",
    )
    migrate.downgrade(blank_database_url, "0011")
    assert rows_of(engine, query) == before
    execute(
        engine,
        "INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, accepted) "
        "SELECT drive_id, segment_id, 7, 0, '', true FROM drive_passes WHERE sequence = 1 AND accepted",
    )
    migrate.upgrade(blank_database_url)
    execute(
        engine,
        "INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, partition) "
        "SELECT drive_id, segment_id, 8, 0, '', partition FROM drive_passes WHERE sequence = 7",
    )
    assert rows_of(engine, "SELECT count(DISTINCT id) FROM drive_passes") == [(6,)]  # numbers go on
    assert rows_of(engine, "SELECT count(*) FROM drive_passes WHERE condensed_weight IS NOT NULL") == [(0,)]
    engine.dispose()


def test_every_part_keeps_factors_as_they_are(database_url: str) -> None:
    """They do not compress any further."""
    engine = create_engine(database_url)
    query = """
        SELECT count(*), count(*) FILTER (WHERE attstorage = 'e') FROM pg_attribute
        JOIN pg_inherits ON inhrelid = attrelid
        WHERE inhparent = CAST('drive_passes' AS regclass) AND attname = 'factor'
    """
    assert rows_of(engine, query) == [(16, 16)]
    engine.dispose()
