"""Exports in the queue: made by workers, also by the next one where the first was killed, and into a bucket."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec
import httpx
import pytest
from sqlalchemy import text

from app.cli.children import child_environment
from app.core.blobs import BlobStore
from app.core.settings import Settings
from app.drives.worker import run_worker
from app.exports.run import EXPORT
from app.jobs.requests.upkeep import look_after
from app.upkeep.backup import back_up
from web_fixtures import Web

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 120.0
_HANGS = """
import time
from app.core.settings import Settings
from app.drives.worker import run_worker
from app.exports import run

run._in_room = lambda run, work: (work(), time.sleep(600))
run_worker(Settings(), with_chores=False)
"""


def ask(web: Web, name: str = "csv", **more: Any) -> str:
    answer = web.client.post("/v1/exports", json={"format": name, **more})
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def status(web: Web, export: str) -> str:
    return str(web.client.get(f"/v1/exports/{export}").json()["status"])


def test_a_worker_makes_what_waits(driven: Web) -> None:
    asked = [ask(driven, name) for name in ("csv", "flatgeobuf", "pmtiles")]
    run_worker(driven.settings, wait=False, with_chores=False)
    assert [status(driven, export) for export in asked] == ["done"] * 3
    with driven.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 0


def test_one_whose_job_is_lost_gets_another(driven: Web) -> None:
    """As where a worker of a version before takes a job that it does not know."""
    export = ask(driven)
    with driven.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET status = 'failed'"))
    for _ in range(2):
        look_after(EXPORT, driven.context)
    with driven.sessions() as session:
        query = "SELECT args ->> 'export_id' FROM procrastinate_jobs WHERE status = 'todo'"
        assert list(session.execute(text(query)).scalars()) == [export]


@pytest.mark.slow
def test_a_worker_that_is_killed_leaves_no_file_and_another_makes_it(driven: Web) -> None:
    export = ask(driven)
    settings = driven.settings.model_copy(update={"heartbeat_interval_s": 0.5, "stalled_after_s": 1.0})
    environment = os.environ | child_environment(settings)
    blobs = BlobStore(settings.blob_store_url, "exports")
    with subprocess.Popen([sys.executable, "-c", _HANGS], cwd=REPOSITORY, env=environment) as process:
        try:
            until = time.monotonic() + PATIENCE_S
            folders: list[Path] = []
            while not folders or not any(folders[0].iterdir()):
                assert time.monotonic() < until
                time.sleep(0.05)
                folders = list((settings.data_dir / "exports").glob(f"{export}-1"))
        finally:
            process.kill()
    assert (status(driven, export), blobs.keys()) == ("running", [])
    time.sleep(1.2)
    run_worker(settings, wait=False, with_chores=False)
    assert status(driven, export) == "done"
    assert len(blobs.keys()) == 1
    assert driven.client.get(f"/v1/exports/{export}/file").status_code == 200


def test_a_bucket_keeps_files_that_are_fetched_in_parts(
    driven: Web,
    bucket: str,
    server_maker: Callable[[Settings], Any],
    work: Callable[..., list[str]],
) -> None:
    settings = driven.settings.model_copy(update={"blob_url": f"{bucket}/store"})
    with server_maker(settings) as web:
        export = ask(web, "geojson")
        assert work(web) == ["done"]
        there = fsspec.filesystem("s3", use_listings_cache=False)
        (key,) = there.ls(f"{bucket}/store/exports")
        address = f"/v1/exports/{export}/file"
        whole: httpx.Response = web.client.get(address)
        part = web.client.get(
            address, headers={"Range": "bytes=1000-1999", "If-Range": whole.headers["etag"]}
        )
        assert (part.status_code, part.content) == (206, whole.content[1000:2000])
        assert web.client.delete(f"/v1/exports/{export}").status_code == 204
        assert not there.exists(key)


def test_a_backup_leaves_exports_out(driven: Web, work: Callable[..., list[str]], tmp_path: Path) -> None:
    ask(driven)
    work(driven)
    manifest = back_up(driven.settings, driven.sessions, tmp_path / "copy")
    assert not [entry.path for entry in manifest.files if "exports" in entry.path]
    listed = subprocess.run(
        ["pg_restore", "--list", str(tmp_path / "copy" / manifest.dump.path)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert " TABLE public exports " in listed
    assert " TABLE DATA public exports " not in listed


def test_what_is_asked_for_by_a_former_version_is_a_failure_with_a_reason(
    driven: Web, work: Callable[..., list[str]]
) -> None:
    export = ask(driven)
    with driven.sessions.begin() as session:
        session.execute(text("""UPDATE exports SET request = request || '{"format": "shapefile"}'"""))
    assert work(driven) == ["failed"]
    failure = driven.client.get(f"/v1/exports/{export}").json()["failure"]
    assert "shapefile" in failure["reason"]
    assert uuid.UUID(export)


@pytest.mark.parametrize(("lanes", "at_once"), [(1, 1), (7, 1), (8, 2), (12, 3)])
def test_one_of_four_lanes_may_make_exports(web: Web, lanes: int, at_once: int) -> None:
    with web.sessions.begin() as session:
        session.execute(text("DELETE FROM procrastinate_workers"))
        session.execute(
            text(
                "INSERT INTO procrastinate_workers (last_heartbeat) SELECT now() FROM generate_series(1, :n)"
            ),
            {"n": lanes},
        )
    for k in range(6):
        ask(web, bbox=[8.3, 48.9, 8.41 + k / 100, 49.02])
    with web.sessions() as session:
        locks = session.execute(
            text("SELECT lock, count(*) FROM procrastinate_jobs GROUP BY lock ORDER BY lock")
        ).all()
    assert [tuple(row) for row in locks] == [
        (name, 6 // at_once) for name in ("exports", "exports 1", "exports 2")[:at_once]
    ]
