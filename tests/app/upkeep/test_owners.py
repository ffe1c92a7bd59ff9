"""Owners and keys in a backup: they come back, on a server that knows no roles; who was logged in does not."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from sqlalchemy import text

from access_support import Keyed
from app.access import store
from app.core.caller import ROLES, Caller, as_caller, guard
from app.core.db import make_engine, session_factory
from app.core.settings import Settings
from app.drives.store import list_drives
from app.embedded.cluster import EmbeddedPostgres
from app.upkeep import doctor
from app.upkeep import restore as bringing_back
from app.upkeep import store as upkeep
from app.upkeep.backup import back_up
from processing_support import HEADER
from web_fixtures import Web


@pytest.fixture
def strange(tmp_path: Path) -> Iterator[Settings]:
    """A server of its own with an empty database: nobody has made roles there."""
    with tempfile.TemporaryDirectory(prefix="versant-test-") as folder:
        server = EmbeddedPostgres(Path(folder), durable=False)
        server.start()
        yield Settings(database_url=server.url, data_dir=tmp_path / "restored", access="keys")
        server.stop()


def test_keys_and_owners_come_back_to_a_server_without_roles(
    keyed: Keyed,
    strange: Settings,
    tmp_path: Path,
    server_maker: Callable[[Settings], AbstractContextManager[Web]],
) -> None:
    mine = keyed.a.own.post("/v1/drives", content=HEADER).json()["id"]
    theirs = keyed.b.own.post("/v1/drives", content=HEADER).json()["id"]
    login = keyed.web.client.post("/v1/session", json={"key": keyed.a.own.secret})
    assert login.status_code == 200
    with keyed.web.sessions.begin() as session:
        store.create_link(session, keyed.a.own.key_id)
    manifest = back_up(keyed.web.settings, keyed.web.sessions, tmp_path / "copy")

    engine = make_engine(str(strange.database_url))
    sessions = session_factory(engine)
    with sessions() as session:
        assert upkeep.lacking_roles(session) is None
    bringing_back.restore(strange, sessions, tmp_path / "copy", manifest)
    with sessions() as session:
        assert upkeep.lacking_roles(session) == []
        for table, rows in (("sessions", 0), ("login_links", 0), ("owners", 3), ("keys", 6)):
            assert session.execute(text(f"SELECT count(*) FROM {table}")).scalar_one() == rows, table
        # Dumps hold no rights: who may call what looks into ``told`` is said anew.
        may_call = text(
            "SELECT has_function_privilege(CAST(:role AS name), 'versant_places(bigint)', 'EXECUTE')"
        )
        callers = {role for role in ROLES.values() if session.execute(may_call, {"role": role}).scalar_one()}
        assert callers == {ROLES["own"], ROLES["operate"]}
    with server_maker(strange) as web:
        for holder, drive in ((keyed.a.own, mine), (keyed.b.own, theirs)):
            sent = {"Authorization": f"Bearer {holder.secret}"}
            assert [one["id"] for one in web.client.get("/v1/drives", headers=sent).json()["drives"]] == [
                drive
            ]
        cookie = f"versant-{web.client.base_url.port}={next(iter(login.cookies.values()))}"
        assert web.client.get("/v1/drives", headers={"Cookie": cookie}).status_code == 401
    engine.dispose()


def test_the_doctor_finds_that_callers_are_not_told_apart(database_url: str, tmp_path: Path) -> None:
    settings = Settings(database_url=database_url, data_dir=tmp_path)
    engine = make_engine(database_url)
    sessions = session_factory(engine)

    def found() -> tuple[str, str]:
        findings = doctor.examine(doctor.Patient(settings, sessions))
        (one,) = [one for one in findings if one.subject == "roles"]
        return one.state, one.found

    assert found()[0] == "ok"
    with sessions.begin() as session:
        session.execute(text("REVOKE SELECT ON segments FROM versant_api"))
    state, words = found()
    assert state == "fail" and "versant_owner" in words
    with sessions.begin() as session:
        session.execute(text("GRANT SELECT ON segments TO versant_api"))
        session.execute(text("ALTER TABLE drive_tracks DISABLE ROW LEVEL SECURITY"))
    assert found() == (
        "fail",
        "The database does not tell callers apart, or cannot act as they do: see to drive_tracks.",
    )
    engine.dispose()


def test_nobody_s_transactions_see_nothing(keyed: Keyed) -> None:
    keyed.a.own.post("/v1/drives", content=HEADER)
    engine = guard(make_engine(str(keyed.web.settings.database_url)))
    for caller, drives in ((Caller(), 0), (Caller("own", keyed.a.id), 1), (Caller("own", keyed.b.id), 0)):
        with as_caller(caller), session_factory(engine)() as session:
            assert len(list_drives(session)) == drives
    engine.dispose()
