"""Several lanes draw at once: each another tile, none twice for nothing, and none is left out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.map.derived import following, waiting
from app.map.derived.drawing import BLOCK, FINEST, children, parent
from app.map.derived.waiting import Unit
from app.network import locks
from derived_support import add_segment, derived, from_scratch, ids_of, measure
from fusion.types import Ints

LONG_S = following.LONG_S


@pytest.fixture
def streets(sessions: Sessions, segment_ids: Ints) -> Sessions:
    """Roads in several blocks, none of which is followed yet."""
    for way, node in enumerate(range(0, 240, 16)):
        for k in range(0, 14, 2):
            add_segment(sessions, 20 + way, node + k, node + k + 2)
    return sessions


@pytest.fixture
def to_draw(streets: Sessions) -> Sessions:
    """Their changes are followed, and no tile is drawn."""
    following.follow(streets, 0.0)
    with streets() as session:
        assert not following.look(session, LONG_S).changes
        assert len(waiting.next_units(session, LONG_S, 64)) > 2
    return streets


def units(sessions: Sessions) -> list[Unit]:
    with sessions() as session:
        return waiting.next_units(session, LONG_S, 64)


def test_who_does_not_lead_draws_and_follows_no_changes(to_draw: Sessions) -> None:
    with locks.deriving_claim(to_draw) as leader:
        assert leader.take()
        assert not following.follow(to_draw, 60.0)
        assert units(to_draw) == []
        pieces = derived(to_draw)
        measure(to_draw, ids_of(to_draw)[0], 3.0)
        assert not following.follow(to_draw, 60.0)
        assert derived(to_draw) == pieces
    with to_draw.begin() as session:
        session.execute(text("DELETE FROM segment_slopes"))  # what nobody followed
    assert pieces == from_scratch(to_draw)


def test_a_tile_that_somebody_draws_is_left_to_him(to_draw: Sessions) -> None:
    first, second, *_ = units(to_draw)
    with locks.deriving_claim(to_draw) as other:
        assert other.take([first.key])
        following.follow(to_draw, 60.0)
        left = units(to_draw)
    assert left[0] == first
    assert second not in left
    following.follow_all(to_draw)
    assert derived(to_draw) == from_scratch(to_draw)


def test_a_tile_that_is_asked_for_anew_while_it_is_drawn_is_drawn_once_more(to_draw: Sessions) -> None:
    unit = units(to_draw)[0]
    with to_draw() as session:
        *_, tile = [one for one in waiting.asked_of(session, unit) if one.level == FINEST]
    for asked in ((FINEST, tile.tile), (BLOCK, unit.tile)):
        with locks.deriving_claim(to_draw) as claim:
            write = following._draw_next(to_draw, claim, leads=False)
            assert write is not None
            with to_draw.begin() as session:
                waiting.ask_to_draw(session, asked[0], [asked[1]])
            following._commit(to_draw, write)
            with to_draw() as session:
                assert {(BLOCK, unit.tile), (FINEST, tile.tile)} <= {
                    one[:2] for one in waiting.asked_of(session, unit)
                }
                assert session.execute(text("SELECT count(*) FROM drawn_pieces")).scalar_one() == 0
    following.follow_all(to_draw)
    assert derived(to_draw) == from_scratch(to_draw)


def test_of_two_who_drew_the_same_one_writes(to_draw: Sessions) -> None:
    with locks.deriving_claim(to_draw) as claim:  # it was lost in between, say
        first = following._draw_next(to_draw, claim, leads=False)
        second = following._draw_next(to_draw, claim, leads=False)
        assert first is not None
        assert second is not None
        following._commit(to_draw, first)
        before = derived(to_draw)
        following._commit(to_draw, second)
        assert derived(to_draw) == before


def test_others_are_made_of_the_finest_once_none_of_theirs_waits(to_draw: Sessions) -> None:
    block = units(to_draw)[0].tile
    above = parent(BLOCK, block)
    with to_draw.begin() as session:
        session.execute(text("DELETE FROM cells_to_draw"))
        waiting.ask_to_draw(session, 8, [above, above + 1])
        waiting.ask_to_draw(session, FINEST, children(BLOCK, block)[:2])
    assert units(to_draw) == [Unit(BLOCK, block), Unit(8, above + 1)]
    with to_draw.begin() as session:
        session.execute(text("UPDATE cells_to_draw SET since = since - interval '1 minute' WHERE level = 8"))
    assert units(to_draw)[:2] == [Unit(8, above), Unit(8, above + 1)]  # none waits for ever
    with to_draw.begin() as session:
        session.execute(text("DELETE FROM cells_to_draw WHERE level > 8"))
        session.execute(text("UPDATE cells_to_draw SET since = now()"))
    assert units(to_draw) == [Unit(8, above), Unit(8, above + 1)]


def test_two_at_once_derive_what_one_does(streets: Sessions, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "AT_ONCE", 20)
    with ThreadPoolExecutor(2) as lanes:
        for lane in [lanes.submit(following.follow_all, streets) for _ in range(2)]:
            lane.result()
    assert derived(streets) == from_scratch(streets)
