"""Evidence in bounded pieces: passes by region, sums of old ones, and verdicts beside them.

``drive_passes`` is copied into a table of 16 parts: 200,000 passes of 1.5 kB took four seconds, so ten million take
three to five minutes, and as much room again as they have until the end. A program of before cannot write it, since it
knows no region, nor read what is summed: none serves this schema but those of this revision. Sums are made by solvers,
little by little; nothing is computed here.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

PARTS = 16

# The tile of zoom 6 around a tile of zoom 14, both as x and y in one number.
_REGION = """
    CREATE FUNCTION versant_region(cell integer) RETURNS smallint
    LANGUAGE sql IMMUTABLE PARALLEL SAFE
    RETURN CAST(((cell >> 22) << 6) | ((cell & 16383) >> 8) AS smallint)
"""

# Keys and indexes come when the rows are there, which takes half the time.
_PARTED = """
    CREATE TABLE drive_passes (
        id bigint NOT NULL DEFAULT nextval('drive_passes_id_seq'),
        drive_id uuid NOT NULL,
        segment_id bigint NOT NULL,
        entered_s double precision NOT NULL,
        summed_weight double precision,
        sequence integer NOT NULL,
        region smallint NOT NULL,
        factor bytea NOT NULL
    ) PARTITION BY HASH (region)
"""
_FILL = """
    INSERT INTO drive_passes (id, drive_id, segment_id, entered_s, sequence, region, factor)
    SELECT p.id, p.drive_id, p.segment_id, p.entered_s, p.sequence, versant_region(s.cell), p.factor
    FROM drive_passes_before AS p JOIN segments AS s ON s.id = p.segment_id
"""
_REJECTED = """
    INSERT INTO rejected_passes (segment_id, pass_id, drive_id)
    SELECT p.segment_id, p.id, p.drive_id FROM drive_passes_before AS p JOIN drives AS d ON d.id = p.drive_id
    WHERE NOT p.accepted AND d.same_as IS NULL
"""
_REGIONS = """
    UPDATE drive_constants AS c SET regions = p.regions
    FROM (SELECT drive_id, array_agg(DISTINCT region ORDER BY region) AS regions FROM drive_passes GROUP BY 1) AS p
    WHERE p.drive_id = c.drive_id
"""
_BACK = """
    INSERT INTO drive_passes (id, drive_id, segment_id, sequence, entered_s, factor, accepted)
    SELECT p.id, p.drive_id, p.segment_id, p.sequence, p.entered_s, p.factor,
           d.same_as IS NULL AND NOT EXISTS (
               SELECT FROM rejected_passes AS r WHERE r.segment_id = p.segment_id AND r.pass_id = p.id)
    FROM drive_passes_before AS p JOIN drives AS d ON d.id = p.drive_id
