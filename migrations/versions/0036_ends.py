"""The places of an owner's trips for who may see them: two functions that look into ``told`` for the API's roles.

An owner may have the ends of his trips left out of a file of a drive. The radius around a place has to be the one of
editions then: two files with different ones would give the place away. So editions draw by the same function. It draws
by the neighbourhood and not by the very place, so that a file that is made before the first edition and one that is
made after it agree wherever the owner stopped within it. Places that are kept already keep their radius.

The roles may still not look into ``told``: the functions run as who made them, answer an owner what is his own, and
write nothing. Who may call them is said again after a restore, for dumps hold no rights (``app.core.schema``). Adds
only: programs of the revision before draw by the very place.
"""

from alembic import op

revision = "0036"
down_revision = "0035"
branch_labels = None
depends_on = None

oldest_program = down_revision

# Within the functions ``current_user`` is who made them: an owner by the setting of row level security, an operator,
# and whoever may become that user, as workers and commands may.
MAY_ASK = """
    CASE current_setting('role')
        WHEN 'versant_operator' THEN true
        WHEN 'versant_owner' THEN of_owner = nullif(current_setting('versant.owner', true), '')::bigint
        ELSE pg_has_role(coalesce(nullif(current_setting('role'), 'none')::name, session_user), current_user, 'USAGE')
    END
"""
GUARDED = "LANGUAGE sql STABLE SECURITY DEFINER SET search_path = pg_catalog, pg_temp"
NEIGHBOURHOOD_DEG = 0.01
"""Sides of the cells in each of which an owner has one radius."""

PLACES = f"""
    CREATE FUNCTION versant_places(of_owner bigint)
    RETURNS TABLE (id bigint, lon_deg float8, lat_deg float8, radius_m float8) {GUARDED} AS $$
        SELECT p.id, p.lon_deg, p.lat_deg, p.radius_m FROM told.places AS p WHERE p.owner_id = of_owner AND {MAY_ASK}
    $$
"""  # noqa: S608 - constants
# A keyed hash of owner and neighbourhood, twice, so that nobody can go on with it; six of its bytes are a share of 1.
SHARE = f"""
    CREATE FUNCTION versant_place_share(of_owner bigint, lon_deg float8, lat_deg float8)
    RETURNS float8 {GUARDED} AS $$
        SELECT ('x' || encode(substring(sha256(s.secret || sha256(s.secret || n.name)) FROM 1 FOR 6), 'hex'))
            ::bit(48)::bigint / 281474976710656.0::float8
        FROM told.standing AS s, (SELECT convert_to(concat_ws(' ', of_owner,
            floor(lon_deg / {NEIGHBOURHOOD_DEG})::bigint, floor(lat_deg / {NEIGHBOURHOOD_DEG})::bigint), 'UTF8') AS name
        ) AS n
        WHERE {MAY_ASK}
    $$
"""  # noqa: S608 - constants


def upgrade() -> None:
    """Apply."""
    op.execute(PLACES)
    op.execute(SHARE)


def downgrade() -> None:
    """Take back: no file leaves out the ends of a trip. Places that are kept stay."""
    op.execute("DROP FUNCTION versant_place_share")
    op.execute("DROP FUNCTION versant_places")
