"""Announced is that the status of a drive changed, or that it is asked for anew; no longer each step of its progress.

Whoever commits an announcement holds a lock of the whole server until it has committed, so announcements come one after
the other: with many lanes each step of each drive would wait. Those who follow a drive look every second how far it is.
Programs of the revision before tell them of steps every ten seconds (``VERSANT_EVENTS_POLL_S``), and run beside it.
"""

from alembic import op

revision = "0039"
down_revision = "0038"
branch_labels = None
depends_on = None

oldest_program = down_revision

_ANNOUNCE = """
    CREATE OR REPLACE FUNCTION versant_announce_drives() RETURNS trigger LANGUAGE plpgsql AS $$
    DECLARE
        ids text[];
    BEGIN
        IF TG_OP = 'DELETE' THEN
            SELECT array_agg(CAST(id AS text)) INTO ids FROM (SELECT id FROM former LIMIT 51) AS gone;
        ELSE
            SELECT array_agg(CAST(id AS text)) INTO ids FROM (
                SELECT id FROM present JOIN former USING (id)
                WHERE ({present}) IS DISTINCT FROM ({former})
                LIMIT 51) AS changed;
        END IF;
        IF cardinality(ids) > 50 THEN
            PERFORM pg_notify('versant_drives', '*');
        ELSE
            PERFORM pg_notify('versant_drives', id) FROM unnest(ids) AS id;
        END IF;
        RETURN NULL;
    END $$
"""
_NOW = ("status", "generation")
_FORMER = ("status", "stage", "progress", "generation")


def _announce(columns: tuple[str, ...]) -> None:
    both = {row: ", ".join(f"{row}.{name}" for name in columns) for row in ("present", "former")}
    op.execute(_ANNOUNCE.format(**both))


def upgrade() -> None:
    """Apply."""
    _announce(_NOW)


def downgrade() -> None:
    """Take back."""
    _announce(_FORMER)
