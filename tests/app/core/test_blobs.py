"""The blob store: whole blobs or none."""

from __future__ import annotations

import gzip
import hashlib
import os
import shutil
import subprocess
import sys
import uuid
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import fsspec
import pytest

from app.core.blobs import BlobStore
from app.core.errors import StorageFullError
from app.core.settings import SettingsError
from processing_support import put_blob


@pytest.fixture(params=["folder", "file-url", "memory", "bucket"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Ways to say where blobs are kept."""
    if request.param == "bucket":
        return f"{request.getfixturevalue('bucket')}/logs"
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


def test_blobs_in_a_folder_go_together(url: str, tmp_path: Path) -> None:
    store, file = BlobStore(url, "editions"), tmp_path / "file"
    file.write_bytes(b"x")
    for key in ("editions/1-a/one", "editions/1-a/two", "editions/2-b/one"):
        assert store.take(key, file)
    assert store.keys() == ["editions/1-a", "editions/2-b"]
    store.delete_folder("editions/1-a")
    store.delete_folder("editions/1-a")
    assert store.keys() == ["editions/2-b"]
    assert store.exists("editions/2-b/one") and not store.exists("editions/1-a/one")


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
    writer._file.close()  # as the end of the process does to a folder's; of a bucket's nothing is to be seen
    assert store.keys() == [kept.key]
    assert store.sweep(timedelta(hours=1)) == 0
    assert store.sweep(timedelta(0)) == 1
    assert store.sweep(timedelta(0)) == 0
    assert store.keys() == [kept.key]


def test_old_blobs_are_told(url: str) -> None:
    store = BlobStore(url)
    first, second = put_blob(store, [b"1"]), put_blob(store, [b"2"])
    assert store.older([first.key, second.key], timedelta(hours=1)) == []
    assert store.older([first.key, "drives/gone"], timedelta(0)) == [first.key]
    assert store.exists(second.key)
    assert not store.exists("drives/gone")


def test_the_databases_of_a_store_are_noted(url: str) -> None:
    assert BlobStore(url).databases() == []
    for identity in ("a-1", "a-1", "b-2"):
        BlobStore(url).register_database(identity)
    assert BlobStore(url).databases() == ["a-1", "b-2"]
    BlobStore(url).forget_databases(but="b-2")
    assert BlobStore(url).databases() == ["b-2"]


PEAK_OF_A_LARGE_BLOB = """
import sys, tracemalloc
from app.core.blobs import BlobStore
chunk = bytes(1 << 20)
store = BlobStore(sys.argv[1])
tracemalloc.start()
with store.writer() as writer:
    for _ in range(64):
        writer.write(chunk)
    blob = writer.finish()
print(blob.size_bytes, tracemalloc.get_traced_memory()[1])
"""


@pytest.mark.slow
def test_a_large_blob_takes_little_memory(tmp_path: Path) -> None:
    """In a process of its own: whatever else runs in this one would count."""
    done = subprocess.run(
        [sys.executable, "-c", PEAK_OF_A_LARGE_BLOB, str(tmp_path)],
        capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    size, peak = map(int, done.stdout.split())
    assert size == 64 << 20
    assert peak < 8 << 20


def fill(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the next blob of a folder be written to the device that is always full."""
    name = uuid.uuid4()
    incoming = Path(url) / "incoming"
    incoming.mkdir(parents=True, exist_ok=True)
    (incoming / name.hex).symlink_to("/dev/full")
    monkeypatch.setattr("app.core.blobs.uuid.uuid4", lambda: name)


@pytest.mark.parametrize("size_bytes", [1, 1 << 20])
def test_a_full_disk_is_told_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size_bytes: int
) -> None:
    store = BlobStore(str(tmp_path))
    fill(str(tmp_path), monkeypatch)
    with pytest.raises(StorageFullError, match="full"):
        put_blob(store, [bytes(size_bytes)])
    assert files_in(tmp_path) == []
    fill(str(tmp_path), monkeypatch)
    with pytest.raises(OSError, match="No space left"):
        store.probe()
    assert files_in(tmp_path) == []


def files_in(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_symlink() or path.is_file()]


def test_room_that_is_to_stay_free_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = BlobStore(str(tmp_path / "not" / "there" / "yet"))
    free = store.free_bytes()
    assert free is not None
    assert 0 < free <= shutil.disk_usage(tmp_path).total
    monkeypatch.setattr("app.core.filesystems.free_bytes", lambda fs, root: 1000)
    with pytest.raises(StorageFullError):
        store.writer(keep_free_bytes=900, expected_bytes=101)
    with store.writer(keep_free_bytes=900, expected_bytes=100) as writer, pytest.raises(StorageFullError):
        writer.write(bytes(101))
    assert files_in(tmp_path) == []


def test_of_a_bucket_nobody_knows_how_full_it_is(bucket: str) -> None:
    store = BlobStore(bucket)
    assert store.free_bytes() is None
    store.probe()
    assert fsspec.filesystem("s3").find(bucket) == []


def test_a_large_upload_to_a_bucket_that_breaks_off_is_not_completed(bucket: str) -> None:
    store = BlobStore(bucket)
    with store.writer() as writer:
        for _ in range(20):
            writer.write(bytes(1 << 20))
    found = fsspec.filesystem("s3")
    assert found.find(bucket) == []
    assert "Uploads" not in found.call_s3("list_multipart_uploads", Bucket=bucket.removeprefix("s3://"))


@pytest.mark.slow
def test_a_large_blob_of_a_bucket_goes_in_parts(bucket: str) -> None:
    store = BlobStore(bucket)
    chunk = os.urandom(1 << 20)
    blob = put_blob(store, (chunk for _ in range(40)))
    with store.open(blob.key) as file:
        assert hashlib.file_digest(file, "sha256").hexdigest() == blob.sha256
    assert store.keys() == [blob.key]


def test_a_bucket_that_is_not_there_is_not_made(bucket: str) -> None:
    with pytest.raises(FileNotFoundError):
        put_blob(BlobStore(f"{bucket}-mistyped/logs"), [b"x"])
    assert not fsspec.filesystem("s3").exists(f"{bucket}-mistyped")


@pytest.mark.parametrize("url", ["nonsense://x/y", "s3://x/y"])
def test_a_storage_without_its_driver_says_what_to_install(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)
    monkeypatch.delitem(sys.modules["fsspec.registry"]._registry, "s3", raising=False)
    with pytest.raises(SettingsError, match=r"versant\[s3\]"):
        BlobStore(url)


def test_what_a_blob_unpacks_to_is_told(url: str) -> None:
    store = BlobStore(url)
    plain, packed = put_blob(store, [b"a log"]), put_blob(store, [gzip.compress(b"a log")])
    assert plain.content_sha256 == packed.content_sha256 == plain.sha256 != packed.sha256
