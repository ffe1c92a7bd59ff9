"""Owners, keys, sessions; an owner of every drive, export, batch, webhook and row of the audit; row level security.

What is there belongs to the owner ``operator``. Programs of the revision before answer everybody and find the same log
by a column that is no longer unique: they have to stop first, so this migration serves its own program alone.
"""

import sqlalchemy as sa
from alembic import op

from app.core.schema import ensure_roles

revision = "0031"
down_revision = "0030"
branch_labels = None
depends_on = None

OWNED = ("drives", "exports", "batches", "webhooks", "audit_log", "drive_counts")
"""Tables whose rows have an owner."""
OF_DRIVES = (
    "provenances",
    "drive_segments",
    "drive_tracks",
    "drive_passes",
    "rejected_passes",
    "drive_constants",
    "retired_passes",
    "retired_estimates",
    "touched_drives",
    "drive_trials",
    "drive_pictures",
)
"""Tables whose rows go with a drive, and are whose that drive is."""
PARTS = 16
"""Of the passes' table."""

OWNER_OF_CALLER = """
    CREATE FUNCTION versant_owner() RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE AS
    $$ SELECT coalesce(nullif(current_setting('versant.owner', true), '')::bigint, 1) $$
"""
KEY_OF_CALLER = """
    CREATE FUNCTION versant_key() RETURNS uuid LANGUAGE sql STABLE PARALLEL SAFE AS
    $$ SELECT nullif(current_setting('versant.key', true), '')::uuid $$
"""
CONFINED_TO = """
    CREATE FUNCTION versant_confined_to() RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE AS
    $$ SELECT CASE WHEN current_user IN ('versant_owner', 'versant_uploader') THEN versant_owner() END $$
"""
# Only who owns a table may look it through for the planner: the caller of a batch has to, while it fills the queue.
ANALYZE_QUEUE = """
    CREATE FUNCTION analyze_queue() RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS
    $$ BEGIN
        ANALYZE procrastinate_jobs, drives (status, queued_at, created_at, batch_id), drive_counts;
    END $$
"""
IS_OWNERS = "owner_id = (SELECT nullif(current_setting('versant.owner', true), '')::bigint)"
IS_SENT = "sent_by = (SELECT versant_key())"
_COUNT = """
    INSERT INTO drive_counts ({owner}day, status, failure_kind, batch_id, drives, distance_m, size_bytes)
    SELECT {owner}day, status, failure_kind, batch_id, sum(drives), sum(distance_m), sum(size_bytes)
    FROM ({rows}) AS changed GROUP BY {owner}day, status, failure_kind, batch_id
    HAVING sum(drives) <> 0 OR sum(distance_m) <> 0 OR sum(size_bytes) <> 0
"""
_ROWS = """
    SELECT {owner}CAST(created_at AT TIME ZONE 'UTC' AS date) AS day, status, failure_kind, batch_id,
           {sign} 1 AS drives, {sign} coalesce(distance_m, 0) AS distance_m, {sign} size_bytes AS size_bytes
    FROM {table}
"""
OF_A_DRIVE = "EXISTS (SELECT FROM drives AS d WHERE d.id = drive_id)"
OTHERS: dict[str, str | None] = {
    "owners": IS_OWNERS.replace("owner_id", "id", 1),
    "keys": IS_OWNERS,
    "webhook_deliveries": "EXISTS (SELECT FROM webhooks AS w WHERE w.id = webhook_id)",
    "sessions": IS_OWNERS,
    "login_links": "EXISTS (SELECT FROM keys AS k WHERE k.id = key_id)",
    "operations": None,
}
"""Further tables with the rows that an owner sees; None: operators alone see them."""
_POLICIES = "SELECT policyname FROM pg_policies WHERE tablename = :name AND schemaname = current_schema()"


