"""``versant sweep``."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from processing_support import accept_upload, put_blob

runner = CliRunner()


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BlobStore:
    """A store that the command finds."""
    monkeypatch.setenv("VERSANT_BLOB_URL", str(tmp_path / "blobs"))
    return BlobStore(str(tmp_path / "blobs"))


@pytest.fixture
def sessions(database_url: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Sessions]:
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    engine = make_engine(database_url)
    yield session_factory(engine)
    engine.dispose()


def test_sweep_lists_what_another_database_may_need_and_removes_it_when_told(
    sessions: Sessions, store: BlobStore, tmp_path: Path
) -> None:
    store.register_database("gone-1")
    drive, _ = accept_upload(sessions, store, [b"a log"], filename="a", method="raw")
    orphan = put_blob(store, [b"old"])
    put_blob(store, [b"new"])
    old = time.time() - 8 * 86_400
    for key in (orphan.key, drive.blob_key):
        os.utime(tmp_path / "blobs" / key, (old, old))
    figures = tmp_path / "figures.json"

    listed = runner.invoke(app, ["sweep", "--json", str(figures)])
    assert listed.exit_code == 0, listed.stderr
    assert orphan.key in listed.stdout
    assert "gone-1" in listed.stdout
    assert json.loads(figures.read_text())["removed"] == 0
    assert len(store.keys()) == 3

    removed = runner.invoke(app, ["sweep", "--only-database", "--json", str(figures)])
    assert removed.exit_code == 0, removed.stderr
    assert removed.stdout == "1 logs without a drive removed.\n"
    assert json.loads(figures.read_text())["orphans"] == [orphan.key]
    assert len(store.keys()) == 2
    assert drive.blob_key in store.keys()  # noqa: SIM118 - no dictionary
