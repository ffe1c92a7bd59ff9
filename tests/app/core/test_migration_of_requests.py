"""What migration 0029 leaves as it is: requests of the version before, which wait, run, have failed or are done."""

from __future__ import annotations

from sqlalchemy import Engine, create_engine, text

from app.core import migrate

_BEFORE = (
    """
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options)
    VALUES ('00000000-0000-0000-0000-000000000001', 'a', 'a.csv', 1, 'log', 'done', 'raw', '{}')
    """,
    """
    INSERT INTO exports (id, request, request_sha256, status, run, yields, file_name, media_type, blob_key)
    VALUES ('00000000-0000-0000-0000-000000000002', '{"format": "csv"}', 'x', 'done', 2, 1, 'a.csv', 'text/csv', 'file')
    """,
    """
    INSERT INTO operations (id, kind, subject, request, status, stage, progress, plan, failure_reason)
    VALUES ('00000000-0000-0000-0000-000000000003', 'settle', 'map', '{}', 'running', 'solving', 0.5, '{"a": 1}', 'why')
    """,
    """
    INSERT INTO drive_trials (id, drive_id, method, options, asked_sha256, status, failure_where, slopes)
    VALUES ('00000000-0000-0000-0000-000000000004', '00000000-0000-0000-0000-000000000001', 'dem', '{}', 'y', 'failed',
            'line 3', 'bytes')
    """,
)
_NEW = {"exports": {"stage", "failure_where"}, "operations": {"failure_where"}, "drive_trials": {"yields"}}


def rows_of(engine: Engine) -> dict[str, list[dict[str, object]]]:
    with engine.connect() as connection:
        return {
            table: [dict(row) for row in connection.execute(text(f"SELECT * FROM {table}")).mappings()]
            for table in _NEW
        }


def test_requests_of_the_version_before_are_kept(blank_database_url: str) -> None:
    migrate.upgrade(blank_database_url, "0027")
    engine = create_engine(blank_database_url)
    with engine.begin() as connection:
        for statement in _BEFORE:
            connection.exec_driver_sql(statement)
    before = rows_of(engine)
    migrate.upgrade(blank_database_url, "0029")
    after = rows_of(engine)
    assert [len(rows) for rows in before.values()] == [1, 1, 1]
    for table, added in _NEW.items():
        (row,) = after[table]
        assert {name: row.pop(name) for name in added} == dict.fromkeys(
            added, 0 if "yields" in added else None
        )
        assert [row] == before[table]
    engine.dispose()
