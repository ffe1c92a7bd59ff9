"""Row level security: what the database shows to each role of a caller, whatever a route forgets to ask."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from dataclasses import replace

import pytest
from sqlalchemy import Engine, inspect, text
from sqlalchemy.exc import ProgrammingError

from access_support import Keyed, Things
from app.core.caller import NOBODY, OPERATOR_OWNER, ROLES, Caller, Scope, as_caller, guard
from app.core.db import Sessions, make_engine
from app.core.tables import Base

OF_DRIVES_FOR_ALL = {"network_marks"}
"""Tables that name drives and are not secret of their owners: which cells are to be solved anew, read by the operator's
pages and in the documents of drives that are seen anyway."""
_SECURED = text("SELECT relname FROM pg_class WHERE relrowsecurity")


@pytest.fixture
def engine(shared: tuple[Keyed, dict[str, Things]]) -> Iterator[Engine]:
    """As the API's: each transaction is the present caller's."""
    engine = guard(make_engine(str(shared[0].web.settings.database_url)))
    yield engine
    engine.dispose()


def counted(engine: Engine, caller: Caller) -> dict[str, int]:
    """Rows of each table with row level security, as the caller sees them."""
    with as_caller(caller), engine.connect() as connection:
        tables = sorted(connection.execute(_SECURED).scalars())
        return {
            name: connection.execute(text(f"SELECT count(*) FROM {name}")).scalar_one() for name in tables
        }


def test_every_table_of_an_owner_is_secured(sessions: Sessions) -> None:
    with sessions() as session:
        secured = set(session.execute(_SECURED).scalars())
        tables = inspect(session.connection())
        owned = {
            name
            for name in Base.metadata.tables
            if {"owner_id", "drive_id", "key_id", "webhook_id"}
            & {c["name"] for c in tables.get_columns(name)}
        }
    assert owned - secured == OF_DRIVES_FOR_ALL


def test_nobody_sees_no_row_of_an_owner(engine: Engine) -> None:
    assert set(counted(engine, NOBODY).values()) == {0}


def test_an_owner_sees_what_is_its_own_and_changes_nothing_else(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine
) -> None:
    guarded, things = shared
    mine = {name: counted(engine, Caller("own", guarded.owners[name])) for name in things}
    everything = counted(engine, Caller("operate", OPERATOR_OWNER))
    assert mine["anna"]["drives"] == mine["ben"]["drives"] == 1
    for table in (
        "drive_segments",
        "drive_tracks",
        "drive_trials",
        "exports",
        "webhooks",
        "keys",
    ):
        assert mine["anna"][table] >= 1, table
        assert mine["anna"][table] + mine["ben"][table] <= everything[table], table
    assert mine["anna"]["owners"] == 1
    assert mine["anna"]["operations"] == 0
    theirs = {"id": things["ben"].ids["drive_id"]}
    with as_caller(Caller("own", guarded.owners["anna"])), engine.begin() as connection:
        for statement in (
            "UPDATE drives SET filename = 'x' WHERE id = :id",
            "DELETE FROM drives WHERE id = :id",
            "DELETE FROM drive_segments WHERE drive_id = :id",
            "DELETE FROM drive_tracks WHERE drive_id = :id",
        ):
            assert connection.execute(text(statement), theirs).rowcount == 0, statement


def test_an_owner_cannot_give_a_row_to_another(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine
) -> None:
    guarded, _ = shared
    give = text("UPDATE drives SET owner_id = :ben")
    with (
        as_caller(Caller("own", guarded.owners["anna"])),
        engine.connect() as connection,
        pytest.raises(ProgrammingError, match="row-level security"),
    ):
        connection.execute(give, {"ben": guarded.owners["ben"]})


def test_a_key_that_uploads_sees_what_it_sent(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine
) -> None:
    guarded, _ = shared
    sender = Caller("upload", guarded.owners["anna"], guarded.ids["anna upload"])
    seen = counted(engine, sender)
    assert seen.pop("drives") == 1
    assert set(seen.values()) == {0}
    other = Caller("upload", guarded.owners["anna"], uuid.uuid4())
    assert set(counted(engine, other).values()) == {0}


def test_partitions_of_passes_are_reached_through_their_table_alone(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine
) -> None:
    with as_caller(Caller("own", shared[0].owners["anna"])), engine.connect() as connection:
        parts = text("SELECT relname FROM pg_class WHERE relname LIKE 'drive_passes_of_%' AND relkind = 'r'")
        names = list(connection.execute(parts).scalars())
        assert len(names) == 16
        assert not any(connection.execute(text(f"SELECT count(*) FROM {n}")).scalar_one() for n in names)


def test_the_roles_own_no_table(engine: Engine) -> None:
    with engine.connect() as connection:
        owned = text("SELECT count(*) FROM pg_tables WHERE tableowner = ANY(:roles)")
        assert connection.execute(owned, {"roles": list(ROLES.values())}).scalar_one() == 0


_ADD_PLACE = text(
    "INSERT INTO told.places (owner_id, lon_deg, lat_deg, radius_m) VALUES (:owner, 8, 49, 200)"
)
_PLACES = text("SELECT count(*) FROM versant_places(:owner)")
_SHARE = text("SELECT versant_place_share(:owner, 8.4012, 49.0012)")


def test_an_owner_is_told_of_its_places_by_a_function_alone(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine
) -> None:
    """The roles may not look into ``told``, where the places of all are."""
    guarded, _ = shared
    anna, ben = ({"owner": guarded.owners[name]} for name in ("anna", "ben"))
    with guarded.web.sessions.begin() as session:
        session.execute(_ADD_PLACE, anna)
        drawn = session.execute(_SHARE, anna).scalar_one()  # as an edition draws
    assert 0 <= drawn < 1
    for caller, places in (
        (Caller("own", anna["owner"]), (1, 0)),
        (Caller("own", ben["owner"]), (0, 0)),
        (Caller("operate", OPERATOR_OWNER), (1, 0)),
    ):
        with as_caller(caller), engine.connect() as connection:
            assert tuple(connection.execute(_PLACES, one).scalar_one() for one in (anna, ben)) == places
            may_ask = caller.scope == "operate" or caller.owner_id == anna["owner"]
            assert connection.execute(_SHARE, anna).scalar() == (drawn if may_ask else None)
    sender = Caller("upload", anna["owner"], guarded.ids["anna upload"])
    for caller in (NOBODY, replace(NOBODY, sees="edition"), sender):
        for query in (_PLACES, _SHARE):
            with (
                as_caller(caller),
                engine.connect() as connection,
                pytest.raises(ProgrammingError, match="denied"),
            ):
                connection.execute(query, anna)


@pytest.mark.parametrize("table", ["places", "standing", "examined"])
@pytest.mark.parametrize("scope", ["nobody", "upload", "own", "operate"])
def test_no_role_looks_into_what_is_told(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine, scope: Scope, table: str
) -> None:
    caller = Caller(scope, shared[0].owners["anna"])
    with (
        as_caller(caller),
        engine.connect() as connection,
        pytest.raises(ProgrammingError, match="permission"),
    ):
        connection.execute(text(f"SELECT count(*) FROM told.{table}"))


def test_a_transaction_after_another_callers_is_its_own(
    shared: tuple[Keyed, dict[str, Things]], engine: Engine
) -> None:
    """Connections are shared: what one transaction was allowed ends with it."""
    guarded, _ = shared
    query = text("SELECT current_user, current_setting('versant.owner', true), (SELECT count(*) FROM drives)")
    with engine.connect() as connection:
        for caller, drives in (
            (Caller("operate", 1), 2),
            (NOBODY, 0),
            (Caller("own", guarded.owners["ben"]), 1),
        ):
            with as_caller(caller):
                user, owner, seen = connection.execute(query).one()
                connection.rollback()
            assert (user, owner, seen) == (ROLES[caller.scope], str(caller.owner_id or ""), drives)
