"""Moments and versions: what of the changes is told up to where, and whose numbers they are."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import text

from app.changes import store
from app.changes.store import LOOKED_AT, Since, count_since, page_since, prune
from app.core.db import Sessions, make_engine, session_factory
from app.core.errors import BadQueryError, GoneError, NotReadyError
from app.embedded.cluster import EmbeddedPostgres
from app.map.derived.following import follow_all

TURN = text("UPDATE segments SET name = :name WHERE id = ANY(:ids)")


def change(sessions: Sessions, *ids: int, name: str = "x") -> None:
    with sessions.begin() as session:
        session.execute(TURN, {"ids": list(ids), "name": f"{name}{datetime.now(UTC)}"})


def here(sessions: Sessions) -> Since:
    with sessions() as session:
        now = store.state(session)
        return Since(now.epoch, now.horizon)


def since(sessions: Sessions, place: Since, limit: int = 1000, **where: Any) -> list[int]:
    with sessions() as session:
        return [one.id for one in page_since(session, store.state(session), place, limit, **where).changes]


def test_a_database_begins_its_epoch_at_the_first_question_and_keeps_it(mapped: Sessions) -> None:
    first = here(mapped)
    assert here(mapped) == first
    assert not store.begin_epoch(mapped)


def test_the_horizon_stays_until_a_segment_changes(mapped: Sessions) -> None:
    first = here(mapped)
    with mapped.begin() as session:
        session.execute(text("INSERT INTO cells (id) VALUES (1)"))
    assert here(mapped) == first
    change(mapped, 1)
    assert here(mapped).xid > first.xid
    assert since(mapped, first) == [1]
    assert since(mapped, here(mapped)) == []


def test_nothing_is_missed_when_a_later_transaction_ends_first(mapped: Sessions) -> None:
    first = here(mapped)
    with mapped.begin() as slow:
        slow.execute(TURN, {"ids": [1], "name": "slow"})
        change(mapped, 2)
        change(mapped, 3)
        between = here(mapped)
        assert between.xid <= first.xid
        assert since(mapped, first) == []
    assert since(mapped, first) == [1, 2, 3]
    assert since(mapped, between) == [1, 2, 3]


def test_what_is_taken_back_is_not_told(mapped: Sessions) -> None:
    first = here(mapped)
    with mapped() as session:
        session.execute(TURN, {"ids": [1], "name": "never"})
        session.rollback()
    change(mapped, 2)
    assert since(mapped, first) == [2]


@pytest.mark.parametrize("limit", [1, 2, 3, 100])
def test_pages_reach_each_segment_once_also_within_one_transaction(mapped: Sessions, limit: int) -> None:
    place, seen = here(mapped), list[int]()
    change(mapped, 5, 6, 7, 8)
    change(mapped, 1, 2)
    change(mapped, 6)
    with mapped() as session:
        now = store.state(session)
        for _ in range(8):
            page = page_since(session, now, place, limit)
            seen += [one.id for one in page.changes]
            place = store.parse_since(now, store.text_of(page.until))
            if not page.more:
                break
    assert seen == [5, 7, 8, 1, 2, 6]
    assert place == here(mapped)


def test_a_part_of_the_map_is_told_of_what_is_there_and_of_what_has_left_it(mapped: Sessions) -> None:
    first = here(mapped)
    with mapped.begin() as session:
        session.execute(text("UPDATE segments SET geom = ST_Translate(geom, 0, 20) WHERE id = 4"))
        session.execute(text("DELETE FROM segments WHERE id = 20"))
        session.execute(TURN, {"ids": [1, 113, 114, 115], "name": "here and at the antimeridian"})
    everywhere = since(mapped, first)
    assert everywhere == [1, 4, 20, 113, 114, 115]
    assert since(mapped, first, bbox=(8.0, 48.0, 9.0, 50.0)) == [1, 4, 20]
    assert since(mapped, first, bbox=(8.0, 68.0, 9.0, 70.0)) == [4]
    assert since(mapped, first, bbox=(179.0, -18.0, -179.0, -16.0)) == [113, 114, 115]
    assert since(mapped, first, bbox=(0.0, 0.0, 1.0, 1.0)) == []
    with mapped() as session:
        now = store.state(session)
        assert count_since(session, now, first, 100, (8.0, 48.0, 9.0, 50.0)) == (3, 1, True)
        assert count_since(session, now, first, 2, None) == (2, 0, False)


def test_a_request_for_a_part_looks_at_so_many_changes_and_leads_on(
    mapped: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert LOOKED_AT >= 10_000
    monkeypatch.setattr("app.changes.store.LOOKED_AT", 3)
    first = here(mapped)
    change(mapped, 1, 2, 3, 4)
    with mapped() as session:
        now = store.state(session)
        page = page_since(session, now, first, 10, (0.0, 0.0, 1.0, 1.0))
        assert (page.changes, page.more, page.until.segment_id) == ([], True, 3)
        page = page_since(session, now, page.until, 10, (0.0, 0.0, 1.0, 1.0))
        assert (page.changes, page.more, page.until) == ([], False, Since(now.epoch, now.horizon))


def test_the_sql_of_changed_since_is_what_pages_say_but_for_what_is_gone(mapped: Sessions) -> None:
    query = text(f"SELECT s.id FROM segments AS s WHERE {store.changed_since_sql('s')} ORDER BY s.id")
    first = here(mapped)
    change(mapped, 2, 3)
    with mapped.begin() as session:
        session.execute(text("DELETE FROM segments WHERE id = 30"))
        moment = session.execute(text("SELECT clock_timestamp()")).scalar_one()
    change(mapped, 8)
    with mapped() as session:
        until = store.horizon(session)

        def changed(**since: Any) -> list[int]:
            values = {"since_xid": None, "since_time": None, "until_xid": until, **since}
            return list(session.execute(query, values).scalars())

        assert changed(since_xid=first.xid) == [2, 3, 8]
        assert changed(since_xid=first.xid, until_xid=first.xid) == []
        assert changed(since_time=moment) == [8]
        assert changed(since_time=moment - timedelta(hours=1), since_xid=first.xid) == [2, 3, 8]
        assert changed(since_time=moment + timedelta(hours=1)) == []
        assert len(changed()) > 100


def test_versions_are_texts_and_other_texts_are_none(mapped: Sessions) -> None:
    with mapped() as session:
        now = store.state(session)
        written = store.version_text(session, now.horizon)
        assert store.parse_version(session, written) == now.horizon
        for place in (Since(now.epoch, 0), Since(now.epoch, now.horizon, 17)):
            assert store.parse_since(now, store.text_of(place)) == place
        for wrong in (
            "",
            "5",
            "x" * 500,
            f"{written} ",
            f"{written}.",
            f"{now.epoch}-\u0663",
            f"{now.epoch}-{10**19}",
        ):
            with pytest.raises(BadQueryError, match="no version"):
                store.parse_since(now, wrong)
        other = "a" * 10 if now.epoch != "a" * 10 else "b" * 10
        for gone in (f"{other}-5", f"{now.epoch}-{now.next_xid + 1}"):
            with pytest.raises(GoneError, match="another database"):
                store.parse_since(now, gone)


def test_what_went_long_ago_is_told_no_more_and_who_would_miss_it_begins_anew(
    mapped: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "PRUNED_AT_ONCE", 1)
    first = here(mapped)
    with mapped.begin() as session:
        session.execute(text("DELETE FROM segments WHERE id = 40"))
        session.execute(text("UPDATE segments SET geom = ST_Translate(geom, 1, 0) WHERE id = 41"))
    later = here(mapped)
    assert prune(mapped, 1) == 0
    with mapped.begin() as session:
        old = text(
            "UPDATE segment_changes SET changed_at = now() - interval '2 days' WHERE segment_id IN (40, 41)"
        )
        session.execute(old)
    assert prune(mapped, 1) == 0, "what is derived from segments has not followed yet"
    follow_all(mapped)
    assert prune(mapped, 1) == 2
    assert prune(mapped, 1) == 0
    with mapped() as session:
        now = store.state(session)
        assert now.epoch == first.epoch
        with pytest.raises(GoneError, match="CHANGES_KEPT_DAYS"):
            store.parse_since(now, store.text_of(first))
        assert store.parse_since(now, store.text_of(later)) == later
    assert since(mapped, first) == [41]
    assert since(mapped, first, bbox=(8.0, 48.0, 9.0, 50.0)) == []


def rewritten(sessions: Sessions) -> None:
    """What a dump does to a table: other transactions write the same rows."""
    with sessions.begin() as session:
        session.execute(text("CREATE TEMP TABLE dumped ON COMMIT DROP AS TABLE change_epoch"))
        session.execute(text("DELETE FROM change_epoch"))
        session.execute(text("INSERT INTO change_epoch SELECT * FROM dumped"))


def moved(sessions: Sessions) -> None:
    """As if another server, or another time of this one, had written it."""
    with sessions.begin() as session:
        session.execute(text("UPDATE change_epoch SET place = 'elsewhere', xid = versant_xid()"))


@pytest.mark.parametrize("happens", [rewritten, moved])
def test_numbers_of_another_server_are_put_before_all_others(
    mapped: Sessions, happens: Callable[[Sessions], None]
) -> None:
    first = here(mapped)
    change(mapped, 1)
    happens(mapped)
    ahead = 10**12
    with mapped.begin() as session:
        session.execute(text("UPDATE segment_changes SET xid = :x WHERE segment_id < 10"), {"x": ahead})
        session.execute(text("INSERT INTO cells (id) VALUES (77) ON CONFLICT DO NOTHING"))
        session.execute(text("UPDATE cells SET changed_xid = :x WHERE id = 77"), {"x": ahead})
    now = here(mapped)
    assert now.epoch != first.epoch
    assert since(mapped, now) == []
    change(mapped, 9)
    assert since(mapped, now) == [9]
    assert here(mapped).epoch == now.epoch
    with mapped() as session:
        assert session.execute(text("SELECT changed_xid FROM cells WHERE id = 77")).scalar_one() == 0
        with pytest.raises(GoneError):
            store.parse_since(store.state(session), store.text_of(first))


def test_much_that_is_to_be_numbered_anew_is_left_to_a_worker(
    mapped: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = here(mapped)
    moved(mapped)
    with mapped.begin() as session:
        session.execute(text("UPDATE segment_changes SET xid = 1000000000000"))
    monkeypatch.setattr(store, "MOST_AT_ONCE", 20)
    with pytest.raises(NotReadyError, match="worker"):
        here(mapped)
    assert store.begin_epoch(mapped)
    assert here(mapped).epoch != first.epoch


def test_a_copy_of_a_database_has_an_epoch_of_its_own(
    cluster: EmbeddedPostgres, template_db: str, new_database: Callable[[str], str]
) -> None:
    epochs, name = set[str](), template_db
    for _ in range(3):
        name = new_database(name)
        engine = make_engine(cluster.url_of(name))
        epochs.add(here(session_factory(engine)).epoch)
        engine.dispose()
    assert len(epochs) == 3


def test_rows_that_are_frozen_and_tables_that_are_written_anew_keep_the_epoch(mapped: Sessions) -> None:
    first = here(mapped)
    with mapped() as session:
        session.connection(execution_options={"isolation_level": "AUTOCOMMIT"})
        session.execute(text("VACUUM (FREEZE) change_epoch"))
        session.execute(text("VACUUM (FULL) change_epoch"))
    assert here(mapped) == first


def test_who_may_do_little_may_ask(mapped: Sessions) -> None:
    """The service's role need not be a superuser, nor a member of those who watch."""
    expected = here(mapped)
    with mapped() as session:
        session.execute(text("CREATE ROLE versant_plain"))
        session.execute(text("GRANT SELECT ON ALL TABLES IN SCHEMA public TO versant_plain"))
        session.execute(text("SET LOCAL ROLE versant_plain"))
        now = store.state(session)
        assert Since(now.epoch, now.horizon) == expected
        session.rollback()
