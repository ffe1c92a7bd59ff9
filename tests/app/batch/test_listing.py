"""Which logs there are, in whatever order storage lists them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fsspec
import pytest

from app.batch.folder import BatchError
from app.batch.listing import list_logs, opened
from app.core.mirror import sha256_of


def test_folders_zips_and_files_by_name_each_once(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    (folder / "deep").mkdir(parents=True)
    for name in ("b.csv", "deep/a.csv", ".hidden", "Thumbs.db"):
        (folder / name).write_text(name)
    with zipfile.ZipFile(tmp_path / "archive.zip", "w") as archive:
        for name in ("z.csv", "deep/y.ubx", "__MACOSX/z.csv"):
            archive.writestr(name, name)
    with zipfile.ZipFile(folder / "bundle.zip", "w") as bundle:
        bundle.writestr("one.obs", "1")
    named = [str(tmp_path / "archive.zip"), str(folder), str(folder / "b.csv")]
    logs = list_logs(named)
    assert [log.name.removeprefix(f"{tmp_path}/") for log in logs] == [
        "archive.zip!deep/y.ubx", "archive.zip!z.csv", "logs/b.csv", "logs/bundle.zip", "logs/deep/a.csv",
    ]  # fmt: skip
    assert list_logs(named[::-1]) == logs
    assert [log.size for log in logs[:3]] == [10, 5, 5]
    with opened(logs[0]) as path:
        assert (path.name, path.read_text()) == ("y.ubx", "deep/y.ubx")
        assert len(sha256_of(path)) == 64
    assert not path.exists(), "a copy lasts as long as it is read"


def test_other_bytes_have_another_stamp(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("log.csv", "one")
    (before,) = list_logs([str(tmp_path / "a.zip")])
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("log.csv", "two")
    (after,) = list_logs([str(tmp_path / "a.zip")])
    assert before.size == after.size
    assert before.stamp != after.stamp


def test_logs_of_an_address_are_read_from_there() -> None:
    fs = fsspec.filesystem("memory")
    fs.pipe("/bucket/logs/a.csv", b"one")
    fs.pipe("/bucket/logs/more/b.csv", b"two")
    logs = list_logs(["memory://bucket/logs"])
    assert [log.name for log in logs] == ["memory://bucket/logs/a.csv", "memory://bucket/logs/more/b.csv"]
    with opened(logs[1]) as path:
        assert path.read_bytes() == b"two"


@pytest.mark.parametrize("name", ["none", "empty", "broken.zip"])
def test_a_name_without_logs_is_told(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.zip").write_text("no zip")
    with pytest.raises(BatchError, match=name):
        list_logs([str(tmp_path / name)])
