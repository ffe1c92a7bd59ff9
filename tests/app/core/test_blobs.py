"""The blob store: whole blobs or none."""

from __future__ import annotations

import hashlib
import os
import tracemalloc
import uuid
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from app.core.blobs import BlobStore
from processing_support import put_blob


@pytest.fixture(params=["folder", "file-url", "memory"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Three ways to say where blobs are kept; the last stands for a bucket."""
    return {
        "folder": str(tmp_path / "blobs"),
        "file-url": (tmp_path / "blobs with space").as_uri(),
        "memory": f"memory://{uuid.uuid4().hex}",
    }[request.param]


def test_what_is_put_can_be_read(url: str) -> None:
    store = BlobStore(url)
    blob = put_blob(store, [b"one", b"", b"two"])
    assert (blob.sha256, blob.size_bytes) == (hashlib.sha256(b"onetwo").hexdigest(), 6)
    with BlobStore(url).open(blob.key) as file:
        assert file.read() == b"onetwo"
    assert store.keys() == [blob.key]


def test_the_same_bytes_twice_are_two_blobs(url: str) -> None:
    store = BlobStore(url)
    first, second = put_blob(store, [b"x"]), put_blob(store, [b"x"])
    store.delete(first.key)
    store.delete(first.key)
    assert store.keys() == [second.key]
    with pytest.raises(FileNotFoundError):
        store.open(first.key)


def test_an_upload_that_breaks_off_leaves_nothing(url: str) -> None:
    def broken() -> Iterator[bytes]:
        yield b"123"
        raise ConnectionError

    store = BlobStore(url)
    with pytest.raises(ConnectionError):
        put_blob(store, broken())
    assert store.keys() == []
    assert store.sweep(timedelta(0)) == 0


def test_the_part_of_a_killed_upload_is_swept_later(url: str) -> None:
    store = BlobStore(url)
    kept = put_blob(store, [b"whole"])
    writer = store.writer()
    writer.write(b"part")
    writer._file.close()  # as the end of the process does
    assert store.keys() == [kept.key]
    assert store.sweep(timedelta(hours=1)) == 0
    assert store.sweep(timedelta(0)) == 1
    assert store.sweep(timedelta(0)) == 0
    assert store.keys() == [kept.key]


def test_only_old_blobs_are_removed(url: str) -> None:
    store = BlobStore(url)
    first, second = put_blob(store, [b"1"]), put_blob(store, [b"2"])
    assert store.remove_old([first.key, second.key], timedelta(hours=1)) == 0
    assert store.remove_old([first.key, "drives/gone"], timedelta(0)) == 1
    assert store.keys() == [second.key]


def test_the_databases_of_a_store_are_noted(url: str) -> None:
    assert BlobStore(url).databases() == []
    for identity in ("a-1", "a-1", "b-2"):
        BlobStore(url).register_database(identity)
    assert [note.rsplit("/", 1)[-1] for note in BlobStore(url).databases()] == ["a-1", "b-2"]


def test_a_large_blob_takes_little_memory(tmp_path: Path) -> None:
    chunk = os.urandom(1 << 20)
    store = BlobStore(str(tmp_path))
    tracemalloc.start()
    try:
        blob = put_blob(store, (chunk for _ in range(64)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert blob.size_bytes == 64 << 20
    assert peak < 8 << 20
