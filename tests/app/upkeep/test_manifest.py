"""What makes a folder a backup, and what makes it none."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

from app.core.migrate import latest_revision
from app.upkeep.dumps import BackupError
from app.upkeep.manifest import Manifest, alone_in, keep, read_manifest, write_manifest
from app.upkeep.restore import checked

VERSIONS = {
    "versant": "1",
    "revision": latest_revision(),
    "postgres_major": 15,
    "postgres": "15.1",
    "postgis": "3.3",
}


def made(folder: Path, names: tuple[str, ...] = ("a", "b")) -> Manifest:
    """A small backup."""
    with alone_in(folder):
        dump = keep(folder, "database-1.dump", lambda: BytesIO(b"dump"))
        files = tuple(
            keep(folder, f"blobs/drives/{name}", lambda n=name: BytesIO(n.encode())) for name in names
        )  # type: ignore[misc]
        manifest = Manifest("2026-01-01", VERSIONS, "me", len(names), 0, dump, files)
        write_manifest(folder, manifest)
    return manifest


def test_what_is_written_is_read_and_what_is_not_named_any_more_goes(tmp_path: Path) -> None:
    manifest = made(tmp_path)
    assert checked(tmp_path) == read_manifest(tmp_path) == manifest
    assert manifest.size_bytes == 6
    (tmp_path / "note.txt").write_text("mine")
    less = made(tmp_path, ("b",))
    assert checked(tmp_path) == less
    assert not (tmp_path / "blobs/drives/a").exists()
    assert (tmp_path / "note.txt").exists()


@pytest.mark.parametrize(
    ("harm", "says"),
    [
        ("missing", "blobs/drives/a is missing"),
        ("damaged", "blobs/drives/a is damaged"),
        ("dump", "database-1.dump is damaged"),
        ({"format": 2}, "made by a newer Versant"),
        ({"versions": VERSIONS | {"revision": "9999"}}, "of schema 9999"),
        ({"files": [{"path": "blobs/../../x", "size_bytes": 0, "sha256": ""}]}, "outside of its folder"),
        ({"files": [{"path": "/x", "size_bytes": 0, "sha256": ""}]}, "outside of its folder"),
        ({"dump": {}}, "is no list of a backup"),
        ("text", "cannot be read"),
        ("nothing", "holds no complete backup"),
    ],
)
def test_a_backup_that_is_not_whole_is_refused(harm: str | dict[str, Any], says: str, tmp_path: Path) -> None:
    made(tmp_path)
    if isinstance(harm, dict):
        listed = json.loads((tmp_path / "manifest.json").read_text())
        (tmp_path / "manifest.json").write_text(json.dumps(listed | harm))
    elif harm == "missing":
        (tmp_path / "blobs/drives/a").unlink()
    elif harm == "damaged":
        (tmp_path / "blobs/drives/a").write_bytes(b"?")
    elif harm == "dump":
        (tmp_path / "database-1.dump").write_bytes(b"")
    elif harm == "text":
        (tmp_path / "manifest.json").write_text("{")
    else:
        (tmp_path / "manifest.json").unlink()
    with pytest.raises(BackupError, match=says):
        checked(tmp_path)


def test_one_program_at_a_time_writes_a_backup(tmp_path: Path) -> None:
    with alone_in(tmp_path), pytest.raises(BackupError, match="Another program"), alone_in(tmp_path):
        pass
    with alone_in(tmp_path):
        pass


def test_a_copy_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    class Broken(BytesIO):
        def read(self, size: int | None = -1, /) -> bytes:
            if self.tell():
                raise OSError("the disk is gone")
            return super().read(3)

    with pytest.raises(OSError, match="gone"):
        keep(tmp_path, "blobs/a", lambda: Broken(b"many bytes"))
    assert [path.name for path in (tmp_path / "blobs").iterdir()] == ["a.part"]
