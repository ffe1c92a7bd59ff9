"""Versions of the elevation rasters go back to the schema of before priorities, and come again."""

from __future__ import annotations

import json
from pathlib import Path

from sqlalchemy import text

from app.core import migrate
from app.core.db import Sessions
from app.terrain.store import current_dem

_ADD = text("INSERT INTO dem_versions (sources, datum, active) VALUES (CAST(:sources AS jsonb), '', :active)")
_ALL = text("SELECT sources, active FROM dem_versions ORDER BY id")


def test_sources_go_back_and_come_again(sessions: Sessions, database_url: str) -> None:
    plain = [{"name": name, "uri": f"{name}/x", "sha256": "0"} for name in "ba"]
    known = [{**source, "priority": 3, "bounds_deg": [1, 2, 3, 4]} for source in plain]
    with sessions.begin() as session:
        session.execute(_ADD, {"sources": json.dumps(known), "active": False})
        session.execute(_ADD, {"sources": "[]", "active": True})
    migrate.downgrade(database_url, "0012")
    with sessions() as session:
        assert [tuple(row) for row in session.execute(_ALL)] == [(plain, False), ([], False)]
    with sessions.begin() as session:
        session.execute(text("UPDATE dem_versions SET active = true WHERE sources <> '[]'"))
    migrate.upgrade(database_url)
    with sessions() as session:
        active = current_dem(session, Path("dem"))
    assert active is not None
    assert [(s.name, s.priority, s.bounds_deg) for s in active.sources] == [("b", 0, None), ("a", 0, None)]
