"""Whether the service says of itself that it lives and can be used."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from psycopg.errors import DiskFull
from sqlalchemy.exc import OperationalError

from app.core.errors import kind_of
from app.core.settings import Settings
from problem_support import check


def test_ready_with_everything_in_place(reading: Any) -> None:
    assert reading.client.get("/readyz").json() == {
        "status": "ready",
        "checks": {"database": "ok", "blobs": "ok"},
    }
    assert not list((reading.settings.data_dir / "blobs" / "incoming").iterdir())


def test_without_a_database_the_service_lives_and_is_not_ready(
    tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    nowhere = "postgresql://versant@/none?host=" + str(tmp_path / "no-socket")
    with server_maker(Settings(database_url=nowhere, data_dir=tmp_path)) as web:
        assert web.client.get("/healthz").json()["status"] == "ok"
        problem = check(web.client.get("/readyz"), 503)
        assert [error["field"] for error in problem["errors"]] == ["database"]
        answer = web.client.get("/v1/drives")
        check(answer, 503)
        assert answer.headers["retry-after"]
        assert "no-socket" not in answer.text
        assert "versant_database_up 0.0" in web.client.get("/metrics").text


def test_a_database_that_is_not_migrated_is_not_ready(
    blank_database_url: str, tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    with server_maker(Settings(database_url=blank_database_url, data_dir=tmp_path)) as web:
        assert "versant migrate" in check(web.client.get("/readyz"), 503)["detail"]


def test_a_store_that_cannot_be_written_to_is_not_ready(
    database_url: str, tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    (tmp_path / "blobs").write_text("a file where a folder should be")
    with server_maker(Settings(database_url=database_url, data_dir=tmp_path)) as web:
        problem = check(web.client.get("/readyz"), 503)
        assert [error["field"] for error in problem["errors"]] == ["blobs"]


def test_a_store_without_room_is_not_ready_and_takes_no_upload(
    database_url: str, tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    """Before it is too late: so much is kept free that what runs can end."""
    settings = Settings(database_url=database_url, data_dir=tmp_path, min_free_bytes=2**60)
    with server_maker(settings) as web:
        problem = check(web.client.get("/readyz"), 503)
        assert [error["field"] for error in problem["errors"]] == ["blobs"]
        assert "VERSANT_MIN_FREE_BYTES" in problem["detail"]
        refused = check(web.client.post("/v1/drives", content=b"time_s,lat_deg,lon_deg"), 507)
        assert refused["type"] == "/problems/storage-full"
        assert web.client.get("/v1/drives").json()["drives"] == []
    assert not [path for path in (tmp_path / "blobs").rglob("*") if path.is_file()]


def test_a_full_database_is_no_database_that_is_away() -> None:
    full = OperationalError("INSERT", {}, DiskFull("could not extend file"))
    assert kind_of(full).status == 507
    assert kind_of(OperationalError("INSERT", {}, Exception())).status == 503
