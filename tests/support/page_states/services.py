"""The services that states are looked at in: each is made once, and no state changes what others see."""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import text

from app.drives import claims, tracks
from app.map import figures
from app.map.derived.following import follow_all
from app.network import extracts
from app.roads.imports import import_roads
from app.terrain.imports import import_dem
from browser_fixtures import drives_computed
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from geoid_support import installed_grid
from many_drives import execute, make_drives
from named_town import LON, write_named_town
from network_support import drive_over, new_drive, pass_over, publish
from page_states.logs import by_other_names, changed, upside_down
from page_states.table import Service
from processing_support import accept_upload, process_drive
from web_fixtures import Web, add_drive, fill_roads

STREET = 56
"""Row of the grid at which its southernmost street begins, of segments of 146 m."""
HILL = 28
"""Row at which the street begins that has a climb, of segments of 222 m."""
DRIVES = 40
_RECENT = """
    UPDATE drives SET (created_at, queued_at, started_at, finished_at) = (
        created_at + age, queued_at + age, started_at + age, finished_at + age)
    FROM (SELECT now() - max(created_at) AS age FROM drives WHERE filename LIKE 'log %') AS late
    WHERE filename LIKE 'log %'
"""


def heights_where_it_is_steep(web: Web) -> None:
    """Give what rises by 8 to 10 % heights of its ends that rise so, by 200 m over 222 m northwards."""
    execute(
        web.sessions,
        """
        UPDATE segment_slopes AS a SET height_from_m = 100 + 200 * (ST_Y(ST_StartPoint(s.geom)) - 49) / 0.002,
            height_to_m = 100 + 200 * (ST_Y(ST_EndPoint(s.geom)) - 49) / 0.002, height_sigma_m = 0.5
        FROM segments AS s WHERE s.id = a.segment_id AND a.slope_percent > 8 AND a.slope_percent < 10
        """,
    )


