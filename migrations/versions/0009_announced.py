"""Changes of drives are announced, so that nobody has to ask again and again; pictures of profiles are kept.

One announcement for each drive that a statement changed, or one for all where they are many: a batch over a hundred
thousand drives is not a hundred thousand announcements.
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

_ANNOUNCE = """
    CREATE FUNCTION versant_announce_drives() RETURNS trigger LANGUAGE plpgsql AS $$
    DECLARE
        ids text[];
    BEGIN
        IF TG_OP = 'DELETE' THEN
            SELECT array_agg(CAST(id AS text)) INTO ids FROM (SELECT id FROM former LIMIT 51) AS gone;
        ELSE
            SELECT array_agg(CAST(id AS text)) INTO ids FROM (
                SELECT id FROM present JOIN former USING (id)
                WHERE (present.status, present.stage, present.progress, present.generation)
                    IS DISTINCT FROM (former.status, former.stage, former.progress, former.generation)
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
_ON_UPDATE = """
    CREATE TRIGGER versant_announce_updates AFTER UPDATE ON drives REFERENCING OLD TABLE AS former NEW TABLE AS present
    FOR EACH STATEMENT EXECUTE FUNCTION versant_announce_drives()
"""
_ON_DELETE = """
    CREATE TRIGGER versant_announce_deletions AFTER DELETE ON drives REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION versant_announce_drives()
"""


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "drive_pictures",
        sa.Column("drive_id", sa.Uuid(), sa.ForeignKey("drives.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("drawn_of", sa.String(), nullable=False),
        sa.Column("png", sa.LargeBinary(), nullable=False),
        sa.Column("drawn_at", sa.DateTime(timezone=True), nullable=False, server_default=sa.func.now()),
    )
    op.create_index("ix_drive_pictures_drawn_at", "drive_pictures", ["drawn_at"])
    # Neither do pictures compress any further.
    op.execute("ALTER TABLE drive_pictures ALTER COLUMN png SET STORAGE EXTERNAL")
    for statement in (_ANNOUNCE, _ON_UPDATE, _ON_DELETE):
        op.execute(statement)


def downgrade() -> None:
    """Take back. Pictures are drawn again when they are asked for."""
    op.execute("DROP TRIGGER versant_announce_deletions ON drives")
    op.execute("DROP TRIGGER versant_announce_updates ON drives")
    op.execute("DROP FUNCTION versant_announce_drives()")
    op.drop_table("drive_pictures")
