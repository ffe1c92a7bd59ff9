"""How editions are made: the copies of tables, one at a time, in time, by an operation, and after roads changed."""

from __future__ import annotations

import uuid
from contextlib import nullcontext
from datetime import timedelta

import pytest
from sqlalchemy import inspect, text

from app.drives.worker import _release_when_due
from app.jobs.context import JobContext
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.network.locks import releasing_alone
from app.operations import store as operations
from app.operations.documents import Kind
from app.operations.run import OPERATION
from app.releases import run
from app.releases.serving import buckets
from processing_support import remove_drive
from release_support import LONG, MIDDLE, Public, public, street_with_junctions
from road_support import replace_roads

__all__ = ["public"]

STREET = range(LONG)
OWN_TABLES = {"drives", "places", "examined", "standing"}
"""Of ``told``: what has no table of the same columns among the live ones."""


@pytest.mark.parametrize("schema", ["told", "edition"])
def test_copies_have_the_columns_of_their_tables(public: Public, schema: str) -> None:
    """Whoever changes a table in a migration changes its copies there too."""
    with public.sessions() as session:
        tables = inspect(session.connection())
        copies = set(tables.get_table_names(schema=schema)) - OWN_TABLES
        assert copies >= {"segment_slopes", "cells"}
        for name in copies:
            columns = [
                {(c["name"], str(c["type"]), c["nullable"]) for c in tables.get_columns(name, schema=of)}
                for of in (schema, "public")
            ]
            assert columns[0] == columns[1], name


def test_counts_are_told_in_steps() -> None:
    assert buckets(5)[:6] == [5, 10, 20, 50, 100, 200]
    assert buckets(3)[:4] == [3, 5, 10, 20]
    assert buckets(1)[:4] == [1, 2, 5, 10]
    assert max(buckets(3)) < 2**31


def test_one_edition_at_a_time(public: Public) -> None:
    with releasing_alone(public.sessions) as alone:
        assert alone is not None
        with pytest.raises(run.BusyReleaseError, match="just now"):
            public.release()
    assert public.release().number == 1


