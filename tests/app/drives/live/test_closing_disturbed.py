"""Nothing is lost whoever dies, and no order of points makes another drive."""

from __future__ import annotations

import contextlib
import random
import threading
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from app.core.caller import Caller, as_caller, guarded
from app.drives import intake, queue
from app.drives import store as drives
from app.drives.live import store
from app.drives.live.closing import Closer
from app.drives.live.cutting import cut, log_of
from app.drives.live.points import US
from live_senders import osmand, overland, way
from live_support import Live, close, expected, logs, silent
from many_drives import rows

HOUR_S = 3600


class Died(BaseException):
    """The process is killed here."""


def killed_at(patch: pytest.MonkeyPatch, place: tuple[Any, str], *, after: bool) -> None:
    """Let a worker die before or after it does that."""
    module, name = place
    genuine: Callable[..., Any] = getattr(module, name)

    def dies(*arguments: Any, **options: Any) -> Any:
        if after:
            genuine(*arguments, **options)
        raise Died

    patch.setattr(module, name, dies)


PLACES = [
    (intake, "register_upload"),
    (queue, "enqueue"),
    (store, "note_drive"),
    (store, "look_again"),
    (drives, "replace_log"),
    (drives, "request_removal"),
]


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("place", PLACES, ids=lambda place: place[1])
def test_a_worker_that_dies_while_it_closes_loses_nothing(
    live: Live, place: tuple[Any, str], *, after: bool
) -> None:
    points = way(120, every_s=30.0)
    first, middle, last = points[:40], points[40:80], points[80:]
    for part in (first, last, middle):
        live.send("osmand", osmand(part, "x"))
        with pytest.MonkeyPatch.context() as patch:
            killed_at(patch, place, after=after)
            silent(live.web.sessions)
            with contextlib.suppress(Died):
                Closer(live.web.sessions, live.web.blobs, live.web.settings).look()
        close(live.web)
    assert logs(live) == [expected(points)]
    assert live.waiting() == 0


def test_four_workers_make_each_drive_once(live: Live) -> None:
    for number in range(12):
        live.send("overland", overland(way(40, first=number), f"device {number:02d}"))
    silent(live.web.sessions)
    start = threading.Barrier(4)

    def work() -> None:
        closer = Closer(live.web.sessions, live.web.blobs, live.web.settings)
        start.wait()
        while closer.look():
            pass

    workers = [threading.Thread(target=work) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert [one["filename"][9:18] for one in live.drives()] == [f"device {k:02d}" for k in range(12)]
    assert live.waiting() == 0
    assert len(live.web.blobs.keys()) == 12


DRIVES_OF = """
    SELECT d.blob_key FROM drives AS d JOIN live_drives AS l ON l.drive_id = d.id
    JOIN live_streams AS s ON s.id = l.stream_id WHERE s.device = :device
"""
NUMBERS = iter(range(10**6))
EVERY = way(60, every_s=30.0)
TRIPS = [p._replace(time_us=p.time_us + (k // 20) * 2 * HOUR_S * US) for k, p in enumerate(EVERY)]
"""Three trips with an hour and more between."""


@hypothesis_settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    order=st.randoms(use_true_random=False),
    sizes=st.lists(st.integers(1, 25), min_size=1, max_size=12),
    repeats=st.integers(0, 3),
    closings=st.sets(st.integers(0, 12), max_size=3),
)
def test_any_order_and_any_repetition_give_the_same_logs(
    live: Live, order: random.Random, sizes: list[int], repeats: int, closings: set[int]
) -> None:
    """Also where silence comes in between, and closes what is not whole yet."""
    number = next(NUMBERS)
    device, trips = f"d{number}", [p._replace(lat_deg=p.lat_deg + 0.001 * number) for p in TRIPS]
    points = trips.copy()
    order.shuffle(points)
    batches = []
    for size in sizes:
        batches.append(points[:size])
        points = points[size:]
    batches += [points, *order.choices(batches, k=repeats)]
    whose = Caller("live", live.keyed.a.id, live.keyed.a.own.key_id)
    sessions = guarded(live.web.sessions)
    for sent, batch in enumerate(batches):
        with as_caller(whose), sessions.begin() as session:
            store.add_points(session, "osmand", device, batch, silence_s=900.0)
        if sent in closings:
            close(live.web)
    close(live.web)
    close(live.web)
    wanted = [log_of(trips[piece.begin : piece.end]) for piece in cut(trips, 900 * US)]
    found = sorted(
        live.web.blobs.open(key).read()
        for (key,) in rows(live.web.sessions, DRIVES_OF + " AND d.status <> 'cancelled'", device=device)
    )
    assert found == sorted(wanted)
    assert len(wanted) == 3
    assert live.waiting() == 0
