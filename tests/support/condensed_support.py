"""A tiny jury, so that few drives make condensed, and what has to hold of them whatever happened."""

from __future__ import annotations

import uuid

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions, fetch_binary
from app.network import condensed
from fusion.network.condensed import CondensedPasses
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import drive_over

TINY = 3


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """A jury of three."""
    monkeypatch.setattr(condensed, "RECENT_PASSES", TINY)


def _summed_rows(sessions: Sessions) -> dict[int, int]:
    """How many passes over each segment are in its sum by their own rows, rejected ones left out."""
    with sessions() as session:
        query = "SELECT segment_id, count(*) FROM drive_passes WHERE condensed_weight > 0 GROUP BY 1"
        return {row[0]: row[1] for row in session.execute(text(query))}


def assert_sums_hold(sessions: Sessions) -> dict[int, CondensedPasses]:
    """Sums are those of the passes that say so of themselves, made anew from their factors."""
    with sessions() as session:
        ids = session.execute(text("SELECT DISTINCT segment_id FROM condensed_passes")).scalars().all()
        stored = condensed.condensed_over(session, ids)
        wanted: dict[int, CondensedPasses] = {}
        for drive in (
            session.execute(text("SELECT id FROM drives WHERE duplicate_of IS NULL")).scalars().all()
        ):
            rows = fetch_binary(
                session,
                "SELECT segment_id, sequence, condensed_weight, factor FROM drive_passes WHERE drive_id = %(id)s",
                {"id": drive},
            )
            for segment, one in condensed.condensed_of_drive(session, drive, rows).items():
                wanted[segment] = wanted[segment] + one if segment in wanted else one
    assert {k: (one.passes, one.drives, one.observations) for k, one in stored.items()} == {
        k: (one.passes, one.drives, one.observations) for k, one in wanted.items()
    }
    assert {k: one.passes for k, one in stored.items()} == _summed_rows(sessions)
    for segment, one in stored.items():
        largest = np.abs(wanted[segment].information).max()
        assert np.abs(one.information - wanted[segment].information).max() <= 1e-12 * largest
    return stored


def ten_drives(sessions: Sessions, table: RoadTable, ids: Ints, count: int = 10) -> list[uuid.UUID]:
    """Drives over the first segments of a street, day after day."""
    rng = np.random.default_rng(5)
    return [
        drive_over(
            sessions, table, ids, {row: (2.0 + 0.5 * rng.normal(), 0.5) for row in range(6)}, 86_400.0 * day
        )
        for day in range(count)
    ]