def test_an_edition_that_broke_off_is_made_up_for(public: Public, monkeypatch: pytest.MonkeyPatch) -> None:
    for owner in range(5):
        public.drive(owner, STREET)
    with monkeypatch.context() as patch:
        patch.setattr(run, "solve", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            public.release()
    assert public.served() == {}
    assert public.release().number == 1
    assert set(MIDDLE) <= set(public.served())


def test_workers_ask_for_an_edition_when_it_is_due(public: Public) -> None:
    for owner in range(5):
        public.drive(owner, STREET)
    context = JobContext(public.settings, public.sessions)
    for _ in range(3):  # three workers look
        _release_when_due(context)
    with public.sessions() as session:
        asked = session.execute(text("SELECT id FROM operations WHERE kind = 'release'")).scalars().all()
    assert len(asked) == 1
    assert perform(OPERATION, context, asked[0], Work(bool, nullcontext)) == "done"
    assert set(MIDDLE) <= set(public.served())
    assert not run.is_due(public.sessions, public.settings)
    _release_when_due(context)
    assert public.count("SELECT count(*) FROM operations") == 1
    result = public.count("SELECT CAST(result ->> 'number' AS integer) FROM operations")
    assert result == 1


def test_one_that_was_asked_for_in_time_and_comes_late_makes_none(public: Public) -> None:
    context = JobContext(public.settings, public.sessions)
    _release_when_due(context)
    public.day = run.today() - timedelta(days=7)
    public.release()
    number = uuid.UUID(str(_of_operation(public)))
    assert perform(OPERATION, context, number, Work(bool, nullcontext)) == "done"
    assert public.count("SELECT count(*) FROM editions") == 1
    with public.sessions.begin() as session:
        asked, _ = operations.ask(session, kind=Kind.RELEASE, request={}, kept_bytes=1, subject="map")
    assert perform(OPERATION, context, asked.id, Work(bool, nullcontext)) == "done"
    assert public.count("SELECT count(*) FROM editions") == 2


def test_files_of_an_edition_whose_maker_was_cut_off_are_written_later(
    public: Public, monkeypatch: pytest.MonkeyPatch
) -> None:
    for owner in range(5):
        public.drive(owner, STREET)
    public.day = run.today() - timedelta(days=7)
    with monkeypatch.context() as patch:
        patch.setattr(run, "publish_files", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            public.release()
    assert set(MIDDLE) <= set(public.served())
    assert run.lacks_files(public.sessions, public.settings)
    context = JobContext(public.settings, public.sessions)
    _release_when_due(context)
    number = uuid.UUID(str(_of_operation(public)))
    assert perform(OPERATION, context, number, Work(bool, nullcontext)) == "done"
    assert not run.lacks_files(public.sessions, public.settings)
    assert public.count("SELECT count(*) FROM editions") == 1
    _release_when_due(context)
    assert public.count("SELECT count(*) FROM operations") == 1


def _of_operation(public: Public) -> object:
    with public.sessions() as session:
        return session.execute(text("SELECT id FROM operations")).scalar_one()


def test_where_there_are_no_editions_nothing_of_what_was_removed_is_kept(public: Public) -> None:
    drives = [public.drive(owner, STREET) for owner in range(5)]
    public.release()
    elsewhere = public.settings.model_copy(update={"public_map": "off"})
    assert not run.forget_where_removed(public.sessions, elsewhere)
    assert set(MIDDLE) <= set(public.served())
    remove_drive(public.sessions, public.blobs, drives[0])
    assert not run.forget_where_removed(public.sessions, public.settings), "the next edition does it"
    live = "SELECT count(*) FROM segment_changes WHERE xid > {}"
    before = public.count("SELECT max(xid) FROM segment_changes")
    epoch = "SELECT count(*) FROM tile_epoch WHERE md5(epoch) = '{}'"
    with public.sessions() as session:
        known = session.execute(text("SELECT md5(epoch) FROM tile_epoch")).scalar_one()
    assert run.forget_where_removed(public.sessions, elsewhere)
    assert public.count(live.format(before)) == 0, "the live map stays as it is"
    assert public.count(epoch.format(known)) == 1
    assert public.served() == {} and public.count("SELECT count(*) FROM told.places") == 0
    assert public.release().number == 1
    assert public.count("SELECT count(*) FROM edition.ways") > 0


def test_roads_that_changed_are_followed_by_the_next_edition(public: Public) -> None:
    for owner in range(5):
        public.drive(owner, STREET)
    public.release()
    ways = public.count("SELECT count(*) FROM edition.ways")
    kept = street_with_junctions()
    with public.sessions.begin() as session:
        replace_roads(session, kept.subset(kept.osm_way_id != 120), "street.osm", "1" * 64)
    public.release()
    assert public.count("SELECT count(*) FROM edition.ways") == ways - 1
    assert set(MIDDLE) <= set(public.served())


def test_a_drive_that_is_computed_again_is_told_again_with_others(public: Public) -> None:
    """A new result of one drive is a change by one owner."""
    for owner in range(5):
        public.drive(owner, STREET)
    public.release()
    before = public.served()
    with public.sessions.begin() as session:
        session.execute(
            text("""UPDATE drive_passes SET id = nextval('drive_passes_id_seq')
                    WHERE drive_id = (SELECT min(CAST(id AS text)) FROM drives)::uuid""")
        )
    public.release()
    assert public.served() == before
    new = "SELECT count(*) FROM told.drive_passes AS t JOIN drive_passes AS p ON p.id = t.id"
    told = public.count("SELECT count(*) FROM told.drive_passes")
    assert 0 < public.count(new) < told
    with public.sessions.begin() as session:
        session.execute(text("UPDATE drive_passes SET id = nextval('drive_passes_id_seq')"))
    public.release()
    assert public.count(new) == told
    assert public.served()[20] == pytest.approx(before[20])
