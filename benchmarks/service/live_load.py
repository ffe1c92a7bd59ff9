#!/usr/bin/env python3
"""What ten thousand phones that send by themselves cost, and whether a point is lost when the service is killed.

    PYTHONPATH=.:benchmarks python -m service.live_load [--devices 10000] [--minutes 10] [--points 12] [--every 60]
                                                        [--apis 2] [--kills 2] [--closed 200] [--json FILE]

Each device has an address of its own (a key of scope ``live``) and sends a batch of ``--points`` places once a minute
(``--every``) in the form of Overland, on a connection and at a moment of its own, whatever others wait for. So many
processes of the API and one of workers run on an embedded cluster with the settings of ``versant up``, and ask for
keys. At as many moments as ``--kills``, spread over the run, all of them are killed at once (SIGKILL), and started
again. A device whose batch was not answered well sends it again, a second later, as phones do; and one in ten sends one
twice. The clients, PostgreSQL and whatever else the machine does share its cores with the service.

    sent               batches that were answered well, each counted once
    median, p99, max   ms from the beginning of a request to the end of its answer, of those that were answered well;
                       ``while up``: without those that began within some seconds after a kill
    late               p99 of how much later than its moment a request began, ms: the machine of the clients is too slow
                       where this is not small
    failed             requests that were not answered well, and were sent again
    lost, twice        points that were answered and are not in the database, or are there and were never sent
    closed             what a worker takes for making logs of so many streams, ms each, and points that are in no log

Aims: p99 below 100 ms while the service is up, nothing lost.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psycopg

from accuracy.arguments import REPOSITORY, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core.blobs import BlobStore
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.drives.live.closing import Closer
from app.embedded.cluster import EmbeddedPostgres
from service.databases import sessions_of
from service.live_phones import PATIENCE_S, batch, make_keys, post
from service.processes import Service

AGAIN_S = 1.0
AFTER_KILL_S = 10.0
"""For so long after a kill requests wait for the service to start, and count as disturbed."""
SENT_AGAIN = 0.1
AT_ONCE = 300
"""Connections of the clients: below what one client may hold of each process."""
COLUMNS = {
    "phase": ("", ""),
    "sent": ("sent", "g"),
    "median_ms": ("median", ".1f"),
    "p99_ms": ("p99", ".1f"),
    "max_ms": ("max", ".0f"),
    "late_ms": ("late", ".0f"),
}


@dataclass
class Told:
    """What the clients saw: (began, s after the start; took, s; late, s) of each request that was answered well."""

    answered: list[tuple[float, float, float]] = field(default_factory=list)
    failed: int = 0
    kills_s: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Outcome:
    """What came of it."""

    devices: int
    points_sent: int
    lost: int
    twice: int
    failed: int
    close_ms: float | None
    in_no_log: int | None


def main(argv: Sequence[str] | None = None) -> None:
    """Run it and print what came."""
    parser = parser_of(__doc__)
    parser.add_argument("--devices", type=int, default=10_000)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--points", type=int, default=12)
    parser.add_argument("--every", type=float, default=60.0, metavar="S")
    parser.add_argument("--apis", type=int, default=2)
    parser.add_argument("--kills", type=int, default=2)
    parser.add_argument("--closed", type=int, default=200)
    args = parser.parse_args(argv)
    rows, outcome = on_a_cluster(args)
    show_progress("")
    print(text_table(rows, COLUMNS))
    print(f"{outcome.failed} requests failed and were sent again.")
    print(f"{outcome.lost} of {outcome.points_sent} points are lost, {outcome.twice} were never sent.")
    if outcome.close_ms is not None:
        print(
            f"Closing a stream takes {outcome.close_ms:.1f} ms; {outcome.in_no_log} points are in no log then."
        )
    write_json(args.json, {"rows": rows, **asdict(outcome)})
    if outcome.lost or outcome.twice or outcome.in_no_log:
        sys.exit("points were lost, or made up")


def on_a_cluster(args: argparse.Namespace) -> tuple[list[dict[str, Any]], Outcome]:
    """``measured`` on a database of its own."""
    with (
        tempfile.TemporaryDirectory(prefix="versant-live-") as name,
        EmbeddedPostgres(Path(name) / "cluster") as cluster,
    ):
        service = Service(REPOSITORY, libpq_url(cluster.url), Path(name) / "data")
        service.command("migrate")
        return measured(args, service, Path(name) / "data")


def measured(
    args: argparse.Namespace, service: Service, folder: Path
) -> tuple[list[dict[str, Any]], Outcome]:
    """The rows to print, and what came of the points; ``folder``: the service's data."""
    service.environment = {**service.environment, "VERSANT_ACCESS": "keys"}
    secrets = make_keys(service.url, args.devices)
    servers = Servers(service, args.apis)
    servers.start()
    try:
        told = asyncio.run(load(args, secrets, servers))
    finally:
        servers.stop()
    sent = args.devices * batches_of(args) * args.points
    lost, twice = compared(service.url, sent)
    close_ms, in_no_log = closed(service.url, folder, args.closed) if args.closed else (None, None)
    outcome = Outcome(args.devices, sent, lost, twice, told.failed, close_ms, in_no_log)
    return rows_of(told), outcome


def batches_of(args: argparse.Namespace) -> int:
    """How many each device sends."""
    return max(1, int(60 * args.minutes / args.every + 0.5))


