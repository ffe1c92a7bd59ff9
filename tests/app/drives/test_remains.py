"""What stays of the only drive of a database once it is removed: nothing that tells where, when or whose it was."""

from __future__ import annotations

import hashlib
import math
import re
import subprocess
import uuid
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import text

from app.core.blobs import EXPORTS, BlobStore
from app.core.settings.places import libpq_url
from app.drives.worker import run_worker
from app.embedded.binaries import find_client
from app.roads import imports as road_imports
from log_lines import logged
from processing_support import carry_out_removals
from web_fixtures import Web, add_drive

NAME = "max.mustermann.csv"
CHANGED = {"cells", "segment_changes", "change_epoch", "derived_upto"}
"""Of roads and cells, by number, that what is shown of them changed, and when: who follows the map has to hear that a
slope is gone. README and the page on operation say so."""
COUNTS = {"process_totals", "driven_by_day", "kept_figures", "owner_use"}
"""How many, how long and how long it took, of all drives together; how many an owner sent on a day."""
ASKED = {"audit_log", "batches", "exports"}
"""What somebody asked for, and when."""
HARMLESS = {"procrastinate_events", "procrastinate_periodic_defers", "procrastinate_workers"}

FIGURE = re.compile(r"(?<![\w.])-?\d{1,3}\.\d{2,}")
CLOCK = re.compile(r'\d\d:\d\d:\d\d\.\d+|"(?:\w+_s|seconds)": [\d.]+')
"""The time of day, and how long something took: they are no places, though they may look like one."""
GEOMETRY = re.compile(r"\b0[01][0-9A-F]{40,}")
CELL_NAME = re.compile(r"\d+/\d+/\d+")
NEAR_DEG = 0.15
"""10 km and more of longitude there."""


def dumped(web: Web) -> dict[str, set[str]]:
    """The rows of every table as pg_dump writes them: of those that backups leave out as well."""
    program, _ = find_client("pg_dump", 15)
    place = libpq_url(str(web.settings.database_url))
    done = subprocess.run(
        [program, "--data-only", "--inserts", f"--dbname={place}"], capture_output=True, text=True, check=True
    )
    rows: dict[str, set[str]] = {}
    for table, row in re.findall(r"^INSERT INTO public\.(\w+) VALUES \((.*?)\);$", done.stdout, re.M | re.S):
        rows.setdefault(table, set()).add(row)
    return rows


def worked(web: Web) -> None:
    for _ in range(2):  # also what was asked for last
        run_worker(web.settings, wait=False)


def tile_of(z: int, lon_deg: float, lat_deg: float) -> tuple[int, int]:
    north = math.asinh(math.tan(math.radians(lat_deg))) / math.pi
    return int((lon_deg + 180) / 360 * 2**z), int((1 - north) / 2 * 2**z)


def looked_at(web: Web, drive: str) -> str:
    """Everything that leaves something of a drive somewhere; the number of an export that it is in."""
    client = web.client
    assert client.get(f"/v1/drives/{drive}").json()["status"] == "done"
    client.post(f"/v1/drives/{drive}/trials?method=raw")
    assert client.get(f"/v1/drives/{drive}/profile?f=png").status_code == 200
    west, south, east, north = client.get(f"/v1/drives/{drive}").json()["bbox"]
    box = f"{west},{south},{east},{north}"
    assert client.post(f"/v1/drives/reprocess?which=all&bbox={box}").status_code == 202
    worked(web)
    export = client.post("/v1/exports", json={"format": "geojson", "driven": True}).json()["id"]
    worked(web)
    for z in (8, 12, 14):
        x, y = tile_of(z, (west + east) / 2, (south + north) / 2)
        assert client.get(f"/tiles/{z}/{x}/{y}.mvt").status_code == 200
    with web.sessions.begin() as session:  # a road that an import took away
        session.execute(
            text(
                """
                WITH a AS (
                    INSERT INTO retired_segments (segment_id, osm_way_id, from_node, to_node, geom, length_m)
                    SELECT id, osm_way_id, from_node, to_node, geom, length_m FROM segments LIMIT 1 RETURNING id)
                INSERT INTO retired_passes (retired_id, drive_id, sequence, entered_s, factor)
                SELECT a.id, :drive, 0, 0, 'x' FROM a
                """
            ),
            {"drive": uuid.UUID(drive)},
        )
    return str(export)


