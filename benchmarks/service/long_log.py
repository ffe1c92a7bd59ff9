#!/usr/bin/env python3
"""What a log of a million positions takes of a worker, and how soon a worker hears that its drive was removed.

    PYTHONPATH=.:benchmarks python -m service.long_log [--points 200000,1000000] [--whole 200000] [--removals 6]
        [--roads FILE.osm.pbf] [--dem FILE.hgt] [--json FILE]

A vehicle wanders over the two-way roads of a map (default: Heidelberg, beside the repository) over made-up hills, and a
phone writes a GPX at 1 Hz without a break. A worker with one lane, as ``versant worker`` starts it, computes each log.

    computed           from the beginning of the drive to where all is said and only the map waits
    most               of the lane: its own pages, and its share of those that several processes have (PSS)
    left               the page's estimate after a tenth, a quarter and half of that time, over what then was left
    free               seconds from a DELETE, at moments spread over a computation of the last log and over the
                       writing of its result, to where the lane has given its job up: median and longest of each

With ``--whole`` a log of so many positions is also computed by the library in pieces and as one, and the largest
difference of slopes printed, in sigmas.

Aims: a million positions in 1.5 GB, 0.01 sigma between pieces and the whole, a lane free within 2 s.
"""

from __future__ import annotations

import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psycopg

from accuracy.arguments import ELEVATIONS, REPOSITORY, add_roads, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from fusion.filters import smoother
from fusion.formats import read_log
from fusion.network import pass_columns
from fusion.pipeline import run_drive
from fusion.profile import factors
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.types import Floats
from profile_speed import record
from service.lane_memory import AT_REST_S, Lanes, await_lanes
from service.lane_memory import LOOK_EVERY_S as LANES_EVERY_S
from service.processes import Service
from service.watching import repeated

LOOK_EVERY_S = 0.05
PATIENCE_S = 3600.0
ESTIMATES_AT = (0.1, 0.25, 0.5)
COMPUTED, WRITTEN = "while a drive is computed", "while its result is written"
BEGINS = {COMPUTED: {"status": "running"}, WRITTEN: {"stage": "saving"}}
COLUMNS = {
    "points": ("positions", ",.0f"),
    "file_mb": ("file MB", ".0f"),
    "computed_s": ("computed s", ".0f"),
    "most_mb": ("most MB", ".0f"),
    "left": ("left", ""),
}


def write_gpx(table: RoadTable, points: int, place: Path) -> bytes:
    """A GPX of so many positions, a second apart."""
    fix = record(table.subset(np.flatnonzero(table.oneway == 0)), (points + 2) / 3600, 1)[0].fix
    columns = (fix.time_s, fix.lat_deg, fix.lon_deg, fix.alt_msl_m)
    with place.open("w") as out:
        out.write('<gpx version="1.1" creator="benchmark"><trk><trkseg>\n')
        for time_s, lat, lon, height in zip(*(c[:points].tolist() for c in columns), strict=True):
            moment = datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            out.write(
                f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><ele>{height:.1f}</ele><time>{moment}</time></trkpt>\n'
            )
        out.write("</trkseg></trk></gpx>\n")
    return place.read_bytes()


def main() -> None:
    """Measure, print and write."""
    parser = parser_of(__doc__)
    parser.add_argument("--points", default="200000,1000000")
    parser.add_argument("--whole", type=int, default=200_000, help="0: do not compare with the whole")
    parser.add_argument("--removals", type=int, default=6)
    add_roads(parser)
    parser.add_argument("--dem", type=Path, default=ELEVATIONS)
    args = parser.parse_args()
    table, figures = read_roads(args.roads), dict[str, Any]()
    with tempfile.TemporaryDirectory(prefix="versant-long-") as name:
        folder = Path(name)
        if args.whole:
            show_progress("in pieces and as one")
            figures["apart_sigma"] = apart_sigma(table, write_gpx(table, args.whole, folder / "log.gpx"))
        with EmbeddedPostgres(folder, durable=False) as cluster:
            service = Service(REPOSITORY, libpq_url(cluster.url), folder / "data")
            service.set_up(args.roads, args.dem)
            logs = [int(points) for points in args.points.split(",")]
            figures |= measured(service, table, logs, folder, args.removals)
    show_progress("")
    print(text_table(figures["rows"], COLUMNS))
    if args.whole:
        print(
            f"{args.whole:,} positions in pieces and as one: {figures['apart_sigma']:.1e} sigma apart at most"
        )
    for when, free_s in figures["free_s"].items():
        if free_s:
            print(
                f"{when}: free {np.median(free_s):.1f} s after a removal, {max(free_s):.1f} s at most ({len(free_s)})"
            )
    write_json(args.json, figures)