"""


def upgrade() -> None:
    """Apply."""
    op.execute(_REGION)
    _set_aside(
        ("ix_drive_passes_drive_id", "ix_drive_passes_segment_id", "ix_drive_passes_segment_id_entered_s")
    )
    op.execute("CREATE SEQUENCE drive_passes_id_seq")
    op.execute(_PARTED)
    op.execute("ALTER SEQUENCE drive_passes_id_seq OWNED BY drive_passes.id")
    op.execute("ALTER TABLE drive_passes ALTER COLUMN factor SET STORAGE EXTERNAL")
    for part in range(PARTS):
        op.execute(
            f"CREATE TABLE drive_passes_of_{part} PARTITION OF drive_passes "
            f"FOR VALUES WITH (MODULUS {PARTS}, REMAINDER {part})"
        )
    op.execute(_FILL)
    _continue_numbers()
    _make_sums_and_verdicts()
    op.execute(_REJECTED)
    op.add_column(
        "drive_constants",
        sa.Column("regions", postgresql.ARRAY(sa.SmallInteger()), server_default="{}", nullable=False),
    )
    op.execute(_REGIONS)
    op.alter_column("drive_constants", "regions", server_default=None)
    op.drop_table("drive_passes_before")
    op.create_primary_key("pk_drive_passes", "drive_passes", ["id", "region"])
    _make_keys(["drive_id", "region"])
    op.create_index(
        "ix_drive_passes_unsummed",
        "drive_passes",
        ["segment_id"],
        postgresql_where=sa.text("summed_weight IS NULL"),
    )
    op.execute("ANALYZE drive_passes")


def downgrade() -> None:
    """Take back. Sums go, passes stay: the former code reads them all."""
    _set_aside(
        ("ix_drive_passes_drive_id", "ix_drive_passes_segment_id_entered_s", "ix_drive_passes_unsummed")
    )
    op.create_table(
        "drive_passes",
        sa.Column("id", sa.BigInteger(), sa.Identity(), nullable=False),
        sa.Column("drive_id", sa.Uuid(), nullable=False),
        sa.Column("segment_id", sa.BigInteger(), nullable=False),
        sa.Column("sequence", sa.Integer(), nullable=False),
        sa.Column("entered_s", sa.Double(), nullable=False),
        sa.Column("factor", sa.LargeBinary(), nullable=False),
        sa.Column("accepted", sa.Boolean(), nullable=False),
    )
    op.execute("ALTER TABLE drive_passes ALTER COLUMN factor SET STORAGE EXTERNAL")
    op.execute(_BACK)
    _continue_numbers()
    op.drop_column("drive_constants", "regions")
    for table in ("rejected_passes", "pass_sums", "drive_passes_before"):
        op.drop_table(table)
    op.execute("DROP FUNCTION versant_region(integer)")
    op.create_primary_key("pk_drive_passes", "drive_passes", ["id"])
    _make_keys(["drive_id"])
    op.create_index(
        "ix_drive_passes_segment_id",
        "drive_passes",
        ["segment_id", "drive_id"],
        postgresql_include=["accepted"],
    )


def _set_aside(indexes: tuple[str, ...]) -> None:
    """Take the table's name, and those of its indexes, from it."""
    for name in indexes:
        op.drop_index(name, "drive_passes")
    op.drop_constraint("pk_drive_passes", "drive_passes")
    op.rename_table("drive_passes", "drive_passes_before")
    op.execute("ALTER SEQUENCE IF EXISTS drive_passes_id_seq RENAME TO drive_passes_before_id_seq")


def _continue_numbers() -> None:
    op.execute(
        "SELECT setval('drive_passes_id_seq', (SELECT coalesce(max(id), 0) + 1 FROM drive_passes), false)"
    )


def _make_sums_and_verdicts() -> None:
    op.create_table(
        "pass_sums",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        _owner("segment_id", "segments", sa.BigInteger()),
        sa.Column("said", sa.LargeBinary(), nullable=False),
    )
    op.execute("ALTER TABLE pass_sums ALTER COLUMN said SET STORAGE EXTERNAL")
    op.create_index("ix_pass_sums_segment_id", "pass_sums", ["segment_id"])
    op.create_table(
        "rejected_passes",
        _owner("segment_id", "segments", sa.BigInteger()),
        sa.Column("pass_id", sa.BigInteger(), nullable=False),
        _owner("drive_id", "drives", sa.Uuid()),
        sa.PrimaryKeyConstraint("segment_id", "pass_id"),
    )
    op.create_index("ix_rejected_passes_drive_id", "rejected_passes", ["drive_id"])


def _owner(name: str, table: str, kind: sa.types.TypeEngine[object]) -> sa.Column[object]:
    """A column whose row goes with the one that it names."""
    return sa.Column(name, kind, sa.ForeignKey(f"{table}.id", ondelete="CASCADE"), nullable=False)


def _make_keys(included: list[str]) -> None:
    for name, table in (("drive_id", "drives"), ("segment_id", "segments")):
        op.create_foreign_key(
            f"fk_drive_passes_{name}_{table}", "drive_passes", table, [name], ["id"], ondelete="CASCADE"
        )
    op.create_index("ix_drive_passes_drive_id", "drive_passes", ["drive_id"])
    op.create_index(
        "ix_drive_passes_segment_id_entered_s",
        "drive_passes",
        ["segment_id", "entered_s"],
        postgresql_include=included,
    )
