"""What removed drives left behind: names of files and boxes in the audit log, places in reasons of failures.

Rows of drives whose removal is under way keep only what takes them back. Data alone: programs of the revision before
neither need nor notice it.
"""

from alembic import op

revision = "0027"
down_revision = "0026"
branch_labels = None
depends_on = None

oldest_program = down_revision

# As lines of the log are blanked: a degree with four decimals is a street.
_PLACE = r"(^|[^\w.])[-+]?\d{1,3}\.\d{4,}"
_REASONS = {
    "drives": ("failure_reason", "failure_where"),
    "drive_trials": ("failure_reason", "failure_where"),
    "exports": ("failure_reason",),
    "operations": ("failure_reason",),
}


def upgrade() -> None:
    """Apply."""
    op.execute(
        "UPDATE audit_log SET detail = detail - 'filename' || CASE WHEN detail ? 'bbox' "
        "THEN jsonb_build_object('bbox', true) ELSE '{}' END WHERE detail ? 'filename' OR detail ? 'bbox'"
    )
    for table, columns in _REASONS.items():
        for column in columns:
            op.execute(f"UPDATE {table} SET {column} = {_blanked(column)} WHERE {column} ~ '{_PLACE}'")  # noqa: S608
    reason = _blanked("data ->> 'reason'")
    op.execute(
        f"UPDATE webhook_deliveries SET data = jsonb_set(data, '{{reason}}', to_jsonb({reason})) "  # noqa: S608
        f"WHERE data ->> 'reason' ~ '{_PLACE}'"
    )
    op.execute(
        "UPDATE drives SET filename = '', options = '{}', report = NULL, drive_time = NULL, failure_kind = NULL, "
        "failure_reason = NULL, failure_where = NULL, before_batch = NULL, traceparent = NULL "
        "WHERE status = 'cancelled'"
    )
    op.execute(
        "UPDATE batches SET selection = selection - 'bbox' WHERE state <> 'enqueuing' AND selection ? 'bbox'"
    )
    for table in ("drive_trials", "drive_tracks", "drive_pictures"):
        op.execute(
            f"DELETE FROM {table} WHERE drive_id IN (SELECT id FROM drives WHERE status = 'cancelled')"  # noqa: S608
        )
    # The attic is for what was measured.
    op.execute(
        "DELETE FROM attic_segments AS a WHERE NOT EXISTS (SELECT FROM attic_passes AS p WHERE p.attic_id = a.id) "
        "AND NOT EXISTS (SELECT FROM attic_estimates AS e WHERE e.attic_id = a.id)"
    )


def _blanked(column: str) -> str:
    return f"regexp_replace({column}, '{_PLACE}', '\\1(blanked)', 'g')"


def downgrade() -> None:
    """Nothing to take back: what is gone stays gone."""