def upgrade() -> None:
    """Apply."""
    ensure_roles(op.get_bind())
    op.execute(OWNER_OF_CALLER)
    op.execute(KEY_OF_CALLER)
    op.execute(CONFINED_TO)
    op.execute(ANALYZE_QUEUE)
    _make_tables()
    for table in OWNED:
        op.add_column(
            table,
            sa.Column(
                "owner_id", sa.BigInteger(), sa.ForeignKey("owners.id"), nullable=False, server_default="1"
            ),
        )
        op.execute(f"ALTER TABLE {table} ALTER COLUMN owner_id SET DEFAULT versant_owner()")
    op.add_column("drives", sa.Column("sent_by", sa.Uuid(), server_default=sa.text("versant_key()")))
    op.add_column("audit_log", sa.Column("key_id", sa.Uuid()))
    op.execute(
        "ALTER TABLE audit_log ALTER COLUMN key_id SET DEFAULT versant_key()"
    )  # of no row that is there
    op.add_column("batches", sa.Column("drives_of", sa.BigInteger(), sa.ForeignKey("owners.id")))
    op.execute("ALTER TABLE batches ALTER COLUMN drives_of SET DEFAULT versant_confined_to()")
    _of_one_owner()
    _count_drives(owner="owner_id, ")
    _guard()