def apart_sigma(table: RoadTable, log: bytes) -> float:
    """The largest difference of slopes between pieces and the whole, in sigmas of these."""

    def slopes() -> Floats:
        result = run_drive(read_log(log), table, None)[1]
        return np.array([(s.segment, s.slope_percent, s.slope_sigma_percent) for s in result.slopes])

    pieces, most = slopes(), sys.maxsize // 2
    for module, name in (
        (smoother, "PIECE_STEPS"),
        (pass_columns, "PACKED_AT_ONCE"),
        (factors, "PACKED_AT_ONCE"),
    ):
        setattr(module, name, most)
    whole = slopes()
    if not np.array_equal(pieces[:, 0], whole[:, 0]):
        sys.exit("pieces have slopes of other segments")
    return float(np.max(np.abs(pieces[:, 1] - whole[:, 1]) / whole[:, 2]))


def measured(
    service: Service, table: RoadTable, logs: list[int], folder: Path, removals: int
) -> dict[str, Any]:
    """The table, and the seconds after each removal."""
    rows: list[dict[str, Any]] = []
    with (
        service.started("api", "--port", str(service.port)),
        service.started(*service.worker) as worker,
        psycopg.connect(service.url, autocommit=True) as connection,
        httpx.Client(base_url=service.address, trust_env=False, timeout=120) as client,
    ):
        service.await_ready()
        await_lanes(Lanes(worker.pid), 1)
        time.sleep(AT_REST_S)
        for points in logs:
            show_progress(f"{points:,} positions")
            log = write_gpx(table, points, folder / "log.gpx")
            lanes = Lanes(worker.pid)
            with repeated(lanes.look, LANES_EVERY_S):
                address = service.send(log)
                computed_s, written_s, left = computed(client, address)
            rows.append(
                {
                    "points": points, "file_mb": len(log) / 1e6, "computed_s": computed_s,
                    "most_mb": lanes.pss_mb, "left": left,
                }
            )  # fmt: skip
            show_progress(f"{points:,} positions are removed")
            remove(client, connection, address)
        free_s: dict[str, list[float]] = {COMPUTED: [], WRITTEN: [], "after that": []}
        for k in range(2 * removals):
            show_progress(f"removal {k + 1} of {2 * removals}")
            address = service.send(log + b"\n" * (k + 1))
            when, takes_s = (COMPUTED, computed_s) if k < removals else (WRITTEN, written_s)
            await_state(client, address, **BEGINS[when])
            time.sleep(takes_s * (k % removals + 0.5) / removals)
            state = client.get(address).json()
            late = state["stage"] == "publishing" or state["status"] != "running"
            free_s["after that" if late else when].append(remove(client, connection, address))
    return {"rows": rows, "free_s": free_s}


def computed(client: httpx.Client, address: str) -> tuple[float, float, str]:
    """How long a drive is computed and how long of that written, s, and what its page said was left, over what was."""
    await_state(client, address, status="running")
    begin, said, writes_s = time.monotonic(), list[tuple[float, float]](), float("inf")
    while time.monotonic() - begin < PATIENCE_S:
        drive = client.get(address).json()
        if drive["status"] == "failed":
            sys.exit(f"a drive failed: {drive['failure']['reason']}")
        if drive["status"] == "done" or drive["stage"] == "publishing":
            took_s = time.monotonic() - begin
            left = " ".join(_over(said, took_s, share) for share in ESTIMATES_AT)
            return took_s, max(took_s - writes_s, 0.0), left
        if drive["stage"] == "saving":
            writes_s = min(writes_s, time.monotonic() - begin)
        if drive["remaining_s"] is not None:
            said.append((time.monotonic() - begin, drive["remaining_s"]))
        time.sleep(LOOK_EVERY_S)
    sys.exit(f"not computed within {PATIENCE_S:.0f} s")


def _over(said: list[tuple[float, float]], took_s: float, share: float) -> str:
    """What was said to be left after a share of the time, over what was left."""
    after = [(at_s, left_s) for at_s, left_s in said if at_s >= share * took_s]
    return f"{after[0][1] / (took_s - after[0][0]):.1f}" if after else "-"


def await_state(client: httpx.Client, address: str, **state: str) -> None:
    """Until the drive's document has these values."""
    while not state.items() <= client.get(address).json().items():
        time.sleep(LOOK_EVERY_S)


def remove(client: httpx.Client, connection: psycopg.Connection[Any], address: str) -> float:
    """Remove a drive; seconds until no lane is at it."""
    drive, begin = address.rpartition("/")[2], time.monotonic()
    client.delete(address).raise_for_status()
    query = """
        SELECT count(*) FROM procrastinate_jobs
        WHERE status = 'doing' AND args ->> 'drive_id' = %s AND task_name = 'process_drive'
    """
    while (connection.execute(query, (drive,)).fetchone() or (0,))[0]:
        time.sleep(LOOK_EVERY_S)
    free_s = time.monotonic() - begin
    while client.get(address).status_code != httpx.codes.NOT_FOUND:
        time.sleep(LOOK_EVERY_S)
    return free_s


if __name__ == "__main__":
    main()
