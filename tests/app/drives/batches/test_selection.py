"""Which drives a batch means."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import pytest

from app.core.db import Sessions
from app.core.version import code_version
from app.drives.batches import enqueuing
from app.drives.batches import store as bulk
from app.drives.batches.documents import Selection, Which
from fusion.errors import UnknownNameError
from fusion.pipeline import parse_options
from many_drives import execute, make_drives, rows, waiting

EVERY, FAILED = list(range(8)), [3, 7]


def chosen(sessions: Sessions, method: str | None = None, **filters: Any) -> list[int]:
    """The drives that a batch queues; a dry run counts the same."""
    selection = Selection(**filters)
    with sessions() as session:
        count = bulk.count_selected(session, selection, method)
    assert waiting(sessions) == []
    batch, queued = enqueuing.reprocess_all(sessions, selection, method)
    found = waiting(sessions)
    assert len(found) == queued == count
    enqueuing.cancel(sessions, batch)
    return found


def day(number: int) -> datetime:
    return datetime(2026, 1, number, tzinfo=UTC)


@pytest.mark.parametrize(
    ("filters", "method", "expected"),
    [
        ({"which": Which.ALL}, None, EVERY),
        ({"which": Which.FAILED}, None, FAILED),
        ({"which": Which.OTHER}, "raw", []),
        ({"which": Which.OTHER}, "dem", EVERY),
        ({"which": Which.ALL, "from_method": "raw"}, None, EVERY),
        ({"which": Which.ALL, "from_method": "dem"}, None, []),
        ({"which": Which.ALL, "failure": "no-match"}, None, FAILED),
        ({"which": Which.ALL, "failure": "bad-log"}, None, []),
        ({"which": Which.ALL, "code_version": "1.0"}, None, EVERY),
        ({"which": Which.ALL, "code_version": "0.9"}, None, []),
        ({"which": Which.ALL, "created_after": day(5)}, None, [4, 5, 6, 7]),
        ({"which": Which.ALL, "created_after": day(3), "created_before": day(5)}, None, [2, 3]),
        ({"which": Which.FAILED, "created_before": day(5)}, None, [3]),
        ({"which": Which.ALL, "driven_before": datetime(2025, 12, 24, tzinfo=UTC)}, None, [0, 1]),
        ({"which": Which.ALL, "driven_after": datetime(2025, 12, 28, tzinfo=UTC)}, None, [6, 7]),
        ({"which": Which.ALL, "bbox": (8.0095, 48.0, 8.0305, 49.0005)}, None, [1, 2, 3]),
        ({"which": Which.ALL, "bbox": (8.0595, 48.0, -8.0, 50.0)}, None, [6, 7]),
        ({"which": Which.ALL, "bbox": (8.0, 50.0, 9.0, 51.0)}, None, []),
    ],
    ids=str,
)
def test_drives_are_selected(
    sessions: Sessions, filters: dict[str, Any], method: str | None, expected: list[int]
) -> None:
    make_drives(sessions, 8)
    assert chosen(sessions, method, **filters) == expected


def test_drives_that_wait_or_run_are_never_selected(sessions: Sessions) -> None:
    make_drives(sessions, 4)
    execute(sessions, "UPDATE drives SET status = 'running' WHERE filename = 'log 1'")
    assert chosen(sessions, which=Which.ALL) == [0, 2, 3]


def test_stale_are_drives_of_another_version_or_other_defaults(sessions: Sessions) -> None:
    """Options that a drive names itself are as they were asked for: their defaults do not matter."""
    defaults = parse_options("raw", {}).model_dump_json()
    make_drives(sessions, 6, options=defaults)
    assert chosen(sessions, which=Which.STALE) == list(range(6))
    execute(sessions, "UPDATE provenances SET code_version = :now", now=code_version())
    assert chosen(sessions, which=Which.STALE) == []
    other = "UPDATE provenances AS p SET options = jsonb_set(p.options, :name, '77') FROM drives AS d "
    execute(sessions, other + "WHERE d.id = drive_id AND filename = 'log 2'", name=["min_epochs"])
    assert chosen(sessions, which=Which.STALE) == []
    (name, *_) = [name for name in parse_options("raw", {}).model_dump() if name != "min_epochs"] or ["gone"]
    execute(sessions, other + "WHERE d.id = drive_id AND filename = 'log 4'", name=[name])
    assert chosen(sessions, which=Which.STALE) == [4]
    execute(sessions, "UPDATE drives SET options = '{}'")
    assert chosen(sessions, which=Which.STALE) == [2, 4]


def test_a_method_that_there_is_not_is_refused_before_anything_is_asked_for(sessions: Sessions) -> None:
    for selection, method in ((Selection(), "none"), (Selection(from_method="none"), "raw")):
        with pytest.raises(UnknownNameError):
            enqueuing.reprocess_all(sessions, selection, method)
    with pytest.raises(ValueError, match="which method"):
        enqueuing.reprocess_all(sessions, Selection(), None)
    assert rows(sessions, "SELECT * FROM batches") == []


def raster(uri: str, west: float, priority: int = 0, *, known: bool = True) -> dict[str, Any]:
    """A raster over 0.015 degrees of longitude around drives' latitude, as versions list it."""
    bounds = [west, 48.9, west + 0.015, 49.1] if known else None
    return {"name": uri, "uri": uri, "sha256": "", "priority": priority, "bounds_deg": bounds}


def activate(sessions: Sessions, *rasters: dict[str, Any]) -> None:
    """Make these the active rasters."""
    execute(sessions, "UPDATE dem_versions SET active = false")
    query = "INSERT INTO dem_versions (sources, datum, active) VALUES (CAST(:sources AS jsonb), '', true)"
    execute(sessions, query, sources=json.dumps(rasters))


def test_stale_are_drives_whose_elevation_is_another_where_they_drove(sessions: Sessions) -> None:
    """Drive k lies at 8 + k/100 degrees; a raster that came, went or changed elsewhere is of no concern."""
    make_drives(sessions, 8, options=parse_options("raw", {}).model_dump_json())
    execute(sessions, "UPDATE provenances SET code_version = :now", now=code_version())
    first, second = raster("first", 7.999), raster("second", 8.039)
    assert chosen(sessions, which=Which.STALE) == []
    activate(sessions, first)
    under = [0, 1]
    assert chosen(sessions, which=Which.STALE) == under
    computed = "UPDATE provenances SET dem_version_id = (SELECT id FROM dem_versions WHERE active)"
    execute(sessions, computed)
    assert chosen(sessions, which=Which.STALE) == []
    activate(sessions, second, first)
    assert chosen(sessions, which=Which.STALE) == [4, 5]
    activate(sessions, raster("first", 7.999, priority=1))
    assert chosen(sessions, which=Which.STALE) == under
    activate(sessions)
    assert chosen(sessions, which=Which.STALE) == under
    activate(
        sessions, {name: value for name, value in first.items() if name not in {"priority", "bounds_deg"}}
    )
    assert chosen(sessions, which=Which.STALE) == []
    activate(sessions, first, raster("somewhere", 0, known=False))
    assert chosen(sessions, which=Which.STALE) == list(range(8))
    activate(sessions, first, raster("far", 100.0))
    assert chosen(sessions, which=Which.STALE) == []
    execute(sessions, "UPDATE drives SET bounds = NULL WHERE filename = 'log 6'")
    assert chosen(sessions, which=Which.STALE) == [6]
