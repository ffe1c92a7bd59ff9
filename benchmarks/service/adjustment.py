"""Part ``service`` of ``adjustment.py``: one more drive through the town published by the database, and taken back."""

from __future__ import annotations

import statistics
import tempfile
import time
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path

from accuracy.adjustment_drives import Synthetic
from app.core.db import Sessions
from app.embedded.cluster import EmbeddedPostgres
from app.network import extracts
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.network.swap import solve_all_marked
from app.roads import imports as roads
from app.roads import store as road_store
from app.roads.documents import USUAL, Source
from fusion.network.pass_factor import PassFactor
from fusion.simulate.scene.town import make_town
from fusion.types import Ints
from service.databases import begun_drive, new_database, vacuum

DRIVES, ROUTE_M = 40, 5_000.0


def append(sessions: Sessions, ids: Ints, factors: Sequence[PassFactor]) -> uuid.UUID:
    """Store what a drive says, as the worker does, and mark what has to be solved."""
    with sessions.begin() as session:
        drive = begun_drive(session).id
    with sessions.begin() as session:
        slopes.begin_change(session, drive, slopes.in_database(factors, ids))
        version = road_store.current_road_version(session)
        assert version is not None  # noqa: S101 - imported at the start
        provenance = slopes.RunProvenance("profile", {}, "1.0", version.id, None)
        slopes.append_result(session, MarkedBy(drive, 1), ids, [], provenance, factors)
    return drive


def publish(sessions: Sessions, ids: Ints, factors: Sequence[PassFactor]) -> uuid.UUID:
    """The same, and solve."""
    drive = append(sessions, ids, factors)
    solve_all_marked(sessions)
    return drive


def take_back(sessions: Sessions, drive: uuid.UUID) -> None:
    """Remove all that a drive says, and solve."""
    with sessions.begin() as session:
        slopes.begin_change(session, drive)
        slopes.append_removal(session, MarkedBy(drive, 1))
    solve_all_marked(sessions)


def service_part(repeat: int) -> dict[str, float]:
    """The town in a database of its own, with the settings of ``versant up``: seconds to publish and to take back."""
    town = make_town()
    synthetic = Synthetic(town.roads)
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
        new_database(cluster, "adjustment") as sessions,
    ):
        roads.bring_in(sessions, town.roads, Source("town.osm", "0" * 64, "town"), Path(folder, "dem"), USUAL)
        with sessions() as session:
            ids = extracts.all_roads(session)[1]
        for _ in range(DRIVES):
            append(sessions, ids, synthetic.drive(synthetic.route(ROUTE_M)))
        solve_all_marked(sessions)
        vacuum(sessions)
        figures = measure(sessions, ids, lambda: synthetic.drive(synthetic.route(ROUTE_M)), repeat)
    print(
        f"service: {DRIVES} drives of {ROUTE_M / 1000:.0f} km through the town; one more published in "
        f"{figures['update_s']:.3f} s, taken back in {figures['removal_s']:.3f} s",
        flush=True,
    )
    return figures


def measure(
    sessions: Sessions, ids: Ints, further: Callable[[], list[PassFactor]], repeat: int
) -> dict[str, float]:
    """Medians over publications and removals of further drives."""
    added, removed = [], []
    for number in range(repeat + 1):
        factors = further()
        times = [time.perf_counter()]
        drive = publish(sessions, ids, factors)
        times.append(time.perf_counter())
        take_back(sessions, drive)
        times.append(time.perf_counter())
        if number:  # the first is to compile
            added.append(times[1] - times[0])
            removed.append(times[2] - times[1])
    return {"update_s": statistics.median(added), "removal_s": statistics.median(removed)}
