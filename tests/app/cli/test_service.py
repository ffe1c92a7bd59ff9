"""``versant api`` as a process of its own, under the limits that its system sets."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from server_support import asking_from, holding, wait_until

REPOSITORY = Path(__file__).resolve().parents[3]
HALF = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-Slow: "


@contextmanager
def api(database_url: str, folder: Path, limit: str) -> Iterator[Any]:
    """It runs with a limit of open files, as ``ulimit`` takes it."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    clean = {name: value for name, value in os.environ.items() if not name.startswith("VERSANT_")}
    ours = {
        "VERSANT_DATABASE_URL": database_url,
        "VERSANT_DATA_DIR": str(folder),
        "VERSANT_ACCESS": "open",
        "VERSANT_LOG_LEVEL": "ERROR",
    }
    command = f'ulimit {limit}; exec "{sys.executable}" -m app.cli api --port {port}'
    process = subprocess.Popen(["bash", "-c", command], cwd=REPOSITORY, env=clean | ours)
    web = SimpleNamespace(base=f"http://127.0.0.1:{port}")

    def ready() -> bool:
        assert process.poll() is None, "it ended"
        try:
            return bool(httpx.get(f"{web.base}/readyz", trust_env=False).is_success)
        except httpx.TransportError:
            return False

    try:
        wait_until(ready, 60)
        yield web
    finally:
        process.terminate()
        process.wait(30)


@pytest.mark.parametrize("limit", ["-n 400", "-S -n 400"])
def test_half_requests_do_not_take_all_files(database_url: str, tmp_path: Path, limit: str) -> None:
    """More of them than the process may have files: probes and others are answered all the same."""
    with (
        api(database_url, tmp_path, limit) as web,
        holding(web, HALF, 700, client="127.0.0.2"),
        asking_from(web, "127.0.0.1") as client,
        asking_from(web, "127.0.0.2") as same,
    ):
        for path in ("/healthz", "/readyz", "/v1/drives", "/tiles.json"):
            assert client.get(path, timeout=10).status_code == 200
        assert same.get("/healthz", timeout=10).status_code == 200
