"""The whole service through a pooler that has fewer connections to the server than the service has processes."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.map.tiles.store import column_of, row_of
from fusion.simulate.demonstration import Demonstration
from pooler_fixtures import Pooler, pooler
from soak.servers import PgBouncer
from tests.end_to_end.conftest import COMMAND_S, REPOSITORY, START_S, STOP_S, await_true, environment

__all__ = ["pooler"]

pytestmark = pytest.mark.long("the whole service as processes of its own, once more")

SERVERS = 3
ZOOM = 14


@dataclass
class Pooled:
    """API and workers as processes of their own, on a database behind PgBouncer."""

    pooler: PgBouncer
    direct_url: str
    data_dir: Path
    address: str
    logs: Path

    @property
    def settings(self) -> dict[str, str]:
        """The environment of every process of it."""
        return environment(
            VERSANT_DATABASE_URL=self.pooler.url,
            VERSANT_DATABASE_POOLED="true",
            VERSANT_DATABASE_DIRECT_URL=self.direct_url,
            VERSANT_DATA_DIR=str(self.data_dir),
            VERSANT_ACCESS="open",
            VERSANT_PUBLIC_MAP="releases",
            VERSANT_PUBLISH_EVERY_S="0",
        )

    @contextmanager
    def running(self, *arguments: str) -> Iterator[None]:
        """One of its processes, ended in order."""
        with (self.logs / arguments[0]).open("w") as log:
            command = [sys.executable, "-m", "app.cli", *arguments]
            process = subprocess.Popen(command, cwd=REPOSITORY, env=self.settings, stdout=log, stderr=log)
            try:
                yield
            finally:
                process.terminate()
                try:
                    process.wait(STOP_S)
                finally:
                    process.kill()

    def versant(self, *arguments: str | Path) -> str:
        """Run a command to its end; what it says."""
        done = subprocess.run(
            [sys.executable, "-m", "app.cli", *map(str, arguments)],
            cwd=REPOSITORY,
            env=self.settings,
            capture_output=True,
            text=True,
            timeout=COMMAND_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def said(self) -> str:
        """All that the processes wrote."""
        return "".join(path.read_text() for path in self.logs.iterdir())


@pytest.fixture
def service(pooler: Pooler, database_url: str, simulated: Demonstration, tmp_path: Path) -> Iterator[Pooled]:
    with ExitStack() as stack:
        pgbouncer = stack.enter_context(pooler(database_url, SERVERS))
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        (tmp_path / "logs").mkdir()
        one = Pooled(
            pgbouncer, database_url, tmp_path / "data", f"http://127.0.0.1:{port}", tmp_path / "logs"
        )
        one.versant("migrate")
        one.versant("import-roads", simulated.osm)
        one.versant("import-dem", simulated.dem)
        stack.enter_context(one.running("api", "--port", str(port)))
        stack.enter_context(one.running("worker", "--concurrency", "2"))
        await_true(lambda: is_ready(one.address), START_S, "the API did not start")
        yield one


def is_ready(address: str) -> bool:
    try:
        return httpx.get(f"{address}/readyz", trust_env=False).is_success
    except httpx.TransportError:
        return False


def followed(client: httpx.Client, drive: str) -> list[str]:
    """The states that the drive's event stream tells, to its end."""
    with client.stream("GET", f"/v1/drives/{drive}/events", timeout=COMMAND_S) as answer:
        told = [line.removeprefix("data:") for line in answer.iter_lines() if line.startswith("data:")]
    return [json.loads(one)["status"] for one in told]


def test_everything_goes_through_fewer_connections_than_there_are_processes(
    service: Pooled, simulated: Demonstration
) -> None:
    most, over = [0], threading.Event()

    def watch() -> None:
        while not over.wait(0.2):
            most[0] = max(most[0], service.pooler.connections()[1])

    watching = threading.Thread(target=watch)
    watching.start()
    try:
        with httpx.Client(base_url=service.address, timeout=60, trust_env=False) as client:
            use(service, client, simulated)
    finally:
        over.set()
        watching.join()
    assert 0 < most[0] <= SERVERS
    said = service.said()
    assert "Traceback" not in said, said
    assert "prepared statement" not in said, said


def use(service: Pooled, client: httpx.Client, simulated: Demonstration) -> None:
    """From the upload to the removal."""
    log = simulated.drives[0]
    sent = client.post("/v1/drives", files={"file": (log.name, log.read_bytes())})
    first = sent.raise_for_status().json()
    assert followed(client, first["id"])[-1] == "done"
    service.versant("upload", *simulated.drives[1:], "--server", service.address, "--wait")
    driven = items(client)
    assert driven
    lon, lat = driven[0]["geometry"]["coordinates"][0]
    x, y = column_of(ZOOM, lon), row_of(ZOOM, lat)
    tiles = [client.get(f"/tiles/{ZOOM}/{x}/{y}.mvt").raise_for_status() for _ in range(3)]
    assert tiles[0].content
    assert {tile.headers["etag"] for tile in tiles} == {tiles[0].headers["etag"]}
    assert tiles[0].headers["etag"] != ""

    export = client.post("/v1/exports", json={"format": "csv"}).raise_for_status().json()["id"]
    await_true(lambda: state(client, f"/v1/exports/{export}") == "done", COMMAND_S, "the export is not done")
    assert len(client.get(f"/v1/exports/{export}/file").raise_for_status().content) > 1000

    assert re.match(r"Edition \d+ of", service.versant("release"))
    service.versant("import-roads", simulated.osm)
    client.delete(f"/v1/drives/{first['id']}").raise_for_status()
    gone = f"/v1/drives/{first['id']}"
    await_true(lambda: client.get(gone).status_code == 404, COMMAND_S, "the drive is not gone")
    before = passes(driven)
    await_true(lambda: passes(items(client)) < before, COMMAND_S, "the map still tells of the drive")


def passes(features: list[dict[str, Any]]) -> int:
    """How many drives stand behind the segments, each counted as often as it is behind one."""
    return sum(one["properties"]["drives"] for one in features)


def items(client: httpx.Client) -> list[dict[str, Any]]:
    answer = client.get(
        "/collections/segments/items", params={"driven": "true", "limit": 5000}
    ).raise_for_status()
    return list(answer.json()["features"])


def state(client: httpx.Client, path: str) -> str:
    return str(client.get(path).raise_for_status().json()["status"])
