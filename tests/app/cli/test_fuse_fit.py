"""A real ride in a FIT file through ``versant track`` and ``versant fuse``, on a road drawn along it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import app
from fusion.formats import read_log
from fusion.types import GnssFix

RIDE = "Edge810-Vector-2013-08-16-15-35-10.fit"
MINUTES = 8
NODE_M = 40.0
runner = CliRunner()


@pytest.fixture(scope="module")
def ride(shared_data: Path) -> Path:
    return shared_data / "formats" / RIDE


@pytest.fixture(scope="module")
def driven(ride: Path) -> GnssFix:
    """The part of the ride that is on the road."""
    fix = read_log(ride).fix
    return fix.take(fix.time_s < fix.time_s[0] + 60 * MINUTES)


@pytest.fixture(scope="module")
def road(driven: GnssFix, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A road with a node every 40 m of the ride."""
    north = np.diff(driven.lat_deg) * 111_320
    east = np.diff(driven.lon_deg) * 111_320 * np.cos(np.radians(driven.lat_deg[0]))
    along_m = np.concatenate([[0], np.cumsum(np.hypot(north, east))])
    at = np.searchsorted(along_m, np.arange(0, along_m[-1], NODE_M))
    nodes = "".join(
        f'<node id="{k}" lat="{driven.lat_deg[i]:.7f}" lon="{driven.lon_deg[i]:.7f}"/>'
        for k, i in enumerate(at, 1)
    )
    refs = "".join(f'<nd ref="{k}"/>' for k in range(1, len(at) + 1))
    out = tmp_path_factory.mktemp("road") / "road.osm"
    out.write_text(f'<osm version="0.6">{nodes}<way id="1">{refs}<tag k="highway" v="tertiary"/></way></osm>')
    return out


def test_track_writes_the_positions_of_a_fit_file(ride: Path, tmp_path: Path) -> None:
    out = tmp_path / "track.csv"
    result = runner.invoke(app, ["track", str(ride), "-o", str(out)])
    assert result.exit_code == 0, result.stderr
    with out.open() as stream:
        rows = list(csv.DictReader(stream))
    fix = read_log(ride).fix
    assert [float(row["alt_msl_m"]) for row in rows] == pytest.approx(fix.alt_msl_m, abs=1e-3)
    assert [float(row["lat_deg"]) for row in rows] == pytest.approx(fix.lat_deg, abs=1e-7)


def test_fuse_gives_the_slopes_of_the_heights_it_recorded(ride: Path, road: Path, driven: GnssFix) -> None:
    result = runner.invoke(app, ["fuse", str(ride), "--roads", str(road)])
    assert result.exit_code == 0, result.stderr
    segments = [f["properties"] for f in json.loads(result.stdout)["features"]]
    segments = sorted((s for s in segments if s["drives"]), key=lambda s: s["from_node"])
    assert len(segments) > 50
    climbs_m = np.cumsum([s["slope_percent"] / 100 * s["length_m"] for s in segments])
    nodes = [s["to_node"] for s in segments]
    assert nodes == list(range(nodes[0], nodes[-1] + 1))
    # the altimeter of the bicycle computer is late by some seconds: what it says is compared over the whole
    recorded_m = float(np.ptp(driven.alt_msl_m))
    assert np.ptp(climbs_m) == pytest.approx(recorded_m, abs=2.0)
    assert recorded_m > 20
