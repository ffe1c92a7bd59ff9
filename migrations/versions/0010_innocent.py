"""Which computations run, and how often one took its process along; which programs a schema serves; the queue's files.

Adds only: programs of older revisions neither need nor notice it.
"""

from typing import Any

import psycopg
import sqlalchemy as sa
from alembic import op

from app.core import schema

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

oldest_program = "0010"  # older ones demand their own revision, whatever is said here

_READ_COMMENT = "SELECT obj_description('procrastinate_jobs'::regclass)"
_RECORD = "INSERT INTO queue_migrations (name) VALUES (%s) ON CONFLICT DO NOTHING"

_BEFORE_THE_FIRST = "03"
"""No release of the project had a queue older than its version 3: what is older is in every database."""

_HAS_FUNCTION = "EXISTS (SELECT FROM pg_proc WHERE proname = 'procrastinate_{}')"
_SAYS = "EXISTS (SELECT FROM pg_proc WHERE proname = 'procrastinate_{}' AND prosrc LIKE '%{}%')"
_WORKERS = "to_regclass('procrastinate_workers') IS NOT NULL"
_TO_DEFER = "to_regtype('procrastinate_job_to_defer_v1') IS NOT NULL"

_SIGNS = {
    "03.00.00_01_pre_cancel_notification.sql": "EXISTS (SELECT FROM pg_attribute WHERE attname = 'abort_requested'"
    " AND attrelid = 'procrastinate_jobs'::regclass)",
    "03.00.00_50_post_cancel_notification.sql": "EXISTS (SELECT FROM pg_trigger"
    " WHERE tgname = 'procrastinate_jobs_notify_queue_job_inserted_v1')",
    "03.01.00_01_pre_add_heartbeat.sql": _WORKERS,
    "03.01.00_50_post_add_heartbeat.sql": f"{_WORKERS} AND NOT {_HAS_FUNCTION.format('fetch_job_v1')}",
    "03.02.00_01_pre_batch_defer_jobs.sql": _TO_DEFER,
    "03.02.00_50_post_batch_defer_jobs.sql": f"{_TO_DEFER} AND NOT {_HAS_FUNCTION.format('defer_job_v1')}",
    "03.03.00_01_pre_priority_lock_fetch_job.sql": _SAYS.format("fetch_job_v2", "other_jobs"),
    "03.04.00_01_pre_add_retry_failed_job_procedure.sql": _HAS_FUNCTION.format("retry_job_v2"),
    "03.04.00_50_post_add_retry_failed_job_procedure.sql": _SAYS.format(
        "trigger_function_status_events_update_v1", "retried"
    ),
}
"""By what a database from before the files were noted shows that one was applied."""


def _adopt_queue(connection: psycopg.Connection[Any]) -> None:
    """Begin the record of the queue's files with those that the database shows to have."""
    (last,) = connection.execute(_READ_COMMENT).fetchone() or (None,)
    for name in schema.queue_files():
        if name < _BEFORE_THE_FIRST or (name <= last if last else _shows(connection, name)):
            connection.execute(_RECORD, (name,))


def _shows(connection: psycopg.Connection[Any], name: str) -> bool:
    sign = _SIGNS.get(name)
    return sign is not None and bool(connection.execute(f"SELECT {sign}".encode()).fetchone()[0])


def _of_one_row() -> tuple[sa.Column, sa.CheckConstraint]:
    number = sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False)
    return number, sa.CheckConstraint("id = 1", name="singleton")


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "computations",
        sa.Column("job_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("deaths", sa.SmallInteger(), server_default="0", nullable=False),
        sa.Column("since", sa.DateTime(timezone=True)),
        sa.Column("process", sa.String()),
        sa.Column("backend", sa.Integer()),
        sa.Column("backend_start", sa.DateTime(timezone=True)),
    )
    op.create_table(
        "schema_support", *_of_one_row(), sa.Column("oldest_program", sa.String(), nullable=False)
    )
    op.create_table(
        "queue_migrations",
        sa.Column("name", sa.String(), primary_key=True),
        sa.Column("applied_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
    )
    _adopt_queue(op.get_bind().connection.driver_connection)


def downgrade() -> None:
    """Take back; what the record said of the queue is kept at its table."""
    last = op.get_bind().execute(sa.text("SELECT max(name) FROM queue_migrations")).scalar_one()
    schema.comment_on_queue(op.get_bind().connection.driver_connection, last)
    for table in ("queue_migrations", "schema_support", "computations"):
        op.drop_table(table)