def _make_tables() -> None:
    op.create_table(
        "owners",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("name", sa.String(), nullable=False, unique=True),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
    )
    op.execute("INSERT INTO owners (name) VALUES ('operator')")  # the first: its number is 1
    now = sa.func.now()
    op.create_table(
        "keys",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column(
            "owner_id", sa.BigInteger(), sa.ForeignKey("owners.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("label", sa.String(), nullable=False),
        sa.Column("scope", sa.String(), nullable=False),
        sa.Column("secret_sha256", sa.LargeBinary(), nullable=False, unique=True),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=now, nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True)),
        sa.Column("last_used_on", sa.Date()),
        sa.Column("revoked_at", sa.DateTime(timezone=True)),
        sa.CheckConstraint("scope IN ('upload', 'own', 'operate')", name="scope"),
    )
    op.create_index("ix_keys_owner_id", "keys", ["owner_id"])
    op.create_table(
        "sessions",
        sa.Column("secret_sha256", sa.LargeBinary(), primary_key=True),
        sa.Column(
            "owner_id", sa.BigInteger(), sa.ForeignKey("owners.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("scope", sa.String(), nullable=False),
        sa.Column("key_id", sa.Uuid(), sa.ForeignKey("keys.id", ondelete="CASCADE")),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=now, nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("scope IN ('own', 'operate')", name="scope"),
    )
    op.create_index("ix_sessions_owner_id", "sessions", ["owner_id"])
    op.create_table(
        "login_links",
        sa.Column("secret_sha256", sa.LargeBinary(), primary_key=True),
        sa.Column("key_id", sa.Uuid(), sa.ForeignKey("keys.id", ondelete="CASCADE"), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=now, nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
    )
    for table in ("sessions", "login_links"):
        op.create_index(f"ix_{table}_key_id", table, ["key_id"])
    # Every process of the API keeps callers in memory until it is told that something of them changed.
    op.execute("""
        CREATE FUNCTION announce_access() RETURNS trigger LANGUAGE plpgsql AS
        $$ BEGIN PERFORM pg_notify('versant_access', ''); RETURN NULL; END $$
    """)
    for table, events in (
        ("keys", "UPDATE OF secret_sha256, scope, owner_id, expires_at, revoked_at OR DELETE"),
        ("sessions", "DELETE"),
    ):
        op.execute(
            f"CREATE TRIGGER announce_access AFTER {events} ON {table} "
            "FOR EACH STATEMENT EXECUTE FUNCTION announce_access()"
        )


def _of_one_owner() -> None:
    """The same log is the same drive for one owner; another's upload must not tell that it is there."""
    for column in ("sha256", "content_sha256"):
        op.drop_constraint(f"uq_drives_{column}", "drives", type_="unique")
        op.create_unique_constraint(f"uq_drives_owner_id_{column}", "drives", ["owner_id", column])
    op.create_index("ix_drives_owner_id_created_at_id", "drives", ["owner_id", "created_at", "id"])
    op.create_index("ix_exports_owner_id_created_at_id", "exports", ["owner_id", "created_at", "id"])
    op.execute("DROP INDEX uq_batches_enqueuing")
    op.execute("""
        CREATE UNIQUE INDEX uq_batches_enqueuing
        ON batches (owner_id, coalesce(drives_of, 0), selection, coalesce(method, ''))
        WHERE state = 'enqueuing'
    """)


def _count_drives(owner: str) -> None:
    """Count them by owner, or not: what others have is not told by a sum."""
    came = _ROWS.format(sign="+", table="came", owner=owner)
    went = _ROWS.format(sign="-", table="went", owner=owner)
    op.execute(f"""
        CREATE OR REPLACE FUNCTION count_drives() RETURNS trigger LANGUAGE plpgsql AS $$
        BEGIN
            IF TG_OP = 'INSERT' THEN {_COUNT.format(rows=came, owner=owner)};
            ELSIF TG_OP = 'DELETE' THEN {_COUNT.format(rows=went, owner=owner)};
            ELSE {_COUNT.format(rows=f"{came} UNION ALL {went}", owner=owner)};
            END IF;
            RETURN NULL;
        END $$
    """)


def _guard() -> None:
    """Row level security: for each role of a caller the rows that it sees and writes."""
    for table in OWNED:
        # A batch over the drives of all is an operator's, whoever its owner is.
        _let(table, f"{IS_OWNERS} AND drives_of = owner_id" if table == "batches" else IS_OWNERS)
    for table in OF_DRIVES:
        _let(table, OF_A_DRIVE)
    for table, condition in OTHERS.items():
        _let(table, condition)
    op.execute(f"CREATE POLICY versant_uploader ON drives TO versant_uploader USING ({IS_SENT})")
    for part in range(PARTS):  # they are reached through their table alone, whose policies then hold
        op.execute(f"ALTER TABLE drive_passes_of_{part} ENABLE ROW LEVEL SECURITY")


def _let(table: str, owners: str | None) -> None:
    op.execute(f"ALTER TABLE {table} ENABLE ROW LEVEL SECURITY")
    op.execute(f"CREATE POLICY versant_operator ON {table} TO versant_operator USING (true)")
    if owners is not None:
        op.execute(f"CREATE POLICY versant_owner ON {table} TO versant_owner USING ({owners})")


def downgrade() -> None:
    """Take back: everybody is shown everything again. Of a log that two owners sent both drives stay."""
    for table in (*OWNED, *OF_DRIVES, *OTHERS):
        op.execute(f"ALTER TABLE {table} DISABLE ROW LEVEL SECURITY")
        for (role,) in op.get_bind().execute(sa.text(_POLICIES), {"name": table}).all():
            op.execute(f"DROP POLICY {role} ON {table}")
    for part in range(PARTS):
        op.execute(f"ALTER TABLE drive_passes_of_{part} DISABLE ROW LEVEL SECURITY")
    _count_drives(owner="")
    _of_all_owners()
    op.drop_column("drives", "sent_by")
    op.drop_column("audit_log", "key_id")
    op.drop_column("batches", "drives_of")
    for table in OWNED:
        op.drop_column(table, "owner_id")
    for table in ("login_links", "sessions", "keys", "owners"):
        op.drop_table(table)
    for function in (
        "announce_access",
        "analyze_queue",
        "versant_confined_to",
        "versant_key",
        "versant_owner",
    ):
        op.execute(f"DROP FUNCTION {function}")


def _of_all_owners() -> None:
    op.execute("DROP INDEX uq_batches_enqueuing")
    op.execute(
        "UPDATE batches SET state = 'cancelled' WHERE state = 'enqueuing' AND (owner_id <> 1 OR drives_of <> 0)"
    )
    op.execute("""
        CREATE UNIQUE INDEX uq_batches_enqueuing ON batches (selection, coalesce(method, ''))
        WHERE state = 'enqueuing'
    """)
    op.drop_index("ix_exports_owner_id_created_at_id", "exports")
    op.drop_index("ix_drives_owner_id_created_at_id", "drives")
    for column in ("sha256", "content_sha256"):
        op.drop_constraint(f"uq_drives_owner_id_{column}", "drives", type_="unique")
    op.execute("""
        UPDATE drives AS d SET sha256 = d.sha256 || ' of ' || d.owner_id, content_sha256 = NULL
        WHERE EXISTS (SELECT FROM drives AS first WHERE first.owner_id < d.owner_id AND
                      (first.sha256 = d.sha256 OR first.content_sha256 = d.content_sha256))
    """)
    for column in ("sha256", "content_sha256"):
        op.create_unique_constraint(f"uq_drives_{column}", "drives", [column])
