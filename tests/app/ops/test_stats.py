"""Figures for operators."""

from __future__ import annotations

import uuid
from collections.abc import Callable

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.drives import claims
from app.drives import store as drives
from app.network import extracts as road_store
from app.ops import metrics, stats, store
from fusion.roads.table import RoadTable
from many_drives import execute, make_drives
from road_support import replace_roads


def test_an_empty_service_counts_nothing(sessions: Sessions) -> None:
    with sessions() as session:
        figures = stats.read_stats(session)
    assert (figures.drives, figures.segments, figures.queue_depth, figures.running) == (0, 0, 0, 0)
    assert figures.queue_oldest_wait_s is None
    assert figures.drives_by_status == figures.failures_by_kind == figures.driven_km_by_highway == {}
    assert figures.drives_by_day == []
    assert figures.road_version is None
    assert figures.dem_version_id is None


def test_figures_of_a_busy_service(
    sessions: Sessions, chain: Callable[..., RoadTable], add_drive: Callable[..., uuid.UUID]
) -> None:
    table = chain(4, highway=["primary", "primary", "track", "track"])
    with sessions.begin() as session:
        replace_roads(session, table, "x", "0" * 64)
        ids = road_store.all_roads(session)[1]
    add_drive(ids, {0: (1.0, 1.0), 2: (1.0, 1.0)})
    add_drive(ids, {0: (1.0, 1.0)})
    with sessions.begin() as session:
        made = [
            drives.create_drive(
                session,
                sha256=f"{k:064d}",
                filename="x",
                size_bytes=7,
                blob_key="k",
                method="raw",
                options={},
            )[0].id
            for k in range(4)
        ]
        for k, kind in enumerate(["bad-log", "bad-log", "no-match"]):
            claims.mark_running(session, made[k], 1)
            claims.mark_failed(session, made[k], 1, kind=kind, reason="r", stage="s")
        queued = "UPDATE drives SET queued_at = now() - interval '1 hour' WHERE id = :id"
        session.execute(text(queued), {"id": made[3]})
        session.execute(
            text("UPDATE drives SET created_at = now() - interval '400 days' WHERE id = :id"), {"id": made[0]}
        )
    with sessions() as session:
        figures = stats.read_stats(session, days=30)
    length_km = table.length_m / 1000
    assert figures.drives_by_status == {"done": 2, "failed": 3, "queued": 1}
    assert sum(row.drives for row in figures.drives_by_day) == 5
    assert figures.queue_depth == 1
    assert figures.queue_oldest_wait_s == pytest.approx(3600, abs=60)
    assert figures.failures_by_kind == {"bad-log": 2, "no-match": 1}
    assert figures.driven_km_by_highway == pytest.approx({"primary": length_km[0], "track": length_km[2]})
    assert figures.network_km == pytest.approx(length_km.sum())
    assert (figures.segments, figures.segments_driven, figures.drives) == (4, 2, 6)
    assert figures.driven_distance_km == pytest.approx(0.2)
    assert figures.uploaded_bytes == 2 * 10 + 4 * 7
    assert figures.road_version is not None


def scanned(session: Session) -> dict[str, int]:
    """Rows read so far by reading whole tables."""
    query = text("SELECT relname, seq_tup_read FROM pg_stat_xact_user_tables WHERE relname = ANY(:names)")
    names = ["drives", "segments", "segment_slopes"]
    return {row[0]: row[1] for row in session.execute(query, {"names": names})}


def test_figures_of_drives_and_roads_read_no_whole_table(
    sessions: Sessions, chain: Callable[..., RoadTable], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All but the two sums over published slopes."""
    with sessions.begin() as session:
        replace_roads(session, chain(40), "x", "0" * 64)
    make_drives(sessions, 100)
    monkeypatch.setattr(store, "segments_driven", lambda session: 0)
    monkeypatch.setattr(store, "driven_km_by_highway", lambda session: {})
    execute(sessions, "UPDATE drives SET status = 'queued' WHERE filename = 'log 8'")
    with sessions() as session:
        session.execute(text("SET enable_seqscan = off"))  # a small table is scanned because it is small
        before = scanned(session)
        figures, gauges = stats.read_stats(session), metrics.read_gauges(session)
        assert scanned(session) == before
    assert (figures.segments, figures.drives, figures.queue_depth, gauges.plain["queue_depth"]) == (
        40,
        100,
        1,
        1,
    )
    assert figures.drives_by_status == gauges.drives_by_status == {"done": 74, "failed": 25, "queued": 1}
    assert gauges.plain["queue_oldest_wait_seconds"] > 0


def test_the_length_of_roads_that_no_import_noted_is_summed(
    sessions: Sessions, chain: Callable[..., RoadTable]
) -> None:
    """An import by the former code, while an update comes in, leaves it open."""
    table = chain(4)
    with sessions.begin() as session:
        replace_roads(session, table, "x", "0" * 64)
        assert session.execute(text("SELECT length_m FROM road_versions")).scalar_one() == pytest.approx(
            table.length_m.sum()
        )
        session.execute(text("UPDATE road_versions SET length_m = NULL"))
        assert stats.read_stats(session).network_km == pytest.approx(table.length_m.sum() / 1000)
