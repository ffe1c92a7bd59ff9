"""What was promised to be kept survives a power cut: a file is synced before it has its name, its folders after."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from app.core.blobs import LOGS, BlobStore
from app.core.durable import rename_durably
from app.core.mirror import send
from app.core.settings.places import RemoteFolder
from app.upkeep.manifest import keep

Calls = list[tuple[str, str]]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """What the system is asked to do, in order: ``file`` and ``folder`` are synced, ``name`` is given."""
    found: Calls = []
    sync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        path = str(Path(f"/proc/self/fd/{descriptor}").readlink())
        kind = "folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file"
        found.append((kind, path))
        sync(descriptor)

    def named(source: os.PathLike[str], target: os.PathLike[str]) -> None:
        found.append(("name", os.fspath(target)))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", named)
    return found


def assert_durable(calls: Calls, file: Path, *folders: Path) -> None:
    """The file was synced, then named, then its folder synced; and at some time each of those above that were made."""
    at = calls.index(("name", str(file)))
    assert "file" in [kind for kind, _ in calls[:at]]
    assert ("folder", str(file.parent)) in calls[at:]
    assert {("folder", str(folder)) for folder in folders} <= set(calls)


def test_a_blob_its_folder_and_those_that_were_made_for_it(tmp_path: Path, calls: Calls) -> None:
    store = BlobStore(str(tmp_path / "data" / "blobs"), LOGS)
    with store.writer() as writer:
        writer.write(b"log")
        key = writer.finish().key
    root = tmp_path / "data" / "blobs"
    assert_durable(calls, root / key, root, root.parent, tmp_path)
    calls.clear()
    with store.writer() as writer:
        writer.write(b"another")
        second = writer.finish().key
    assert_durable(calls, root / second)


def test_a_blob_that_a_backup_brings_back(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "kept").write_bytes(b"log")
    assert BlobStore(str(tmp_path / "blobs"), LOGS).take(f"{LOGS}/one", tmp_path / "kept")
    assert_durable(calls, tmp_path / "blobs" / LOGS / "one", tmp_path / "blobs", tmp_path)


def test_a_file_that_is_sent_to_a_folder(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "copies" / "group").mkdir(parents=True)
    (tmp_path / "copies" / "group" / "a.tif").write_bytes(b"heights")
    send(RemoteFolder(f"file://{tmp_path}/far", tmp_path / "copies"), ["group/a.tif"])
    far = tmp_path / "far"
    assert_durable(calls, far / "group" / "a.tif", far, tmp_path)


def test_a_file_that_stays_where_it_was_written(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "dem" / "group").mkdir(parents=True)
    (tmp_path / "dem" / "group" / "roads.osm.pbf").write_bytes(b"roads")
    send(tmp_path / "dem", ["group/roads.osm.pbf"])
    group = tmp_path / "dem" / "group"
    assert calls == [
        ("file", str(group / "roads.osm.pbf")), ("folder", str(group)), ("folder", str(group.parent)),
    ]  # fmt: skip


def test_a_file_of_a_backup(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "source").write_bytes(b"log")
    keep(tmp_path / "backup", "logs/one", lambda: (tmp_path / "source").open("rb"))
    backup = tmp_path / "backup"
    assert_durable(calls, backup / "logs" / "one", backup, tmp_path)


def test_all_folders_up_to_the_first_that_was_there(tmp_path: Path, calls: Calls) -> None:
    part = tmp_path / "part"
    part.write_bytes(b"x")
    target = tmp_path / "a" / "b" / "c" / "file"
    rename_durably(part, target)
    assert target.read_bytes() == b"x"
    made = [("folder", str(tmp_path / name)) for name in ("a/b", "a", "")]
    after = [("folder", str(tmp_path / name)) for name in ("a/b/c", "a/b")]
    assert calls == [("file", str(part)), *made, ("name", str(target)), *after]


def test_a_share_whose_folders_cannot_be_synced_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = os.fsync

    def refused(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "Invalid argument")
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", refused)
    (tmp_path / "part").write_bytes(b"x")
    rename_durably(tmp_path / "part", tmp_path / "file")
    assert (tmp_path / "file").read_bytes() == b"x"
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(errno.EIO, "I/O error")))
    (tmp_path / "part").write_bytes(b"y")
    with pytest.raises(OSError, match="I/O"):
        rename_durably(tmp_path / "part", tmp_path / "file")
    assert (tmp_path / "file").read_bytes() == b"x"