class Servers:
    """The processes of the service, which are killed and started together."""

    def __init__(self, service: Service, apis: int) -> None:
        """Each process of the API has a port of its own."""
        self.service = service
        self.ports = [service.port + 1000 * k for k in range(apis)]
        self._running: list[subprocess.Popen[bytes]] = []

    def start(self) -> None:
        """Start them; returns when all answer."""
        commands = [("api", "--port", str(port)) for port in self.ports]
        self._running = [self.service.begin(*one) for one in (*commands, self.service.worker)]
        for port in self.ports:
            self.service.address = f"http://127.0.0.1:{port}"
            self.service.await_ready()

    def stop(self, how: signal.Signals = signal.SIGTERM) -> None:
        """End them, with what they have started."""
        for one in self._running:
            with suppress(ProcessLookupError):
                os.killpg(one.pid, how)
        for one in self._running:
            one.wait(60)

    def kill(self) -> None:
        """As a power cut would, and start them again."""
        self.stop(signal.SIGKILL)
        self.start()


async def load(args: argparse.Namespace, secrets: Sequence[str], servers: Servers) -> Told:
    """Let all devices send all of their batches, and kill the service meanwhile."""
    told, began_s = Told(), int(time.time()) - 3600
    start = time.perf_counter()
    room, chance = asyncio.Semaphore(AT_ONCE), np.random.default_rng(1)

    async def send(device: int, number: int, due_s: float) -> None:
        body = batch(device, number, args.points, began_s)
        port = servers.ports[device % len(servers.ports)]
        while True:
            async with room:
                begin = time.perf_counter()
                is_answered = await post(port, secrets[device], body)
            took_s = time.perf_counter() - begin
            if is_answered:
                told.answered.append((begin - start, took_s, begin - start - due_s))
                return
            told.failed += 1
            await asyncio.sleep(AGAIN_S)
            due_s = time.perf_counter() - start

    async def kill() -> None:
        for number in range(args.kills):
            due_s = 60 * args.minutes * (number + 1) / (args.kills + 1)
            await asyncio.sleep(max(0.0, due_s - (time.perf_counter() - start)))
            told.kills_s.append(time.perf_counter() - start)
            await asyncio.to_thread(servers.kill)

    killing = asyncio.create_task(kill())
    sending: set[asyncio.Task[None]] = set()
    moments = sorted(
        (args.every * (number + device / args.devices), device, number)
        for number in range(batches_of(args))
        for device in range(args.devices)
    )
    for due_s, device, number in moments:
        wait_s = due_s - (time.perf_counter() - start)
        if wait_s > 0:
            await asyncio.sleep(wait_s)
        for _ in range(1 + (chance.uniform() < SENT_AGAIN)):
            task = asyncio.create_task(send(device, number, due_s))
            sending.add(task)
            task.add_done_callback(sending.discard)
        show_progress(f"{len(told.answered)} of {len(moments)} batches")
    await killing
    while sending:
        await asyncio.wait(sending)
    return told


def compared(url: str, sent: int) -> tuple[int, int]:
    """Points that are lost, and those that were never sent: each device's places are told by its road and time."""
    query = """
        SELECT count(*),
               count(*) FILTER (WHERE abs(p.lat_deg - 47.0 - split_part(k.label, ' ', 2)::int % 100 * 0.02
                                          - n.at * 0.0006) > 1e-9)
        FROM (SELECT *, row_number() OVER (PARTITION BY stream_id ORDER BY time_us) - 1 AS at FROM live_points) AS n
        JOIN live_points AS p USING (stream_id, time_us)
        JOIN live_streams AS s ON s.id = p.stream_id JOIN keys AS k ON k.id = s.key_id
    """
    with psycopg.connect(url) as connection:
        there, elsewhere = connection.execute(query).fetchone() or (0, 0)
    return max(0, sent - there), max(0, there - sent) + elsewhere


def closed(url: str, folder: Path, streams: int) -> tuple[float, int]:
    """What a worker takes to make logs of so many streams that are silent: ms for each, and points that are left."""
    choose = "CREATE TEMP TABLE chosen AS SELECT id FROM live_streams ORDER BY id LIMIT %s"
    silence = """
        UPDATE live_streams SET due_at = now(), seen_at = now() - interval '1 hour' WHERE id IN (SELECT id FROM chosen)
    """
    left = "SELECT count(*) FROM live_points WHERE stream_id IN (SELECT id FROM chosen)"
    settings = Settings(database_url=url, data_dir=folder)
    with psycopg.connect(url, autocommit=True) as connection, sessions_of(url) as sessions:
        connection.execute(choose, (streams,))
        count = connection.execute(silence).rowcount
        closer = Closer(sessions, BlobStore(settings.blob_store_url), settings)
        begin = time.perf_counter()
        while closer.look():
            pass
        took_s = time.perf_counter() - begin
        (in_no_log,) = connection.execute(left).fetchone() or (0,)
    return 1000 * took_s / max(1, count), in_no_log


def rows_of(told: Told) -> list[dict[str, Any]]:
    """What is printed of the requests."""
    began_s, took_s, late_s = np.array(told.answered, float).reshape(-1, 3).T
    up = np.ones(len(began_s), bool)
    for kill_s in told.kills_s:
        up &= (began_s < kill_s - PATIENCE_S / 10) | (began_s > kill_s + AFTER_KILL_S)
    return [_row("all", took_s, late_s), _row("while up", took_s[up], late_s[up])]


def _row(phase: str, took_s: Any, late_s: Any) -> dict[str, Any]:
    if not len(took_s):
        return {"phase": phase, "sent": 0}
    return {
        "phase": phase,
        "sent": len(took_s),
        "median_ms": 1000 * float(np.median(took_s)),
        "p99_ms": 1000 * float(np.quantile(took_s, 0.99)),
        "max_ms": 1000 * float(took_s.max()),
        "late_ms": 1000 * float(np.quantile(late_s, 0.99)),
    }


if __name__ == "__main__":
    main()
