"""Part ``service`` of ``adjustment.py``: one more drive published by the database, and taken back."""

from __future__ import annotations

import hashlib
import statistics
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from sqlalchemy import text

from adjustment_drives import Copies, town_drives
from app.core import databases, migrate
from app.core.db import Sessions, make_engine, session_factory
from app.drives import store as drives
from app.embedded.cluster import EmbeddedPostgres
from app.network import extracts, passes
from app.network import results as slopes
from app.network import solve as network
from app.network import versions as locks
from app.roads import imports as roads
from app.roads import store as road_store
from fusion.network.pass_factor import PassFactor
from fusion.simulate.scene.town import make_town
from fusion.types import Ints, SegmentSlope

STEPS = {
    "estimates": (slopes, "_insert_estimates"),
    "passes and evidence": (slopes, "replace_passes"),
    "surroundings": (network, "_surroundings"),
    "evidence around": (network, "_evidence"),
    "solve": (network, "adjust"),
    "write slopes": (network, "_store"),
    "aggregates": (network, "refresh_aggregates"),
}
"""What is timed within a publication: where the service calls it by this name."""


def new_drive(sessions: Sessions) -> uuid.UUID:
    """A drive that a worker has begun."""
    content = uuid.uuid4().hex
    with sessions.begin() as session:
        drive, _ = drives.create_drive(
            session,
            sha256=hashlib.sha256(content.encode()).hexdigest(),
            filename=f"{content}.csv",
            size_bytes=10,
            blob_key=f"drives/{content}",
            method="profile",
            options={},
        )
        drives.mark_running(session, drive.id, drive.generation)
    return drive.id


def estimates_of(factors: Sequence[PassFactor]) -> list[SegmentSlope]:
    """What a drive shows as its own, one estimate a segment."""
    last = {factor.segments[-1]: factor for factor in factors}
    return [
        SegmentSlope(
            row, f.slope_percent, f.slope_sigma_percent, f.observations, 1, f.first_time_s, f.last_time_s
        )
        for row, f in last.items()
    ]


def publish(sessions: Sessions, ids: Ints, factors: Sequence[PassFactor]) -> uuid.UUID:
    """Store what a drive says and renew what is published, as the worker does."""
    drive = new_drive(sessions)
    with sessions.begin() as session:
        locks.own_network(session)
        version = road_store.current_road_version(session)
        assert version is not None  # noqa: S101 - imported at the start
        provenance = slopes.RunProvenance("profile", {}, "1.0", version.id, None)
        slopes.save_result(session, drive, ids, estimates_of(factors), provenance, factors)
    return drive


def take_back(sessions: Sessions, drive: uuid.UUID) -> None:
    """Remove all that a drive says."""
    with sessions.begin() as session:
        locks.own_network(session)
        slopes.remove_result(session, drive)


def store_silently(sessions: Sessions, ids: Ints, factors: Sequence[PassFactor]) -> None:
    """A drive's passes and evidence without a new solution: the way to a thousand drives in minutes."""
    drive = new_drive(sessions)
    with sessions.begin() as session:
        locks.own_network(session)
        passes.replace_passes(session, drive, [slopes._stored(factor, ids) for factor in factors])


@contextmanager
def timed(steps: dict[str, float]) -> Iterator[None]:
    """Note how long each of ``STEPS`` takes."""

    def around(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def timer(*args: Any, **options: Any) -> Any:
            start = time.perf_counter()
            try:
                return work(*args, **options)
            finally:
                steps[name] = steps.get(name, 0.0) + time.perf_counter() - start

        return timer

    patches = [
        mock.patch.object(module, attribute, around(name, getattr(module, attribute)))
        for name, (module, attribute) in STEPS.items()
    ]
    for patch in patches:
        patch.start()
    try:
        yield
    finally:
        for patch in patches:
            patch.stop()


def measure(sessions: Sessions, ids: Ints, copies: Copies, repeat: int) -> dict[str, object]:
    """Publications and removals of further drives: medians, and the steps of the last of each."""
    added: list[float] = []
    removed: list[float] = []
    split: tuple[dict[str, float], dict[str, float]] = ({}, {})
    take_back(sessions, publish(sessions, ids, copies.drive(10**6)))
    for number in range(repeat):
        split = ({}, {})
        factors = copies.drive(10**6 + number)
        start = time.perf_counter()
        with timed(split[0]):
            drive = publish(sessions, ids, factors)
        added.append(time.perf_counter() - start)
        start = time.perf_counter()
        with timed(split[1]):
            take_back(sessions, drive)
        removed.append(time.perf_counter() - start)
    return {
        "update_s": statistics.median(added),
        "update_steps_s": split[0],
        "removal_s": statistics.median(removed),
        "removal_steps_s": split[1],
    }


def service_part(sizes: Sequence[int], repeat: int) -> list[dict[str, object]]:
    """The town in a database of its own, with the settings of ``versant up``."""
    town = make_town()
    copies = Copies.of(town_drives(town))
    out: list[dict[str, object]] = []
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        databases.ensure_database(cluster.url, "adjustment")
        migrate.upgrade(cluster.url_of("adjustment"))
        engine = make_engine(cluster.url_of("adjustment"))
        sessions = session_factory(engine)
        with sessions.begin() as session:
            roads.replace_roads(session, town.roads, "town.osm", "0" * 64)
        with sessions() as session:
            ids = extracts.all_roads(session)[1]
        stored = 0
        for count in sizes:
            start = time.perf_counter()
            while stored < count * len(copies.originals):
                store_silently(sessions, ids, copies.drive(stored))
                stored += 1
            stored_s = time.perf_counter() - start
            with sessions.begin() as session:
                locks.own_network(session)
                network.refresh_in_regions(session, ids.tolist())
            with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
                connection.execute(text("VACUUM ANALYZE"))
            out.append({"drives": count, "stored_s": stored_s, **measure(sessions, ids, copies, repeat)})
            _show(out[-1])
        engine.dispose()
    return out


def _show(f: dict[str, Any]) -> None:
    print(f"service: {f['drives']} drives on each road")
    for name in ("update", "removal"):
        split = sorted(f[f"{name}_steps_s"].items(), key=lambda item: -item[1])
        print(
            f"  {name:8} {f[f'{name}_s']:7.3f} s  ("
            + ", ".join(f"{step} {seconds:.3f}" for step, seconds in split if seconds >= 0.0005)
            + ")",
            flush=True,
        )
