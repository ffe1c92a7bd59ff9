"""What bounds each table is said in the documents, and what is over goes."""

from __future__ import annotations

import re
from pathlib import Path

import psycopg
from sqlalchemy import text

from app.access import quotas
from app.core.db import Sessions
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.drives.batches import store as batches
from app.operations import store as operations
from many_drives import make_drives

AGE_S = 86400.0 * Settings().history_kept_days

PAGE = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "scale.md"
_TABLES = """
    SELECT CASE n.nspname WHEN 'public' THEN '' ELSE n.nspname || '.' END || c.relname
    FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace
    WHERE c.relkind IN ('r', 'p') AND NOT c.relispartition
        AND n.nspname NOT IN ('pg_catalog', 'information_schema') AND n.nspname NOT LIKE 'pg\\_%'
        AND NOT EXISTS (SELECT FROM pg_depend AS d WHERE d.classid = CAST('pg_class' AS regclass)
                        AND d.objid = c.oid AND d.deptype = 'e')
"""


def test_the_documents_say_what_bounds_each_table(database_url: str) -> None:
    section = PAGE.read_text(encoding="utf-8").split("## What bounds each table")[1].split("\n## ")[0]
    rows = [line.split("|") for line in section.splitlines() if line.startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`([^`]+)`", row[1])]
    with psycopg.connect(libpq_url(database_url)) as connection:
        there = {name for (name,) in connection.execute(_TABLES)}
    assert sorted(named) == sorted(there)


def kept(sessions: Sessions, query: str) -> set[object]:
    with sessions() as session:
        return set(session.execute(text(query)).scalars())


def test_old_batches_go_that_no_drive_names(sessions: Sessions) -> None:
    make_drives(sessions, 2)
    add = """
        INSERT INTO batches (selection, state, asked_at)
        SELECT jsonb_build_object('which', who), state, now() - make_interval(days => days)
        FROM (VALUES ('named', 'enqueued', 500), ('over', 'enqueued', 500), ('cancelled', 'cancelled', 500),
                     ('begun', 'enqueuing', 500), ('young', 'enqueued', 300)) AS v (who, state, days)
    """
    name = "UPDATE drives SET batch_id = (SELECT id FROM batches WHERE selection ->> 'which' = 'named')"
    with sessions.begin() as session:
        session.execute(text(add))
        session.execute(text(name))
        batches.forget_old(session, AGE_S)
    assert kept(sessions, "SELECT selection ->> 'which' FROM batches") == {"named", "begun", "young"}
    assert kept(sessions, "SELECT count(batch_id) FROM drives") == {2}


def test_operations_go_that_ended_long_ago(sessions: Sessions) -> None:
    add = """
        INSERT INTO operations (id, kind, subject, request, status, created_at, finished_at, planned_at)
        SELECT gen_random_uuid(), 'settle', subject, '{}', status, now() - make_interval(days => made),
               now() - make_interval(days => ended), now() - make_interval(days => made)
        FROM (VALUES ('done', 'done', 500, 499), ('failed', 'failed', 500, 499), ('dropped', 'cancelled', 500, 499),
                     ('late', 'done', 500, 300), ('young', 'done', 300, 299), ('runs', 'running', 500, NULL),
                     ('plan', 'planned', 500, NULL)) AS v (subject, status, made, ended)
    """
    with sessions.begin() as session:
        session.execute(text(add))
        operations.forget(session, Settings())
    # A plan that nobody wanted is cancelled, and stays for as long as others from then on.
    assert kept(sessions, "SELECT subject FROM operations") == {"late", "young", "runs", "plan"}


def test_uploads_are_counted_by_day_for_a_year(sessions: Sessions) -> None:
    add = """
        INSERT INTO owner_use (owner_id, day, drives, bytes)
        SELECT (SELECT min(id) FROM owners), CURRENT_DATE - days, days, 1 FROM (VALUES (0), (399), (402)) AS v (days)
    """
    with sessions.begin() as session:
        session.execute(text(add))
        quotas.forget_use(session, AGE_S)
    assert kept(sessions, "SELECT drives FROM owner_use") == {0, 399}
