"""What an edition tells: only what enough owners contribute to, and nothing of where trips end."""

from __future__ import annotations

import pytest
from sqlalchemy import text

from app.access import store as access
from processing_support import remove_drive
from release_support import LONG, MIDDLE, Public, public

__all__ = ["public"]

STREET = range(LONG)


def test_a_segment_is_told_when_enough_owners_drove_it(public: Public) -> None:
    for owner in range(4):
        public.drive(owner, STREET)
        public.drive(owner, STREET)  # once more is not one more owner
    first = public.release()
    assert (first.number, first.owners, first.owners_needed) == (1, 3, 5)
    assert public.served() == {}
    assert first.withheld_share == 1.0
    public.drive(4, STREET)
    second = public.release()
    served = public.served()
    assert set(MIDDLE) <= set(served)
    assert second.segments == len(served) and second.length_m > 0
    assert served[20][0] == pytest.approx(3.0, abs=0.1)


def test_ends_of_trips_are_in_no_edition(public: Public) -> None:
    for owner in range(7):
        public.drive(owner, STREET)
    public.release()
    served = public.served()
    # 150 m are two segments, whatever is drawn; five of seven owners have to have drawn less for more to be told.
    assert min(served) >= 2 and max(served) <= LONG - 3
    hidden = public.count("SELECT min(cardinality(hidden)) FROM told.examined")
    assert hidden >= 6


def test_what_stands_changes_only_with_enough_owners(public: Public) -> None:
    for owner in range(5):
        public.drive(owner, STREET, 3.0)
    public.release()
    before, told = public.served(), public.told()
    for owner in (5, 6, 0, 1):
        public.drive(owner, STREET, 3.4)
    public.release()
    # Nearer to the ends, where radii differ, these were the owners that were missing.
    assert [public.told()[row] for row in MIDDLE] == [told[row] for row in MIDDLE] == [5] * len(MIDDLE)
    assert public.served()[20] == pytest.approx(before[20], abs=1e-3)
    public.drive(2, STREET, 3.4)
    public.release()
    after = public.served()
    assert set(MIDDLE) <= set(after)
    assert after[20][0] > before[20][0] + 0.05
    assert after[20][2] == 10


def test_counts_are_told_in_buckets_and_no_share_is_told(public: Public) -> None:
    for owner in range(7):
        public.drive(owner, STREET)
    public.release()
    with public.sessions() as session:
        rows = session.execute(
            text("SELECT drives, observations, driven_share, updated_at FROM edition.segment_slopes")
        ).all()
    assert {row.drives for row in rows} <= {0, 5}
    assert {row.observations for row in rows} <= {0, 20}
    assert {row.driven_share for row in rows} == {None}
    assert {row.updated_at.isoformat()[:19] for row in rows} == {"2026-11-09T00:00:00"}


def test_a_removal_is_obeyed_by_the_next_edition(public: Public) -> None:
    drives = [public.drive(owner, STREET) for owner in range(6)]
    public.release()
    assert set(MIDDLE) <= set(public.served())
    remove_drive(public.sessions, public.blobs, drives[0])
    public.release()
    assert set(MIDDLE) <= set(public.served())
    remove_drive(public.sessions, public.blobs, drives[1])
    assert set(MIDDLE) <= set(public.served()), "an edition stays as it is"
    public.release()
    assert public.served() == {}
    assert public.count("SELECT count(*) FROM told.drive_passes") == 0


def test_what_lies_in_an_owners_zone_is_not_told_any_more(public: Public) -> None:
    for owner in range(5):
        public.drive(owner, STREET)
    public.release()
    assert 20 in public.served()
    with public.sessions.begin() as session:
        session.execute(
            text("""INSERT INTO owner_zones (owner_id, name, lon_deg, lat_deg, radius_m)
                    VALUES (:owner, 'garden', 8.5205, 49.0, 100)"""),
            {"owner": public.owners[0]},
        )
    public.release()
    served = public.served()
    assert 20 not in served
    assert {12, 28} <= set(served)


def test_who_hides_nobody_tells_everything_but_the_ends(public: Public) -> None:
    public.settings = public.settings.model_copy(update={"public_owners": 1})
    public.drive(0, STREET)
    assert public.release().owners_needed == 1
    assert set(MIDDLE) <= set(public.served())


def test_the_same_again_changes_nothing(public: Public) -> None:
    for owner in range(5):
        public.drive(owner, STREET)
    public.release()
    state = "SELECT md5(string_agg(CAST(t AS text), ',' ORDER BY id)) FROM edition.cells AS t"
    slopes = (
        "SELECT md5(string_agg(CAST(t AS text), ',' ORDER BY segment_id)) FROM edition.segment_slopes AS t"
    )
    with public.sessions() as session:
        before = [session.execute(text(query)).scalar() for query in (state, slopes)]
    again = public.release()
    assert again.number == 2
    with public.sessions() as session:
        assert [session.execute(text(query)).scalar() for query in (state, slopes)] == before


def test_an_owners_second_key_is_no_second_owner(public: Public) -> None:
    for owner in range(4):
        public.drive(owner, STREET)
    with public.sessions.begin() as session:
        access.create_key(session, public.owners[3], "another", "upload")
    public.drive(3, STREET)
    public.release()
    assert public.served() == {}
