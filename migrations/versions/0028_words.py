"""Plain names for tables and columns; every row stays as it is, but for figures that a worker makes again.

Programs of the revision before do not find the new names: stop them before this migration, and start those of this
revision after it.
"""

from alembic import op

revision = "0028"
down_revision = "0027"
branch_labels = None
depends_on = None

# The lists are read top down: a table has its new name by the time that its columns get theirs.
_TABLES = {
    "pass_sums": "condensed_passes",
    "attic_segments": "retired_segments",
    "attic_passes": "retired_passes",
    "attic_estimates": "retired_estimates",
    "squares_to_draw": "cells_to_draw",
}
_COLUMNS = (
    ("condensed_passes", "said", "evidence"),
    ("drive_constants", "said", "evidence"),
    ("drive_constants", "regions", "partitions"),
    ("drive_passes", "summed_weight", "condensed_weight"),
    ("drive_passes", "region", "partition"),
    ("drives", "same_as", "duplicate_of"),
    ("retired_segments", "kept_at", "retired_at"),
    ("retired_passes", "attic_id", "retired_id"),
    ("retired_estimates", "attic_id", "retired_id"),
    ("drawn_pieces", "square", "cell"),
    ("cells_to_draw", "square", "cell"),
    ("webhooks", "told", "reported_version"),
)
_INDEXES = {
    "pk_pass_sums": "pk_condensed_passes",
    "ix_pass_sums_segment_id": "ix_condensed_passes_segment_id",
    "ix_drive_passes_unsummed": "ix_drive_passes_recent",
    "ix_drives_same_as": "ix_drives_duplicate_of",
    "pk_attic_segments": "pk_retired_segments",
    "ix_attic_segments_kept_at": "ix_retired_segments_retired_at",
    "pk_attic_passes": "pk_retired_passes",
    "ix_attic_passes_attic_id": "ix_retired_passes_retired_id",
    "ix_attic_passes_drive_id": "ix_retired_passes_drive_id",
    "pk_attic_estimates": "pk_retired_estimates",
    "ix_attic_estimates_attic_id": "ix_retired_estimates_retired_id",
    "ix_attic_estimates_drive_id": "ix_retired_estimates_drive_id",
    "pk_squares_to_draw": "pk_cells_to_draw",
}
_FOREIGN_KEYS = (
    ("condensed_passes", "fk_pass_sums_segment_id_segments", "fk_condensed_passes_segment_id_segments"),
    ("drives", "fk_drives_same_as_drives", "fk_drives_duplicate_of_drives"),
    (
        "retired_passes",
        "fk_attic_passes_attic_id_attic_segments",
        "fk_retired_passes_retired_id_retired_segments",
    ),
    ("retired_passes", "fk_attic_passes_drive_id_drives", "fk_retired_passes_drive_id_drives"),
    (
        "retired_estimates",
        "fk_attic_estimates_attic_id_attic_segments",
        "fk_retired_estimates_retired_id_retired_segments",
    ),
    ("retired_estimates", "fk_attic_estimates_drive_id_drives", "fk_retired_estimates_drive_id_drives"),
)
_SEQUENCES = {
    "pass_sums_id_seq": "condensed_passes_id_seq",
    "attic_segments_id_seq": "retired_segments_id_seq",
    "attic_passes_id_seq": "retired_passes_id_seq",
    "attic_estimates_id_seq": "retired_estimates_id_seq",
}

# They name a column of their own as the program of their time does.
_FORGET_FIGURES = "DELETE FROM kept_figures WHERE name = 'disagreements'"


def upgrade() -> None:
    """Apply."""
    for old, new in _TABLES.items():
        op.rename_table(old, new)
    for table, old, new in _COLUMNS:
        op.alter_column(table, old, new_column_name=new)
    for old, new in _INDEXES.items():
        op.execute(f"ALTER INDEX {old} RENAME TO {new}")
    for table, old, new in _FOREIGN_KEYS:
        op.execute(f"ALTER TABLE {table} RENAME CONSTRAINT {old} TO {new}")
    for old, new in _SEQUENCES.items():
        op.execute(f"ALTER SEQUENCE {old} RENAME TO {new}")
    op.execute("ALTER FUNCTION versant_region(integer) RENAME TO versant_partition")
    op.execute(_FORGET_FIGURES)


def downgrade() -> None:
    """Take back: the former names."""
    op.execute(_FORGET_FIGURES)
    op.execute("ALTER FUNCTION versant_partition(integer) RENAME TO versant_region")
    for old, new in _SEQUENCES.items():
        op.execute(f"ALTER SEQUENCE {new} RENAME TO {old}")
    for table, old, new in _FOREIGN_KEYS:
        op.execute(f"ALTER TABLE {table} RENAME CONSTRAINT {new} TO {old}")
    for old, new in _INDEXES.items():
        op.execute(f"ALTER INDEX {new} RENAME TO {old}")
    for table, old, new in _COLUMNS:
        op.alter_column(table, new, new_column_name=old)
    for old, new in _TABLES.items():
        op.rename_table(new, old)
