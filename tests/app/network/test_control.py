"""Surveyed heights in the database: once at a place, used by the roads there, and gone without a trace."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import text
from typer.testing import CliRunner, Result

from app.cli import app
from app.core.db import Sessions
from app.network.cells import data_version
from app.network.control_import import ControlCounts, import_control
from app.network.solve import control_near
from fusion.network.control import ControlPoint
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import drive_over

POINT = ControlPoint(8.5035, 49.00005, 20.0, 0.05, "line 2 of a.csv")
"""Beside the middle of the fourth segment of ``chain``."""
FAR = ControlPoint(9.0, 49.0, 100.0, 0.05, "line 3 of a.csv")
Heights = dict[int, tuple[float, float, float]]


@pytest.fixture
def road(sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints) -> list[int]:
    """Ids of ten segments that rise by 2 %, of which a drive says so, and of their heights next to nothing."""
    drive_over(sessions, chain(), segment_ids, dict.fromkeys(range(10), (2.0, 0.3)))
    return [int(i) for i in segment_ids]


def heights(sessions: Sessions) -> Heights:
    query = "SELECT segment_id, height_from_m, height_sigma_m, slope_percent FROM segment_slopes"
    with sessions() as session:
        return {row[0]: (row[1], row[2], row[3]) for row in session.execute(text(query))}


def version(sessions: Sessions) -> int:
    with sessions() as session:
        return data_version(session)


def test_a_point_brings_its_height_and_leaves_no_trace(sessions: Sessions, road: list[int]) -> None:
    before, number = heights(sessions), version(sessions)
    assert import_control(sessions, [POINT, FAR]) == ControlCounts(2, 0, 0, 0, without_road=1, segments=1)
    after = heights(sessions)
    assert version(sessions) > number
    for k, segment in enumerate(road):
        up, sigma, slope = after[segment]
        assert up == pytest.approx(20 + 0.02 * 73.15 * (k - 3.5), abs=3 * sigma)
        assert sigma < 0.2 * before[segment][1]
        assert slope == pytest.approx(before[segment][2], abs=1e-4)
    assert import_control(sessions, [], replace=True) == ControlCounts(0, 0, 0, 2, without_road=0, segments=1)
    for segment, (up, sigma, slope) in heights(sessions).items():
        assert up == pytest.approx(before[segment][0], abs=0.01 * sigma)
        assert (sigma, slope) == pytest.approx(before[segment][1:], rel=1e-3)


def test_imported_twice_it_is_there_once(sessions: Sessions, road: list[int]) -> None:
    import_control(sessions, [POINT])
    after, number = heights(sessions), version(sessions)
    again = replace(POINT, name="line 9 of b.csv")
    assert import_control(sessions, [again, again]) == ControlCounts(0, 0, 1, 0, without_road=0, segments=0)
    assert (heights(sessions), version(sessions)) == (after, number)
    moved = replace(POINT, height_m=30.0)
    assert import_control(sessions, [moved]) == ControlCounts(0, 1, 0, 0, without_road=0, segments=1)
    assert heights(sessions)[road[3]][0] == pytest.approx(after[road[3]][0] + 10, abs=0.1)


def test_points_are_read_in_one_order(sessions: Sessions, segment_ids: Ints) -> None:
    points = [POINT, replace(POINT, lat_deg=48.9), replace(POINT, lon_deg=8.1)]
    import_control(sessions, points)
    with sessions() as session:
        assert control_near(session, (8.0, 48.0, 9.0, 50.0)) == sorted(
            points, key=lambda p: (p.lon_deg, p.lat_deg)
        )
        assert control_near(session, (8.2, 48.95, 9.0, 50.0)) == [POINT]


def test_replacing_keeps_what_is_in_the_file(sessions: Sessions, road: list[int]) -> None:
    import_control(sessions, [POINT, FAR])
    counts = import_control(sessions, [POINT], replace=True)
    assert counts == ControlCounts(0, 0, 1, 1, without_road=0, segments=0)
    with sessions() as session:
        assert control_near(session, (-180.0, -90.0, 180.0, 90.0)) == [POINT]


def test_the_command(
    sessions: Sessions, road: list[int], database_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    points, report = tmp_path / "points.csv", tmp_path / "report.json"

    def run(*arguments: str) -> Result:
        return CliRunner().invoke(app, ["import-control", str(points), "--json", str(report), *arguments])

    points.write_text("lat_deg,lon_deg,height_m\n49.00005,8.5035,20\n49,9,100\n")
    done = run()
    assert done.exit_code == 0, done.stderr
    assert done.stdout.splitlines() == [
        "points.csv: 2 points added, 0 changed, 0 as they were, 0 removed; 1 segments solved again.",
        "1 points lie more than 20 m from any road and wait for one.",
    ]
    assert json.loads(report.read_text())["added"] == 2
    points.write_text("lat_deg,lon_deg,height_m\n")
    assert "2 removed" in run("--replace").stdout
    points.write_text("lat_deg,lon_deg\n")
    refused = run()
    assert refused.exit_code == 1
    assert "lacks height_m" in refused.stderr
