"""Which drives are one, from upload to map: the service decides as ``versant fuse`` does."""

from __future__ import annotations

import math
import uuid
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from app.cli.logs.fusing import Fusion
from app.core.db import Sessions
from app.core.settings import Settings
from app.drives.process import Outcome
from app.jobs.context import JobContext
from app.roads import imports as road_imports
from fusion.formats import read_log
from fusion.pipeline import parse_options
from fusion.roads.osm import read_roads
from fusion.together import solve_network
from fusion.types import DriveLog
from network_support import rows_of
from processing_support import accept_upload, drive_now, process_drive

SECONDS = 150
Logs = dict[str, bytes]
ReceiverLog = Callable[..., Path]


def csv_of(log: DriveLog, digits: int) -> bytes:
    """Positions and heights with so many decimals of a degree."""
    fix = log.fix
    columns = zip(*(c.tolist() for c in (fix.time_s, fix.lat_deg, fix.lon_deg, fix.alt_msl_m)), strict=True)
    body = (f"{t:.2f},{lat:.{digits}f},{lon:.{digits}f},{alt:.1f}" for t, lat, lon, alt in columns)
    return "\n".join(["time_s,lat_deg,lon_deg,alt_msl_m", *body, ""]).encode()


def nmea_of(log: DriveLog) -> bytes:
    """The same epochs as GGA and RMC, positions to a ten-thousandth of a minute."""
    fix, velocity = log.fix, log.velocity
    lines = []
    for k, time_s in enumerate(fix.time_s.tolist()):
        when = datetime.fromtimestamp(time_s, UTC)
        clock = f"{when:%H%M%S}.{when.microsecond // 10_000:02d}"
        place = f"{minutes(fix.lat_deg[k], 2)},N,{minutes(fix.lon_deg[k], 3)},E"
        north, east = velocity.vel_n_mps[k], velocity.vel_e_mps[k]
        knots, course = math.hypot(north, east) * 3600 / 1852, math.degrees(math.atan2(east, north)) % 360
        lines += [
            sentence(f"GPGGA,{clock},{place},1,12,0.8,{fix.alt_msl_m[k]:.1f},M,48.0,M,,"),
            sentence(f"GPRMC,{clock},A,{place},{knots:.3f},{course:.2f},{when:%d%m%y},,,A"),
        ]
    return "".join(lines).encode()


def minutes(angle_deg: float, digits: int) -> str:
    degrees = int(angle_deg)
    return f"{degrees:0{digits}d}{60 * (angle_deg - degrees):07.4f}"


def sentence(body: str) -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n"


@pytest.fixture
def empty(sessions: Sessions, karlsruhe: Path, tmp_path: Path) -> JobContext:
    """A job context whose database knows the roads around Karlsruhe."""
    road_imports.import_roads(sessions, karlsruhe / "roads_09_10.osm", tmp_path / "dem")
    return JobContext(Settings(data_dir=tmp_path), sessions)


def served(context: JobContext, logs: Logs) -> dict[str, str]:
    """Upload and process; which logs name which other."""
    ids: dict[uuid.UUID, str] = {}
    for name, content in logs.items():
        drive, _ = accept_upload(
            context.sessions, context.blobs, [content], filename=name, method="profile", options=None
        )
        assert process_drive(context, drive.id, drive.generation) is Outcome.DONE
        ids[drive.id] = name
    found = {name: drive_now(context, drive_id).duplicate_of for drive_id, name in ids.items()}
    return {name: ids[other] for name, other in found.items() if other is not None}


def fused(roads: Path, logs: Logs, folder: Path) -> dict[str, str]:
    """The same by ``versant fuse``."""
    fusion = Fusion("profile", parse_options("profile"), read_roads(roads), None)
    for name, content in logs.items():
        path = folder / name
        path.write_bytes(content)
        fusion.add(path)
    again = solve_network(fusion.roads, None, fusion.fused).duplicates
    names = list(logs)
    return {names[k]: names[other] for k, other in again.items()}


def first_seconds(path: Path) -> bytes:
    return b"".join(path.read_bytes().splitlines(keepends=True)[: SECONDS + 1])


@pytest.mark.slow
def test_ten_drives_that_begin_at_one_second_are_ten_drives(
    empty: JobContext, karlsruhe: Path, receiver_log: ReceiverLog, tmp_path: Path
) -> None:
    """Ten receivers along one way at one time, each with errors of its own."""
    logs = {
        f"{seed}.csv": first_seconds(receiver_log("09", tmp_path / "log.csv", seed)) for seed in range(10)
    }
    assert served(empty, logs) == {} == fused(karlsruhe / "roads_09_10.osm", logs, tmp_path)
    assert max(row[2] for row in rows_of(empty.sessions).values()) == 10


@pytest.mark.slow
def test_one_log_in_several_formats_is_one_drive(
    empty: JobContext, karlsruhe: Path, receiver_log: ReceiverLog, tmp_path: Path
) -> None:
    whole = first_seconds(receiver_log("09", tmp_path / "log.csv", 3))
    log = read_log(whole)
    logs = {
        "six.csv": csv_of(log, 6),
        "whole.csv": whole,
        "five.csv": csv_of(log, 5),
        "log.nmea": nmea_of(log),
    }
    found = served(empty, logs)
    assert found == dict.fromkeys(("six.csv", "five.csv", "log.nmea"), "whole.csv")
    assert found == fused(karlsruhe / "roads_09_10.osm", logs, tmp_path)
    assert {row[2] for row in rows_of(empty.sessions).values()} <= {0, 1}