def a_hill(web: Web, ids: list[int]) -> uuid.UUID:
    """A drive over seven segments of 222 m: four up by 10 %, one level, two down by 12 %."""
    drive = add_drive(web.sessions, list(range(HILL, HILL + 7)), 3.0)
    with web.sessions.begin() as session:
        named = text("UPDATE segments SET name = 'Bergstraße' WHERE id = ANY(:ids)")
        session.execute(named, {"ids": ids[HILL : HILL + 4]})
        track = tracks.read_track(session, drive)
        assert track is not None
        along = 222 * (np.arange(35) // 5 + np.tile(np.linspace(0.1, 0.9, 5), 7))
        height = np.interp(along, [0, 888, 1110, 1554], [100, 188.8, 188.8, 135.5])
        known = np.r_[np.full(35, 0.004), np.nan]
        hill = replace(track, alt_m=np.r_[height, np.nan], pitch_rad=0 * known, pitch_sigma_rad=known)
        tracks.save_track(session, drive, tracks.EncodedTrack.of(hill, np.array(ids)))
    return drive


def a_street_with_an_odd_drive(web: Web) -> list[int]:
    """Segments of the street of which two drives say the same and one contradicts."""
    with web.sessions() as session:
        table, ids = extracts.all_roads(session)
    for slope in (2.0, 2.1):
        drive_over(web.sessions, table, ids, dict.fromkeys((STREET, STREET + 1, STREET + 3), (slope, 0.4)))
    odd = new_drive(web.sessions)
    publish(web.sessions, odd, ids, [pass_over(table, STREET, 9.0, 0.3)])
    return [int(i) for i in ids[STREET : STREET + 7]]


def a_steep_street(web: Web) -> tuple[float, float]:
    """Two drives that rise by 9 % on two segments in the far north, where no other drive is: latitude and longitude."""
    with web.sessions() as session:
        table, _ = extracts.all_roads(session)
    north = np.argsort(np.where(table.length_m > 30, table.lat0_deg, -90))[-2:]
    for _ in range(2):
        add_drive(web.sessions, north.tolist(), 9.0, 0.3)
    return float(table.lat0_deg[north[1]]), float(table.lon0_deg[north[1]])


def two_rasters(web: Web) -> None:
    """West and east of the named town's middle, by sources of their own; nothing reads heights there."""
    boxes = {"west": [LON - 1, 49.3, LON, 49.6], "east": [LON, 49.3, LON + 1, 49.6]}
    named: dict[str, dict[str, Any]] = {
        name: {"name": f"{name}.tif", "uri": f"{name}/{name}.tif", "sha256": name, "bounds_deg": box}
        for name, box in boxes.items()
    }
    named["west"] |= {"source": "Western <Survey>", "licence": "CC BY 4.0"}
    said = "INSERT INTO dem_versions (sources, datum, active) VALUES (CAST(:sources AS jsonb), 'x', true)"
    execute(web.sessions, said, sources=json.dumps([*named.values()]))


@contextmanager
def grid(web: Web, folder: Path) -> Iterator[Service]:
    """Streets that were driven, steep ones among them; a town with names; many drives of which some failed."""
    ids = fill_roads(web.sessions)
    make_drives(web.sessions, DRIVES, days=0.1)
    execute(web.sessions, _RECENT)
    for rows, slope, sigma in (
        ([0, 2], 9.0, 0.5),
        ([4], 7.0, 0.2),
        ([4], 7.0, 0.2),
        ([9], -8.0, 0.4),
        ([20], 12.0, 9.0),
    ):
        add_drive(web.sessions, rows, slope, sigma)
    heights_where_it_is_steep(web)
    hill = a_hill(web, ids)
    street = a_street_with_an_odd_drive(web)
    # Now: rows of the grid are rows of all roads no longer.
    import_roads(web.sessions, write_named_town(folder / "named.osm"), web.context.dem_dir, region="named")
    two_rasters(web)
    follow_all(web.sessions)
    while figures.renew_one(web.sessions):
        pass
    yield Service(web, {"hill": hill, "street": street})


@contextmanager
def town(web: Web, folder: Path, scene: Town) -> Iterator[Service]:
    """Two drives that agree, one that contradicts them, one with guessed columns and odd heights."""
    write_osm(scene, folder / "town.osm")
    write_dem(scene, folder / "town.tif")
    write_csv(simulate_drive(scene, 0, duration_s=80, receiver="m8"), folder / "log.csv")
    log = (folder / "log.csv").read_bytes()
    import_roads(web.sessions, folder / "town.osm", web.context.dem_dir)
    import_dem(web.sessions, [folder / "town.tif"], web.context.dem_dir)
    logs = {
        "first.csv": changed(log, 0),
        "second.csv": changed(log, 1),
        "wrong.csv": changed(log, 3, upside_down),
        "columns.csv": by_other_names(changed(log, 5, seconds=60)),
    }
    with installed_grid(folder):
        drives = {name: computed(web, name, content) for name, content in logs.items()}
        yield Service(web, {**drives, "steep": a_steep_street(web)})


def computed(web: Web, name: str, log: bytes) -> uuid.UUID:
    drive, _ = accept_upload(web.sessions, web.blobs, [log], filename=name, method="profile")
    process_drive(web.context, drive.id, drive.generation)
    return drive.id


@contextmanager
def bare(web: Web, ride: bytes) -> Iterator[Service]:
    """No roads; a drive that waits for some, one that is being computed, and a worker beside."""
    running, _ = accept_upload(web.sessions, web.blobs, [ride], filename="running.csv", method="raw")
    with web.sessions.begin() as session:
        assert claims.mark_running(session, running.id, running.generation)
        claims.set_progress(session, running.id, running.generation, "match", 0.4)
    execute(web.sessions, "UPDATE drives SET started_at = now() - interval '100 s'")
    waiting, _ = accept_upload(web.sessions, web.blobs, [ride + b"\n"], filename="waiting.csv", method="raw")
    process_drive(web.context, waiting.id, waiting.generation)
    reading, _ = accept_upload(web.sessions, web.blobs, [ride + b"\n\n"], filename="log.csv", method="raw")
    with web.sessions.begin() as session:
        assert claims.mark_running(session, reading.id, reading.generation)
        claims.set_progress(session, reading.id, reading.generation, "read csv", 0.1)
    with drives_computed(web):
        yield Service(web, {"running": running.id, "waiting": waiting.id, "reading": reading.id})
