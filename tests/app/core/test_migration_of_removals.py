"""What migration 0027 cleans away: names and places that outlasted the drives that they were of."""

from __future__ import annotations

from sqlalchemy import Engine, create_engine, text

from app.core import migrate


def rows_of(engine: Engine, query: str) -> list[tuple[object, ...]]:
    with engine.connect() as connection:
        return [tuple(row) for row in connection.execute(text(query))]


def test_what_removed_drives_had_left_behind_goes(blank_database_url: str) -> None:
    migrate.upgrade(blank_database_url, "0026")
    engine = create_engine(blank_database_url)
    reason = "between 49.01234 and 49.11234 degrees north and between -8.41 and 8.51234, 12.3 km"
    with engine.begin() as connection:
        statements = (
            """
            INSERT INTO audit_log (action, subject, detail, origin) VALUES
                ('drive removed', 'x', '{"filename": "max.csv", "km": 1.5}', ''),
                ('drives removed', 'y', '{"bbox": [8.41234, 49, 9, 50], "which": "all"}', ''),
                ('export removed', 'z', '{"file_name": "segments.csv"}', '')
            """,
            """
            INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options, failure_reason)
            VALUES (gen_random_uuid(), 'a', 'kept.csv', 1, 'a', 'failed', 'raw', '{}', :reason),
                   (gen_random_uuid(), 'b', 'max.csv', 1, 'b', 'cancelled', 'raw', '{"columns": {}}', 'why')
            """,
            "INSERT INTO drive_tracks (drive_id, track) SELECT id, 'x' FROM drives",
            """
            INSERT INTO batches (selection, state) VALUES ('{"which": "all", "bbox": [8.4, 49, 9, 50]}', 'enqueued')
            """,
        )
        for statement in statements:
            named = {"reason": reason} if ":reason" in statement else {}
            connection.execute(text(statement.replace('": ', '"\\: ') if not named else statement), named)
    migrate.upgrade(blank_database_url, "0027")
    blanked = "between (blanked) and (blanked) degrees north and between -8.41 and (blanked), 12.3 km"
    assert rows_of(engine, "SELECT detail FROM audit_log ORDER BY id") == [
        ({"km": 1.5},),
        ({"bbox": True, "which": "all"},),
        ({"file_name": "segments.csv"},),
    ]
    drives = "SELECT filename, options, failure_reason FROM drives ORDER BY sha256"
    assert rows_of(engine, drives) == [("kept.csv", {}, blanked), ("", {}, None)]
    assert rows_of(engine, "SELECT count(*) FROM drive_tracks") == [(1,)]
    assert rows_of(engine, "SELECT selection FROM batches") == [({"which": "all"},)]
    engine.dispose()