def test_nothing_of_the_only_drive_stays(web: Web, files: Path) -> None:
    road_imports.import_roads(web.sessions, files / "town.osm", web.settings.dem_dir)
    worked(web)
    before, log = dumped(web), (files / "0.csv").read_bytes()
    with logged() as lines:
        drive = web.client.post("/v1/drives?method=profile", files={"file": (NAME, log)}).json()["id"]
        worked(web)
        export = looked_at(web, drive)
        document = web.client.get(f"/v1/drives/{drive}").json()
        during = dumped(web)
        assert {"stored_tiles", "drive_pictures", "retired_segments", "drive_trials"} <= during.keys()
        assert web.client.delete(f"/v1/drives/{drive}").status_code == 202
        worked(web)
    stays = {table: rows - before.get(table, set()) for table, rows in dumped(web).items()}
    stays = {table: rows for table, rows in stays.items() if rows}
    assert stays.keys() <= CHANGED | COUNTS | ASKED | HARMLESS
    told = "\n".join(row for table, rows in stays.items() for row in rows)
    folder = [path for path in web.settings.data_dir.rglob("*") if path.is_file()]
    kept = "\n".join([*map(str, folder), *(path.read_bytes().decode("latin-1") for path in folder)])

    began = datetime.fromisoformat(document["drive_time"]).astimezone(UTC)
    hashes = [hashlib.sha256(log).hexdigest(), document["sha256"]]
    for secret in (NAME, "mustermann", *hashes, f"{began:%Y-%m-%d %H:}", f"{began:%Y-%m-%dT%H:}"):
        assert secret not in told and secret not in lines.text and secret not in kept, secret
    west, south, east, north = document["bbox"]
    places = "\n".join(row for table, rows in stays.items() if table not in COUNTS for row in rows)
    for figure in map(float, FIGURE.findall(CLOCK.sub("", places + lines.text))):
        assert not west - NEAR_DEG <= figure <= east + NEAR_DEG, figure
        assert not south - NEAR_DEG <= figure <= north + NEAR_DEG, figure
    assert not GEOMETRY.search(told) and not CELL_NAME.search(told) and "\\x" not in told
    assert all(drive not in row for table, rows in stays.items() if table not in ASKED for row in rows)

    assert web.client.get(f"/v1/exports/{export}/file").status_code == 404
    url = web.settings.blob_store_url
    assert BlobStore(url).keys() == BlobStore(url, EXPORTS).keys() == []
    assert all("'{}'" in row for row in stays["cells"])  # nothing is driven there


def test_exports_of_elsewhere_stay_and_one_that_is_made_begins_anew(filled: Web) -> None:
    drive = add_drive(filled.sessions, [0, 1])

    def asked(**wanted: object) -> str:
        return str(filled.client.post("/v1/exports", json={"format": "csv", **wanted}).json()["id"])

    far, near, whole = asked(bbox=[10, 50, 11, 51]), asked(bbox=[8.3, 48.9, 8.5, 49.1]), asked()
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE drives SET bounds = ST_MakeEnvelope(8.4, 49, 8.41, 49.01, 4326)"))
        ended = "UPDATE exports SET status = 'done', blob_key = 'exports/none' WHERE id = ANY(:ids)"
        session.execute(text(ended), {"ids": [uuid.UUID(one) for one in (far, near)]})
        session.execute(text("UPDATE exports SET status = 'running', run = 1 WHERE id = :id"), {"id": whole})
        session.execute(text("DELETE FROM procrastinate_jobs"))
    filled.client.delete(f"/v1/drives/{drive}")
    carry_out_removals(filled.sessions, filled.blobs)
    found = {one: filled.client.get(f"/v1/exports/{one}").json()["status"] for one in (far, near, whole)}
    assert found == {far: "done", near: "cancelled", whole: "queued"}
    with filled.sessions() as session:
        jobs = "SELECT args ->> 'export_id' FROM procrastinate_jobs WHERE task_name = 'make_export'"
        assert session.execute(text(jobs)).scalars().all() == [whole]
        assert session.execute(text("SELECT run FROM exports WHERE status = 'queued'")).scalar_one() == 2


def test_reasons_name_no_place(web: Web, files: Path) -> None:
    """The reason names where the log lies, for people who ask the library; a service tells it to operators, too."""
    road_imports.import_roads(web.sessions, files / "town.osm", web.settings.dem_dir)
    rows = [f"{1_700_000_000 + k},{12 + 9e-5 * k:.7f},8.4123456,120" for k in range(60)]
    log = "\n".join(["time_s,lat_deg,lon_deg,alt_msl_m", *rows]).encode()
    drive = web.client.post("/v1/drives?method=raw", content=log).json()["id"]
    run_worker(web.settings, wait=False)
    failure = web.client.get(f"/v1/drives/{drive}").json()["failure"]
    assert failure["kind"] == "no-match" and "(blanked) degrees north" in failure["reason"]
    (row,) = web.client.get("/v1/admin/failures").json()["rows"]
    assert "no-match" in row["kind"]
    assert not re.search(r"\d\.\d{4}", row["latest_reason"] + failure["reason"])


def test_the_audit_log_holds_neither_boxes_nor_names(filled: Web) -> None:
    add_drive(filled.sessions, [0, 1])
    box = "8.41234,49.01234,8.51234,49.11234"
    filled.client.post(f"/v1/drives/reprocess?which=all&bbox={box}")
    filled.client.post(f"/v1/drives/remove?bbox={box}")
    filled.client.post("/v1/drives/remove?which=all")
    assert [row["detail"].get("bbox") for row in filled.client.get("/v1/admin/audit").json()["rows"]] != []
    with filled.sessions() as session:
        for table in ("audit_log", "batches"):
            found = "\n".join(map(str, session.execute(text(f"SELECT {table} FROM {table}")).scalars()))
            assert "41234" not in found, table
