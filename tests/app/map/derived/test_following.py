"""How what is derived follows changes: once nobody may write below them, alone, and in nobody's way."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.core.settings import Settings
from app.drives import publishing, queue
from app.drives.worker import run_worker
from app.map.derived import following
from app.map.derived.chains import Course
from app.map.derived.drawing import LEVELS, Stretches, children, pieces_of
from app.map.derived.drawn_store import replace_pieces
from app.network import locks
from app.ops import store as figures
from derived_support import add_segment, derived, execute, from_scratch, ids_of, measure
from fusion.types import Ints


def value(sessions: Sessions, query: str) -> object:
    with sessions() as session:
        return session.execute(text(query)).scalar_one()


@pytest.fixture
def followed(sessions: Sessions, segment_ids: Ints) -> Sessions:
    following.follow_all(sessions)
    return sessions


def test_a_worker_without_work_has_derived_what_is_there(
    database_url: str, sessions: Sessions, segment_ids: Ints, tmp_path: Path
) -> None:
    run_worker(Settings(database_url=database_url, data_dir=tmp_path), wait=False)
    (way,), pieces = derived(sessions)
    assert way[:5] == (segment_ids[0], 7, 100, 110, 10)
    assert {piece[0] for piece in pieces} == {12, 10, 8, 6}  # however unimportant, it is all there is
    with sessions() as session:
        assert figures.behind(session) == (0, None)


def test_a_measured_segment_is_followed_and_nothing_else_is_touched(
    followed: Sessions, segment_ids: Ints
) -> None:
    add_segment(followed, 50, 3, 20)
    following.follow_all(followed)
    cells = value(followed, "SELECT sum(drawn_version) FROM cells")
    before = dict(followed().execute(text("SELECT id, CAST(xmin AS text) FROM ways")).all())
    measure(followed, int(segment_ids[4]), 4.0)
    with followed() as session:
        behind = figures.behind(session)
    assert behind.behind_s is not None
    assert not following.follow(followed, 30.0)
    after = dict(followed().execute(text("SELECT id, CAST(xmin AS text) FROM ways")).all())
    assert {k for k in before if after[k] != before[k]} == {segment_ids[0]}
    assert value(followed, f"SELECT slope_percent FROM ways WHERE id = {segment_ids[0]}") == pytest.approx(
        4.0
    )
    assert value(followed, f"SELECT measured_share FROM ways WHERE id = {segment_ids[0]}") == pytest.approx(
        0.1
    )
    assert value(followed, "SELECT count(*) FROM drawn_pieces WHERE level = 12 AND slope_percent = 4") == 1
    assert value(followed, "SELECT sum(drawn_version) FROM cells") > cells  # type: ignore[operator]


def test_what_is_shown_as_before_is_not_drawn_anew(followed: Sessions, segment_ids: Ints) -> None:
    cells = value(followed, "SELECT sum(drawn_version) FROM cells")
    execute(followed, "UPDATE segments SET name = 'Allee' WHERE id = :id", id=int(segment_ids[0]))
    following.follow_all(followed)
    assert value(followed, f"SELECT name FROM ways WHERE id = {segment_ids[0]}") == "Allee"
    assert value(followed, "SELECT sum(drawn_version) FROM cells") == cells


def test_nothing_to_do_is_one_look(followed: Sessions) -> None:
    turn = value(followed, "SELECT turn FROM derived_upto")
    assert not following.follow(followed)
    following.follow_all(followed)
    assert value(followed, "SELECT turn FROM derived_upto") == turn


def test_drives_that_wait_come_first(
    followed: Sessions, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(queue, "drives_wait", lambda session, behind: True)
    deriver = publishing.Deriver(followed)
    measure(followed, int(segment_ids[0]), 1.0)
    deriver.piece()
    assert value(followed, "SELECT max(slope_percent) FROM ways") == pytest.approx(1.0)
    measure(followed, int(segment_ids[0]), 2.0)
    assert not deriver.piece()
    assert value(followed, "SELECT max(slope_percent) FROM ways") == pytest.approx(1.0)
    monkeypatch.setattr(publishing.time, "monotonic", lambda: 1e12)
    deriver.piece()
    assert value(followed, "SELECT max(slope_percent) FROM ways") == pytest.approx(2.0)


def test_changes_wait_for_those_that_may_still_come_before_them(
    followed: Sessions, segment_ids: Ints
) -> None:
    first, second = int(segment_ids[2]), int(segment_ids[7])
    execute(followed, "UPDATE segments SET name = 'Allee' WHERE id = :id", id=int(segment_ids[0]))
    with followed() as slow:
        slow.execute(text("UPDATE segments SET bridge = true WHERE id = :id"), {"id": first})
        measure(followed, second, 2.0)
        following.follow_all(followed)
        assert value(followed, "SELECT name FROM ways") == "Allee"
        with followed() as session:
            assert figures.behind(session).behind_s is not None
        slow.commit()
    following.follow_all(followed)
    assert value(followed, "SELECT count(slope_percent) FROM ways WHERE bridge") == 1
    assert derived(followed) == from_scratch(followed)


def test_one_at_a_time(followed: Sessions, segment_ids: Ints) -> None:
    measure(followed, int(segment_ids[0]), 1.0)
    with locks.deriving_claim(followed) as claim:
        assert claim.take()
        assert not following.follow(followed)
        assert value(followed, "SELECT count(slope_percent) FROM ways") == 0
    # One who has lost the lock, and does not know it, comes too late and writes nothing.
    with followed() as session:
        moment = following.look(session, 10.0)
    following.follow_all(followed)
    with followed.begin() as session:
        assert not following.take_turn(session, moment)
    assert value(followed, "SELECT count(slope_percent) FROM ways") == 1


def test_a_tile_that_a_solver_has_is_left_until_later(followed: Sessions, segment_ids: Ints) -> None:
    measure(followed, int(segment_ids[0]), 1.0)
    with followed() as solver:
        solver.execute(text("SELECT id FROM cells FOR UPDATE"))
        following.follow(followed, 0.1)
        assert value(followed, "SELECT count(slope_percent) FROM drawn_pieces") == 0
        # With its block.
        assert value(followed, "SELECT array_agg(level ORDER BY level) FROM cells_to_draw") == [10, 12]
        # Nobody who holds tiles waits for this one.
        solver.execute(text("SET LOCAL lock_timeout = '100ms'"))
        solver.execute(text("UPDATE segment_slopes SET drives = 2"))
        solver.commit()
    following.follow_all(followed)
    assert derived(followed) == from_scratch(followed)
    assert value(followed, "SELECT min(drives) FROM drawn_pieces WHERE slope_percent IS NOT NULL") == 2


def test_a_database_from_another_server_is_followed_as_well(followed: Sessions, segment_ids: Ints) -> None:
    execute(
        followed, "UPDATE segment_changes SET xid = CASE WHEN segment_id % 2 = 0 THEN 900000000000 ELSE 3 END"
    )
    execute(followed, "UPDATE derived_upto SET xid = 900000000000, segment_id = 10")
    assert value(followed, "SELECT count(*) FROM segment_changes") == 10
    execute(followed, "DELETE FROM drawn_pieces")
    measure(followed, int(segment_ids[0]), 1.0)
    following.follow_all(followed)
    assert value(followed, "SELECT max(xid) < 900000000000 FROM segment_changes") is True
    assert derived(followed) == from_scratch(followed)
    measure(followed, int(segment_ids[1]), 1.0)
    following.follow_all(followed)
    assert value(followed, "SELECT measured_share FROM ways") == pytest.approx(0.2)


def test_all_that_goes_leaves_nothing(followed: Sessions) -> None:
    execute(followed, "DELETE FROM segments")
    following.follow_all(followed)
    assert derived(followed) == ([], [])
    assert value(followed, "SELECT count(*) FROM derived_segments") == 0
    assert ids_of(followed) == []


_TILE = text(
    """
    WITH feature AS (
        SELECT segment_id AS id, slope_percent, slope_sigma_percent, drives, highway, oneway,
               ST_AsMVTGeom(geom_3857, ST_TileEnvelope(:z, :x, :y), 4096, 64, true) AS geom
        FROM drawn_pieces WHERE level = :level
    )
    SELECT ST_AsMVT(feature, 'segments', 4096, 'geom', 'id') FROM feature WHERE geom IS NOT NULL
    """
)


@pytest.mark.parametrize("level", [12, 8])
def test_a_tile_of_the_fullest_tiles_is_small(sessions: Sessions, level: int) -> None:
    zoom, x, y = level - 1, 536 >> (11 - level + 1), 352 >> (11 - level + 1)
    rng = np.random.default_rng(level)
    quarters = [2 * x + dx << level | 2 * y + dy for dx in (0, 1) for dy in (0, 1)]
    tiles = [tile for quarter in quarters for tile in children(level - 2, quarter)]
    after = {}
    for k, tile in enumerate(tiles):
        pieces = pieces_of(LEVELS[level], *fullest(rng, level, tile, k))
        after[tile] = {piece.segment_id: piece for piece in pieces}
    with sessions.begin() as session:
        replace_pieces(session, level, {tile: {} for tile in tiles}, after)
        encoded = bytes(session.execute(_TILE, {"z": zoom, "x": x, "y": y, "level": level}).scalar_one())
    assert len(tiles) == 64
    assert 150_000 < len(gzip.compress(encoded, 6)) <= 250_000


def fullest(rng: np.random.Generator, level: int, tile: int, number: int) -> tuple[list[Course], Stretches]:
    """Winding roads all over a tile, measured every one, with ids of a map of a hundred million segments."""
    zoom, n, points = LEVELS[level].tile_zoom, 400, 5
    side = 2 * 20037508.342789244 / 2**zoom
    corner = np.array([tile >> zoom, tile & ((1 << zoom) - 1)]) * side - 20037508.342789244
    most = LEVELS[level].most_m
    steps = rng.normal(0, most / points, (n, points, 2))
    lines = corner + rng.uniform(0, side, (n, 1, 2)) + np.cumsum(steps, axis=1)
    lines[..., 1] *= -1
    slope = rng.normal(0, 4, n)
    classes = np.array(["primary", "residential", "service", "tertiary"], object)
    roads = Stretches(
        ids=rng.choice(1_000_000, n, replace=False) + 1_000_000 * (number + 1),
        highway=classes[rng.integers(0, 4, n)],
        oneway=rng.integers(-1, 2, n),
        length_m=np.full(n, most),
        slope_percent=slope,
        sigma_percent=rng.uniform(0.1, 2, n),
        drives=rng.integers(1, 90, n),
        points=lines.reshape(-1, 2),
        first=points * np.arange(n + 1),
    )
    return [Course([k], [False]) for k in range(n)], roads


def test_to_look_whether_there_is_anything_to_do_costs_the_same_however_many_segments(
    followed: Sessions,
) -> None:
    """With many changes noted, and not one of them to follow."""
    execute(
        followed,
        """
        INSERT INTO segment_changes SELECT 1000 + k, 3 + k % 7, now(), true FROM generate_series(1, 30000) AS k
        """,
    )
    execute(followed, "ANALYZE segment_changes")
    for query, values in ((following._LOOK, {"long_s": 10.0}), (figures._BEHIND, {})):
        with followed() as session:
            plan = "\n".join(session.execute(text(f"EXPLAIN {query.text}"), values).scalars())
        assert "Seq Scan on segment_changes" not in plan
        assert "Sort" not in plan
