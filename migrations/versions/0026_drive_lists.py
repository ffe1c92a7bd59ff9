"""Orders of the list of drives, and words of their files' names to search by: indexes and the function of one.

Adds only: programs of the revision before neither need nor notice them.
"""

import sqlalchemy as sa
from alembic import op

revision = "0026"
down_revision = "0025"
branch_labels = None
depends_on = None

oldest_program = down_revision

# Words are what lies between characters that are neither letters nor digits; a number is a word of its own. Of the
# server's own functions alone: no extension has to be there, and a dump comes back without one. No function of SQL:
# that would be dissolved into parts whose cost the planner takes for nothing, and names be taken apart row by row.
_WORDS = r"""
CREATE FUNCTION file_words(name text) RETURNS tsvector LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE
    COST 4000 AS $$
BEGIN
    RETURN to_tsvector('simple', regexp_replace(regexp_replace(name, '[^[:alnum:]]+', ' ', 'g'),
                                                '([0-9]+)', ' \1 ', 'g'));
END
$$
"""
_ORDERS = {
    "ix_drives_drive_time_created_at_id": ["drive_time", "created_at", "id"],
    "ix_drives_distance_m_created_at_id": ["distance_m", "created_at", "id"],
    "ix_drives_name_created_at_id": [
        sa.text('"left"(lower(filename), 100) COLLATE "C"'),
        "created_at",
        "id",
    ],
}


def upgrade() -> None:
    """Apply."""
    op.execute(_WORDS)
    op.create_index("ix_drives_words", "drives", [sa.text("file_words(filename)")], postgresql_using="gin")
    for name, columns in _ORDERS.items():
        op.create_index(name, "drives", columns)
    op.create_index(
        "ix_drives_failure_kind_created_at_id",
        "drives",
        ["failure_kind", "created_at", "id"],
        postgresql_where=sa.text("status = 'failed'"),
    )


def downgrade() -> None:
    """Take back."""
    for name in ("ix_drives_failure_kind_created_at_id", *_ORDERS, "ix_drives_words"):
        op.drop_index(name, table_name="drives")
    op.execute("DROP FUNCTION file_words(text)")
